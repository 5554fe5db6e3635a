"""What every step of a run imports: the fork server loads it once, and steps start quickly."""

import matplotlib.figure  # noqa: F401
import numba  # noqa: F401
import torch  # noqa: F401

import tactile_assets.definitions  # noqa: F401
