"""Training a policy: what decides its weights, and what it is trained on."""

import dataclasses

import numpy as np
import pytest
import torch

from tactile_core.errors import TactileError
from tactile_core.exploration.learning.approach import Approach
from tactile_core.exploration.learning.approaches import APPROACHES, find_approach
from tactile_core.exploration.learning.train import shapes_to_learn_from
from tactile_core.exploration.world.rewards import Stage
from tactile_core.reconstruction.known_shapes import pack


def test_a_training_leaves_pytorch_the_threads_it_had(train):
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        train("gain")
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_policies_learn_on_shapes_that_the_unet_does_not_know(shapes, unet, knowing_unet):
    train = shapes["train"]
    everything, plain = shapes_to_learn_from(train, unet)
    assert everything is train
    assert plain.version == unet.version()
    some, reconstructor = shapes_to_learn_from(train, knowing_unet)
    assert 2 * len(some) == len(train)
    rest = ~np.isin(train.model_ids, some.model_ids)
    known = dataclasses.replace(knowing_unet, known=pack(train.masks[rest]))
    assert reconstructor.version == known.version()


def test_a_single_train_model_that_the_unet_knows_is_refused(shapes, knowing_unet):
    train = shapes["train"]
    one = train.select(np.flatnonzero(train.model_ids == train.model_ids[0]))
    with pytest.raises(TactileError, match="is the only train model"):
        shapes_to_learn_from(one, knowing_unet)


@pytest.mark.parametrize("approach", ["total", "gain"])
def test_the_seed_decides_the_weights(train, approach):
    torch.manual_seed(5)  # what happened before does not matter
    first = train(approach, "first")
    assert first == train(approach, "second")
    assert first != train(approach, "other", seed=1)


def test_approaches_differ_in_what_they_learn(train):
    assert train("diff", "one") != train("total", "other")


def test_an_unknown_approach_is_refused_before_anything_is_trained(train, tmp_path):
    with pytest.raises(TactileError, match="approach 'dif' is unknown: choose from diff, total"):
        train("dif")
    assert not any(tmp_path.iterdir())


def test_another_approach_in_the_list_leaves_the_trainings_of_others(monkeypatch):
    def bold(cast):
        return cast.jaccard**2

    def shy(cast):
        return cast.jaccard / 2

    approaches = [Approach("own", "Any.", (Stage(reward),)) for reward in (bold, shy, bold)]
    assert approaches[0].version == approaches[2].version != approaches[1].version
    described = dataclasses.replace(approaches[0], description="In other words.")
    assert described.version == approaches[0].version
    longer = dataclasses.replace(approaches[0], stages=(Stage(bold), Stage(bold, ends="touches")))
    assert longer.version != approaches[0].version
    before = find_approach("diff").version
    monkeypatch.setitem(APPROACHES, "own", approaches[0])
    assert find_approach("diff").version == before
