"""Checks pass on what the chain stored, and fail where something is wrong with it."""

import dataclasses

import dagster as dg
import numpy as np
import pandas as pd
import pytest

from tactile_assets.checks import dataset, evaluation, exploration, reconstruction
from tactile_core.dataset.rendering.pictures import decode_masks, encode_mask
from tactile_core.parquet import read_table, write_table
from tactile_core.reconstruction.unets import load_unets


def outcome(result, check):
    [found] = [e for e in result.get_asset_check_evaluations() if e.check_name == check]
    return found


def test_checks_of_the_finished_run_passed_where_training_length_does_not_matter(finished):
    for name in (
        "meshes_are_usable",
        "masks_lie_inside_the_circle",
        "samples_lie_inside_the_circle",
        "no_model_in_two_splits",
        "classes_are_balanced",
        "touches_lie_on_outlines",
        "a_unet_can_overfit",
        "outlines_lie_on_their_masks",
        "the_unet_is_sound",
        "policies_are_sound",
    ):
        assert f"check {name} passed" in finished.stderr


def test_a_leak_between_splits_stops_the_run_before_outlines(copy_of_chain, monkeypatch):
    from tactile_core.dataset import splits

    rotate = splits.rotate_splits

    def leak(*arguments, **named):
        table = rotate(*arguments, **named)
        train = table[table["split"] == "train"].iloc[[0]]
        return pd.concat([table, train.assign(split="test", sample_id="leak-r0")])

    monkeypatch.setattr(splits, "rotate_splits", leak)
    result = copy_of_chain.materialise("rotated_splits", "outlines", raise_on_error=False)
    assert not result.success
    leaked = outcome(result, "no_model_in_two_splits")
    assert not leaked.passed and "1 models" in leaked.description
    assert result.get_step_success_events()
    assert "outlines" not in {event.step_key for event in result.get_step_success_events()}


def test_one_mesh_under_two_names_is_a_leak_too(chain):
    table = read_table(chain.store.path("rotated_splits.parquet"))
    assert dataset.no_model_in_two_splits(table).passed
    train = table.loc[table["split"] == "train", "content_hash"].iloc[0]
    test = table["split"] == "test"
    copied = table.assign(content_hash=table["content_hash"].where(~test, train))
    assert not dataset.no_model_in_two_splits(copied).passed


def test_a_class_that_is_missing_from_a_split_is_unbalanced(chain):
    table = read_table(chain.store.path("rotated_splits.parquet"))
    assert dataset.classes_are_balanced(table).passed
    lacking = table[(table["split"] != "train") | (table["category"] != "mug")]
    assert not dataset.classes_are_balanced(lacking).passed
    only_train = table[(table["split"] == "train") | (table["category"] != "mug")]
    result = dataset.classes_are_balanced(only_train)
    assert not result.passed
    assert result.description.startswith("mug is missing in eval, test; splits are ")
    none = dataset.classes_are_balanced(table[table["split"] != "eval"])
    assert not none.passed and "bottle is missing in eval; mug is missing in" in none.description


@pytest.mark.parametrize("fault", ["empty", "outside"])
def test_masks_that_no_ray_could_explore_are_found(chain, fault):
    table = read_table(chain.store.path("masks.parquet"))
    assert dataset.masks_lie_inside_the_circle(table).passed
    mask = np.zeros_like(decode_masks(table["mask"])[0])
    if fault == "outside":
        mask[0, 0] = True
    pictures = [encode_mask(mask), *table["mask"][1:]]
    result = dataset.masks_lie_inside_the_circle(table.assign(mask=pictures))
    assert not result.passed
    assert table["model_id"][0] in result.metadata["first"].value


def test_touches_off_the_outline_and_touches_made_twice_are_found(chain):
    touches = read_table(chain.store.path("tactile_samples.parquet"))
    outlines = read_table(chain.store.path("outlines.parquet"))
    assert dataset.touches_lie_on_outlines(touches, outlines).passed
    for wrong in (np.zeros((1, 2), np.int16), np.repeat(touches["touches"][0][:1], 2, axis=0)):
        changed = touches.copy()
        changed.at[0, "touches"] = wrong
        assert not dataset.touches_lie_on_outlines(changed, outlines).passed


def test_an_outline_off_its_mask_and_a_sample_without_one_are_found(chain):
    outlines = read_table(chain.store.path("outlines.parquet"))
    splits = read_table(chain.store.path("rotated_splits.parquet"))
    assert dataset.outlines_lie_on_their_masks(outlines, splits).passed
    off = outlines.copy()
    off.at[0, "outline"] = np.zeros((1, 2), np.int16)
    result = dataset.outlines_lie_on_their_masks(off, splits)
    assert not result.passed and result.metadata["off_their_mask"].value == 1
    result = dataset.outlines_lie_on_their_masks(outlines[1:], splits)
    assert not result.passed and result.metadata["without_an_outline"].value == 1


def test_weights_that_are_no_numbers_and_another_resolution_are_found(chain):
    splits = read_table(chain.store.path("rotated_splits.parquet"))
    [unet] = load_unets(chain.store.path("unet")).values()
    assert reconstruction.the_unet_is_sound({0: unet}, splits).passed
    assert not reconstruction.the_unet_is_sound({0: unet}, splits.assign(resolution=128)).passed
    name = next(iter(unet.weights))
    weights = {**unet.weights, name: unet.weights[name] * float("nan")}
    broken = dataclasses.replace(unet, weights=weights)
    result = reconstruction.the_unet_is_sound({0: unet, 1: broken}, splits)
    assert not result.passed
    assert result.metadata["weights_not_finite"].value == unet.weights[name].numel()


