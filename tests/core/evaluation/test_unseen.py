"""Whoever was trained on a test model is not tested."""

import dataclasses

import numpy as np
import pytest

from tactile_core.errors import TactileError
from tactile_core.evaluation.unseen import refuse_known


def check(test, unet, by_name=True):
    refuse_known(test, {"the U-Net": unet.trained_on}, by_name=by_name, remedy="do something")


def test_models_that_nobody_was_trained_on_are_tested(shapes, unet):
    check(shapes["test"], unet)


@pytest.mark.parametrize("split", ["train", "eval"])
def test_models_of_the_training_are_refused_with_their_number(shapes, unet, split):
    count = len(set(shapes[split].model_ids))
    with pytest.raises(TactileError, match=f"{count} of the {count} models .* by the U-Net"):
        check(shapes[split], unet)


def test_an_object_under_another_name_is_known_by_its_geometry(shapes, unet):
    names = np.array([f"scan-{name}" for name in shapes["train"].model_ids])
    renamed = dataclasses.replace(shapes["train"], model_ids=names)
    for by_name in (True, False):
        with pytest.raises(TactileError, match="do something"):
            check(renamed, unet, by_name)


def test_another_object_of_the_same_name_is_refused_within_one_data_set_only(shapes, unet):
    test, train = shapes["test"], shapes["train"]
    namesakes = dataclasses.replace(test, model_ids=train.model_ids[: len(test)])
    with pytest.raises(TactileError):
        check(namesakes, unet)
    check(namesakes, unet, by_name=False)
