"""What every step of a run imports: the fork server loads it once, and steps start quickly."""

import os
from functools import partial

import matplotlib.figure  # noqa: F401
import numba  # noqa: F401
import torch  # noqa: F401

import tactile_assets.definitions  # noqa: F401
from tactile_core.processes import end_with

# A step that outlived a killed run would write into the next one; the fork server ends with it.
os.register_at_fork(after_in_child=partial(end_with, os.getpid()))
