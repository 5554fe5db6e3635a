"""Loops over pixels, compiled by numba."""

from collections.abc import Callable
from typing import Any

import numba


def compiled(function: Callable) -> Callable[..., Any]:
    """`function` compiled by numba, outside the GIL, and cached on disk where that is possible.

    The cache knows the function's own file only: constants of other modules must be arguments, or
    they would stay what they once were.
    """
    try:
        return numba.njit(cache=True, nogil=True)(function)
    except RuntimeError:  # neither the package nor the user's cache folder can be written
        return numba.njit(nogil=True)(function)
