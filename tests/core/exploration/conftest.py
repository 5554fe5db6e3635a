"""Policies trained in a moment, and explorations for them to go on with."""

import numpy as np
import pytest
from upath import UPath

from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.learning.train import train_policy
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.inference import Reconstructor
from tests.core.exploration.quick import QUICK


@pytest.fixture
def train(shapes, unet, tmp_path):
    """Trains a policy into `tmp_path`/name; returns the hash of its weights."""

    def run(approach, name="policy", seed=0, settings=QUICK, **options):
        return train_policy(
            find_approach(approach),
            seed,
            shapes["train"],
            unet,
            settings,
            directory=UPath(tmp_path) / name,
            work=tmp_path / "work" / name,
            **options,
        )

    return run


@pytest.fixture
def explorations(shapes, unet) -> Explorations:
    """The test shapes, after two rays each."""
    explorations = Explorations(shapes["test"].masks, Reconstructor(unet))
    for _ in range(2):
        explorations.cast(find_reference("even").choose(explorations, np.random.default_rng(0)))
    return explorations