def test_policies_of_another_unet_are_found(chain):
    [unet] = load_unets(chain.store.path("unet")).values()
    directories = [chain.store.path("policies", name) for name in ("total-0", "gain-0")]
    weights = {name: 2 * values for name, values in unet.weights.items()}
    other = dataclasses.replace(unet, weights=weights)
    assert exploration.policies_are_sound(directories, {0: unet, 1: other}).passed
    result = exploration.policies_are_sound(directories, {0: other, 1: unet})
    assert not result.passed and result.metadata["of_another_unet"].value == 2


def test_a_policy_that_reconstructs_no_better_with_all_touches_is_found(chain):
    table = read_table(chain.store.path("per_grasp_evaluation.parquet"))
    rising = table.assign(jaccard=table["grasp"] * 5.0)
    assert evaluation.touches_raise_the_jaccard_index(rising).passed
    flat = rising.assign(jaccard=rising["jaccard"].where(rising["policy"] != "total", 50.0))
    result = evaluation.touches_raise_the_jaccard_index(flat)
    assert not result.passed and result.metadata["policies_no_better"].value == 1


def test_meshes_set_aside_are_counted_with_their_reasons(chain):
    table = read_table(chain.store.path("shapenet_meshes.parquet"))
    table.loc[0, "status"] = "has no faces"
    result = dataset.meshes_are_usable(table)
    assert not result.passed and result.severity == dg.AssetCheckSeverity.WARN
    assert result.description == "1 of 12 meshes set aside"
    assert result.metadata["meshes_set_aside"].records[0].data["status"] == "has no faces"


def test_a_unet_worse_than_the_mean_shape_is_found(chain):
    table = read_table(chain.store.path("reconstruction_evaluation.parquet"))
    splits = read_table(chain.store.path("rotated_splits.parquet"))
    outlines = read_table(chain.store.path("outlines.parquet"))
    for jaccard, passed in ((99.0, True), (1.0, False)):
        result = reconstruction.the_unet_beats_the_mean_shape(
            table.assign(jaccard=jaccard), splits, outlines
        )
        assert result.passed == passed


def test_policies_no_better_than_random_are_found_and_only_warn_in_smoke(chain):
    table = read_table(chain.store.path("per_step_evaluation.parquet"))
    trained = table["policy"].isin(["total", "gain", "recall"])
    better = table.assign(jaccard=np.where(trained, 90.0, 50.0))
    assert evaluation.trained_policies_beat_random(better).passed
    worse = better.assign(jaccard=better["jaccard"].where(table["policy"] != "gain", 49.0))
    result = evaluation.trained_policies_beat_random(worse)
    assert not result.passed and result.severity == dg.AssetCheckSeverity.WARN
    assert result.description == "1 of 3 policies do not beat random (50.0)"


def test_policies_of_each_seed_are_measured_by_random_with_the_unet_of_that_seed(chain):
    table = read_table(chain.store.path("per_step_evaluation.parquet"))
    table = table[table["policy"].isin(["random", "total"])]
    good = table.assign(jaccard=np.where(table["policy"] == "random", 70.0, 75.0))
    poor = table.assign(seed=1, jaccard=np.where(table["policy"] == "random", 40.0, 45.0))
    both = pd.concat([good, poor])
    assert evaluation.trained_policies_beat_random(both).passed
    worse = pd.concat([good.assign(jaccard=good["jaccard"].clip(upper=70.0)), poor])
    result = evaluation.trained_policies_beat_random(worse)
    assert not result.passed and result.metadata["policies_below_random"].value == 1
    of_one_unet = pd.concat([good, poor[poor["policy"] != "random"]])
    assert not evaluation.trained_policies_beat_random(of_one_unet).passed


def test_an_evaluation_without_random_is_not_judged_by_it(chain):
    table = read_table(chain.store.path("per_step_evaluation.parquet"))
    result = evaluation.trained_policies_beat_random(table[table["policy"] == "even"])
    assert result.passed and result.description == "random was not evaluated"


def test_a_trained_policy_that_loses_to_random_is_told(chain, monkeypatch):
    monkeypatch.setattr(evaluation, "UNLESS_SMOKE", dg.AssetCheckSeverity.ERROR)
    table = read_table(chain.store.path("per_step_evaluation.parquet"))
    table = table.assign(jaccard=np.where(table["policy"] == "total", 10.0, 50.0))
    lost = evaluation.trained_policies_beat_random(table[table["policy"].isin(["random", "total"])])
    assert (lost.passed, lost.severity) == (False, dg.AssetCheckSeverity.ERROR)


def test_checks_can_be_run_alone_on_what_is_stored(copy_of_chain):
    table = read_table(copy_of_chain.store.path("rotated_splits.parquet"))
    leaked = table.assign(model_id="one")
    write_table(leaked, copy_of_chain.store.path("rotated_splits.parquet"))
    result = copy_of_chain.check("rotated_splits")
    assert not outcome(result, "no_model_in_two_splits").passed
