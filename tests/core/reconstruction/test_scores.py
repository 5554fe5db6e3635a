"""How well the U-Net reconstructs (report, Table II)."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch

from tactile_core.dataset.outlines import outline
from tactile_core.dataset.packed import pack_masks
from tactile_core.dataset.shapes import Shapes
from tactile_core.dataset.touches import rasterise_touches
from tactile_core.reconstruction import epoch
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.jaccard import jaccard_index
from tactile_core.reconstruction.known_shapes import models_of
from tactile_core.reconstruction.scores import (
    depth_for,
    evaluate_reconstruction,
    mean_shape_jaccard,
    overfit_jaccard,
)
from tactile_core.reconstruction.stored_touches import touch_sets_of
from tactile_core.reconstruction.unet import UNet


@pytest.fixture(scope="module")
def tactile_samples(shapes) -> pd.DataFrame:
    """Two sets of three touches for each sample, as a table stores them: lists of pairs."""
    return pd.DataFrame(
        {"sample_id": sample, "set": number, "touches": list(map(tuple, outline[start::9][:3]))}
        for some in shapes.values()
        for sample, outline in zip(some.sample_ids, some.outlines, strict=True)
        for number, start in enumerate((0, 4))
    )


@pytest.fixture(scope="module", autouse=True)
def _in_float32():
    """bfloat16 moves whole outlines of a net that has learnt for seconds only."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(epoch, "bfloat16_pays", lambda device: False)
        yield


@pytest.fixture(scope="module")
def table(unet, shapes, tactile_samples) -> pd.DataFrame:
    return evaluate_reconstruction(unet, shapes, tactile_samples)


@pytest.fixture(scope="module")
def reconstructor(unet) -> Reconstructor:
    return Reconstructor(unet, "float32")


def test_each_split_has_a_row_for_table_ii_and_one_for_each_number_of_touches(table):
    for split, samples in (("train", 24), ("eval", 8), ("test", 8)):
        rows = table[table["split"] == split]
        assert rows["touches"].isna().tolist() == [True] + 11 * [False]
        assert rows["touches"].iloc[1:].tolist() == list(range(11))
        assert rows["samples"].tolist() == [2 * samples] + 11 * [samples]


def test_table_ii_is_the_mean_over_the_stored_touch_sets(
    table, reconstructor, shapes, tactile_samples
):
    test = shapes["test"]
    sets = tactile_samples.set_index("sample_id")["touches"]
    scores, losses = [], []
    for sample, mask in zip(test.sample_ids, test.masks, strict=True):
        predictions = reconstructor.predict(rasterise_touches(sets[sample].tolist(), 64))
        scores.extend(jaccard_index(predictions, mask))
        losses.append(-np.log(np.where(mask, predictions, 1 - predictions)).mean())
    row = table[(table["split"] == "test") & table["touches"].isna()].iloc[0]
    assert row["jaccard"] == pytest.approx(np.mean(scores), abs=0.05)
    assert row["loss"] == pytest.approx(np.mean(losses), rel=0.001)


def test_without_a_touch_the_score_is_that_of_the_untouched_prediction(
    table, reconstructor, shapes
):
    for split, some in shapes.items():
        row = table[(table["split"] == split) & (table["touches"] == 0)].iloc[0]
        expected = jaccard_index(reconstructor.untouched, some.masks).mean()
        assert row["jaccard"] == pytest.approx(expected, abs=0.05)


def test_ten_touches_tell_more_than_one(table):
    by_touches = table.groupby("touches")["jaccard"].mean()
    assert by_touches[10] > by_touches[1] + 5


def test_the_same_seed_gives_the_same_table(table, unet, shapes, tactile_samples):
    assert evaluate_reconstruction(unet, shapes, tactile_samples).equals(table)


def test_splits_that_did_not_change_are_kept(table, unet, shapes, tactile_samples):
    told = table.assign(loss=0.0)
    assert evaluate_reconstruction(unet, shapes, tactile_samples, previous=told).equals(told)
    fewer = tactile_samples[tactile_samples["sample_id"] != shapes["test"].sample_ids[0]]
    again = evaluate_reconstruction(unet, shapes, fewer, previous=told)
    assert again["loss"].eq(0).groupby(again["split"]).all().to_dict() == {
        "train": True, "eval": True, "test": False,
    }  # fmt: skip
    without_keys = table.drop(columns="key")
    assert (
        evaluate_reconstruction(
            unet, {"test": shapes["test"]}, tactile_samples, previous=without_keys
        )["loss"]
        .gt(0)
        .all()
    )


def test_on_the_train_split_no_model_is_reconstructed_from_its_own_known_shapes(
    knowing_unet, shapes, tactile_samples
):
    """As in training. Recalled, they would make that row of Table II look better than it is."""
    train = {"train": shapes["train"]}
    rows = evaluate_reconstruction(knowing_unet, train, tactile_samples, most=1)
    own = evaluate_reconstruction(knowing_unet, {"test": shapes["train"]}, tactile_samples, most=1)
    assert (rows["jaccard"].iloc[0] + 3) < own["jaccard"].iloc[0]
    models = models_of(knowing_unet.known, shapes["train"].packed, shapes["train"].model_ids)
    assert models.tolist() == shapes["train"].model_ids.tolist()


def test_touch_sets_go_with_their_shapes(shapes, tactile_samples):
    test = shapes["test"]
    indices, sets = touch_sets_of(test, tactile_samples.sample(frac=1, random_state=0))
    assert sorted(indices) == sorted(2 * list(range(8)))
    for index, touches in zip(indices, sets, strict=True):
        assert test.masks[index][tuple(touches.T)].all()


def test_the_mean_shape_is_thresholded_where_it_fits_best():
    """Of three discs about the middle, always saying the middle one scores best."""
    rows, columns = np.indices((32, 32)) - 15.5
    discs = [np.hypot(rows, columns) < radius for radius in (3, 5, 6)]
    masks = np.array(discs)
    names = np.array(["a", "b", "c"])
    shapes = Shapes(pack_masks(masks), [], names, names, names, names)
    expected = max(jaccard_index(disc.astype(float), masks).mean() for disc in discs)
    assert mean_shape_jaccard(shapes, shapes) == pytest.approx(expected)


def test_the_unet_learns_a_handful_of_shapes_by_heart(small_shapes):
    assert overfit_jaccard(small_shapes["train"], shapes=4, epochs=100) > 85


def test_it_learns_them_at_six_times_the_resolution_as_well(small_shapes):
    few = small_shapes["train"].select(np.arange(4))
    masks = few.masks.repeat(6, axis=1).repeat(6, axis=2)
    larger = replace(few, packed=pack_masks(masks), outlines=[outline(mask) for mask in masks])
    assert overfit_jaccard(larger, shapes=4, epochs=200) > 90


def test_that_net_has_a_depth_at_every_resolution_that_masks_can_have():
    for resolution in range(48, 513, 16):
        depth = depth_for(resolution)
        window = torch.zeros(1, 1, resolution, resolution)
        assert UNet(depth, 1).eval()(window).shape[-1] == resolution
    assert [depth_for(resolution) for resolution in (48, 64, 128, 240, 256, 512)] == [
        3,
        3,
        4,
        4,
        5,
        6,
    ]
