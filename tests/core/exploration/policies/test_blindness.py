"""No policy but the oracle looks at the true shape: what was felt alone decides what it casts."""

import numpy as np
import pytest
from upath import UPath

from tactile_core.exploration.learning.approaches import APPROACHES, find_approach
from tactile_core.exploration.policies.references import REFERENCES, find_reference
from tactile_core.exploration.policies.store import load_policies
from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.inference import Reconstructor
from tests.core.small_run import TRAINED

# One approach of each kind of trained policy.
KINDS = {find_approach(name).learner: name for name in TRAINED}


@pytest.fixture(scope="module")
def trained(home, unet) -> dict[str, list]:
    """The policies that come with an approach of each kind: `recall` with `gain`."""
    return {
        kind: load_policies(
            [UPath(home / "artifacts" / "policies" / f"{approach}-0")], unet.version(), 64
        )
        for kind, approach in KINDS.items()
    }


@pytest.fixture(params=[0, 1, 4])
def pair(request, shapes, unet) -> tuple[Explorations, Explorations]:
    """Explorations after some rays, and the same ones of quite another shape."""
    seeing = Explorations(shapes["test"].masks, Reconstructor(unet))
    rng = np.random.default_rng(0)
    for number in range(request.param):
        name = "even" if number % 2 else "random"  # some rays miss
        seeing.cast(find_reference(name).choose(seeing, rng))
    other = seeing.select(np.arange(len(seeing)))
    # What no policy may know, each in a way that would change what is seen through it.
    other.masks = ~other.masks[::-1, ::-1, ::-1]
    other.jaccard = np.roll(other.jaccard, 1) / 2
    return seeing, other


def choices(policy, explorations, deterministic) -> np.ndarray:
    return policy.choose(explorations, np.random.default_rng(3), deterministic)


@pytest.mark.parametrize("deterministic", [True, False])
@pytest.mark.parametrize("name", sorted(set(REFERENCES) - {"oracle"}))
def test_a_reference_policy_never_looks_at_the_true_shape(name, pair, deterministic):
    policy = find_reference(name)
    np.testing.assert_array_equal(*(choices(policy, some, deterministic) for some in pair))


@pytest.mark.parametrize("deterministic", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_a_trained_policy_never_looks_at_the_true_shape(kind, trained, pair, deterministic):
    assert {policy.name for policy in trained[kind]} >= {KINDS[kind]}
    for policy in trained[kind]:
        np.testing.assert_array_equal(*(choices(policy, some, deterministic) for some in pair))


def test_the_oracle_alone_does(pair):
    seeing, other = (choices(find_reference("oracle"), some, True) for some in pair)
    assert not np.array_equal(seeing, other)


def test_every_kind_of_policy_is_looked_at(trained):
    assert set(KINDS) == {approach.learner for approach in APPROACHES.values()}
    names = {policy.name for policies in trained.values() for policy in policies}
    assert {"gain", "recall"} < names and len(names) == len(KINDS) + 1
