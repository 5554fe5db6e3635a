"""The platform as a machine with one GPU sees it."""

from tactile_core import machine

machine.has_gpu = lambda: True

from tactile_assets.definitions import defs  # noqa: E402, F401
