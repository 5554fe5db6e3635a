"""Random numbers that depend on a seed and a name, and on nothing else.

What is drawn for one model or sample does not change when others come or go.
"""

import hashlib

import numpy as np


def name_hash(seed: int, name: str) -> int:
    """A 64-bit number for `name`, different for each seed."""
    return int.from_bytes(hashlib.sha256(f"{seed}:{name}".encode()).digest()[:8], "little")


def generator(seed: int, name: str) -> np.random.Generator:
    """A random generator for `name`."""
    return np.random.default_rng(name_hash(seed, name))
