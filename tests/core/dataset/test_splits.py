from collections import Counter

import numpy as np
import pandas as pd
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from upath import UPath

from tactile_core.dataset.rendering.camera import project
from tactile_core.dataset.rendering.pictures import decode_masks
from tactile_core.dataset.rendering.rasteriser import rasterise
from tactile_core.dataset.rendering.silhouettes import EMPTY, render_masks
from tactile_core.dataset.seeds import generator
from tactile_core.dataset.sources.parsing import load_mesh
from tactile_core.dataset.splits import rotate_splits, split_models, views_of_model
from tactile_core.errors import TactileError
from tactile_core.files import content_hash
from tactile_core.parquet import read_table, table_hash, write_table
from tactile_core.settings import LARGEST_SEED, MaskSettings, SplitSettings

MASKS = MaskSettings(resolution=64, renderer="rasteriser")
DEFAULT = SplitSettings()
sizes = st.lists(st.integers(1, 40), min_size=1, max_size=4).filter(lambda counts: sum(counts) >= 3)
shares = st.floats(0.01, 0.4)


def models(counts):
    """Masks, without pictures, of so many models in each category."""
    return pd.DataFrame(
        [
            {
                "model_id": f"{category}-{number}",
                "category": f"c{category}",
                "status": "ok",
                "content_hash": f"{category}-{number}",
                "geometry": f"{category}-{number}",
                "mask": None,
            }
            for category, count in enumerate(counts)
            for number in range(count)
        ]
    )


def split_of(masks, split_settings=DEFAULT):
    return split_models(masks, split_settings).set_index("model_id")["split"]


@settings(deadline=None)
@given(sizes, shares, shares, st.integers(0, LARGEST_SEED))
def test_every_model_stands_in_one_split_and_every_split_has_models(counts, evals, tests, seed):
    masks = models(counts)
    split_settings = SplitSettings(eval_share=evals, test_share=tests, seed=seed)
    splits = split_models(masks, split_settings)
    assert sorted(splits["model_id"]) == sorted(masks["model_id"])
    assert set(splits["split"]) == {"train", "eval", "test"}
    for category, count in enumerate(counts):
        of_category = Counter(splits.loc[splits["category"] == f"c{category}", "split"])
        if count >= 3:
            assert set(of_category) == {"train", "eval", "test"}
            if count >= 10:
                assert abs(of_category["test"] - max(1, tests * count)) <= 0.5 + 1e-9
                assert abs(of_category["eval"] - max(1, evals * count)) <= 0.5 + 1e-9


def objects(*names: str) -> pd.DataFrame:
    """Models of the objects that these words' letters name; a word is a category."""
    letters = "".join(names)
    return models([len(word) for word in names]).assign(
        content_hash=[*letters], geometry=[*letters]
    )


def shared(splits: pd.DataFrame) -> dict[str, int]:
    return splits["split"].value_counts().to_dict()


def test_where_every_category_is_too_small_each_split_still_gets_an_object():
    assert shared(split_models(models([1, 1, 1]), DEFAULT)) == {"train": 1, "eval": 1, "test": 1}
    assert shared(split_models(models([2, 2, 1]), DEFAULT)) == {"train": 3, "eval": 1, "test": 1}


def test_the_object_with_fewest_copies_leaves_a_split_that_has_enough():
    splits = split_models(objects("aaa", "bb", "cc", "d"), DEFAULT)
    assert splits.groupby("copy_of")["split"].first().to_dict() == {
        "0-0": "train", "1-0": "eval", "2-0": "train", "3-0": "test",
    }  # fmt: skip


def test_one_or_two_models_of_a_category_stay_in_train_beside_larger_ones():
    splits = split_models(models([2, 30, 1]), DEFAULT)
    assert set(splits.loc[splits["category"] != "c1", "split"]) == {"train"}


def test_copies_that_are_more_than_a_share_leave_train_only_where_there_are_three_objects():
    """A share of six models is one, and each object has two."""
    three = split_models(objects("aabbcc", "defghijklm"), DEFAULT)
    first = three[three["category"] == "c0"]
    assert shared(first) == {"train": 2, "test": 2, "eval": 2}
    two = split_models(objects("aabb", "defghijklm"), DEFAULT)
    assert shared(two[two["category"] == "c0"]) == {"train": 4}


def test_a_category_that_keeps_one_object_for_itself_keeps_it_in_train():
    """`b` and `c` stand among the first category's, where they went to train."""
    splits = split_models(objects("bbbbccccdefg", "aaabc"), SplitSettings(test_share=0.1))
    of = splits.groupby("copy_of")["split"].first()
    assert of["0-0"] == of["0-4"] == "train"
    assert of["1-0"] == "train"


def test_copies_of_a_mesh_under_other_ids_stay_in_one_split():
    masks = models([20, 20])
    masks["content_hash"] = [f"mesh-{number // 2}" for number in range(40)]
    splits = split_models(masks, DEFAULT).merge(masks, on="model_id")
    assert (splits.groupby("content_hash")["split"].nunique() == 1).all()


def test_the_reports_712_models_give_355_test_samples():
    splits = split_models(models([214, 498]), DEFAULT)
    counts = Counter(zip(splits["category"], splits["split"], strict=True))
    assert counts == {
        ("c0", "train"): 172, ("c0", "eval"): 21, ("c0", "test"): 21,
        ("c1", "train"): 398, ("c1", "eval"): 50, ("c1", "test"): 50,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("count", "evals", "tests", "expected"),
    [
        (3, 0.1, 0.1, (1, 1, 1)),
        (4, 0.4, 0.4, (1, 1, 2)),  # two and two would leave none to train on
        (7, 0.1, 0.25, (4, 1, 2)),
        (10, 0.25, 0.35, (3, 3, 4)),
    ],
)
def test_a_small_category_is_dealt_in_whole_models(count, evals, tests, expected):
    found = Counter(split_of(models([count]), SplitSettings(eval_share=evals, test_share=tests)))
    assert (found["train"], found["eval"], found["test"]) == expected


def test_two_objects_are_too_few_however_many_copies_there_are():
    masks = models([8]).assign(content_hash=["a"] * 7 + ["b"], geometry=["a"] * 7 + ["b"])
    with pytest.raises(TactileError, match="8 models have a mask and are 2 different") as refused:
        split_models(masks, DEFAULT)
    named = str(refused.value).partition(", as ")[2].partition(" are copies of each other")[0]
    assert named.split(", ") == [f"0-{number}" for number in range(5)]
    with pytest.raises(TactileError) as refused:
        split_models(models([2]), DEFAULT)
    assert "copies" not in str(refused.value)


def test_the_split_depends_on_the_seed_and_the_set_of_models_only():
    masks = models([20, 30])
    shuffled = masks.sample(frac=1, random_state=1)
    assert split_models(masks, DEFAULT).equals(split_models(shuffled, DEFAULT))
    other = split_of(masks, SplitSettings(seed=1))
    assert (split_of(masks) != other).sum() > 5


def test_one_more_model_moves_few_others():
    before, after = split_of(models([100, 100])), split_of(models([101, 100]))
    assert (after[before.index] != before).sum() <= 2


def test_models_set_aside_are_in_no_split():
    masks = models([10]).assign(status=["ok"] * 9 + [EMPTY])
    assert len(split_of(masks)) == 9


def test_too_few_models_or_one_twice_are_refused():
    with pytest.raises(TactileError, match=r"2 models have a mask.*need one each"):
        split_models(models([2]), DEFAULT)
    with pytest.raises(TactileError, match=r"model 0-0 stands in masks twice"):
        split_models(pd.concat([models([5]), models([2])]), DEFAULT)


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    """Nine boxes: the root of their files, their manifest and their masks."""
    root = UPath(tmp_path_factory.mktemp("meshes"))
    random = np.random.default_rng(0)
    for number in range(9):
        box = trimesh.creation.box(extents=random.uniform(0.2, 1, 3))
        (root / f"{number}.obj").write_text(box.export(file_type="obj"))
    meshes = pd.DataFrame(
        {
            "model_id": [f"m{number}" for number in range(9)],
            "category": ["mug"] * 5 + ["bottle"] * 4,
            "file": [f"{number}.obj" for number in range(9)],
            "content_hash": [content_hash((root / f"{n}.obj").read_bytes()) for n in range(9)],
            "geometry": [f"geometry{number}" for number in range(9)],
            "status": "ok",
        }
    )
    return root, meshes, render_masks(meshes, root, MASKS)


def rotated(collected, split_settings=DEFAULT, previous=None, progress=print, workers=None):
    root, meshes, masks = collected
    return rotate_splits(masks, meshes, root, MASKS, split_settings, previous, progress, workers)


def test_each_sample_shows_its_model_at_its_rotation(collected):
    root, meshes, masks = collected
    samples = rotated(collected)
    assert samples["sample_id"].tolist()[:6] == [*(f"m5-r{k}" for k in range(5)), "m6-r0"]
    assert samples["rotation"].between(0, 360, inclusive="left").all()
    assert samples["rotation"].nunique() == 45
    assert (samples.groupby("model_id")["split"].nunique() == 1).all()
    split = split_of(masks)
    files = meshes.set_index("model_id")["file"]
    for row, mask in zip(samples.itertuples(), decode_masks(samples["mask"]), strict=True):
        assert row.split == split[row.model_id]
        mesh = load_mesh(root, files[row.model_id])
        points = project(mesh.vertices, row.rotation, 64)
        assert (mask == rasterise(points, mesh.faces, 64)).all()


def test_samples_do_not_depend_on_the_number_of_processes_and_survive_storage(collected, tmp_path):
    alone = rotated(collected, workers=1)
    assert table_hash(alone) == table_hash(rotated(collected, workers=2))
    write_table(alone, tmp_path / "samples.parquet")
    assert table_hash(read_table(tmp_path / "samples.parquet")) == table_hash(alone)


def test_a_models_rotations_depend_on_the_seed_and_its_id_only(collected):
    root, meshes, masks = collected
    samples = rotated(collected).set_index("sample_id")["rotation"]
    fewer = rotated((root, meshes, masks.iloc[3:])).set_index("sample_id")["rotation"]
    assert fewer.equals(samples[fewer.index])
    other = rotated(collected, SplitSettings(seed=1)).set_index("sample_id")["rotation"]
    assert not set(other) & set(samples)


def test_angles_are_drawn_from_the_whole_circle(collected):
    first = rotated(collected)["rotation"].head(5)
    assert first.tolist() == generator(0, "m5").uniform(0, 360, 5).tolist()


def test_copies_are_counted_and_rotated_in_one_split(collected):
    root, meshes, masks = collected
    geometry = ["geometry0"] * 3 + meshes["geometry"].tolist()[3:]
    meshes, masks = (some.assign(geometry=geometry) for some in (meshes, masks))
    messages = []
    samples = rotated((root, meshes, masks), progress=messages.append)
    more = 9 - samples["copy_of"].nunique()  # some boxes look alike besides
    assert more >= 2
    assert messages[0].startswith(f"{more} models are copies of others")
    assert samples.loc[samples["geometry"] == "geometry0", "split"].nunique() == 1


def test_samples_that_stay_are_not_rendered_again(collected):
    messages = []
    three = rotated(collected, SplitSettings(rotations=3))
    five = rotated(collected, SplitSettings(rotations=5), three, messages.append)
    assert messages[-1] == "18 masks rendered, 27 unchanged"
    assert table_hash(five) == table_hash(rotated(collected))


def test_a_mesh_that_changed_after_its_mask_is_refused(collected):
    root, meshes, masks = collected
    newer = meshes.assign(
        content_hash=meshes["content_hash"].where(meshes["model_id"] != "m4", "other")
    )
    with pytest.raises(TactileError, match=r"model m4 .*changed.*materialise masks again"):
        rotated((root, newer, masks))


def test_a_mesh_file_that_is_gone_is_refused(collected, tmp_path):
    _, meshes, masks = collected
    with pytest.raises(TactileError, match=r"5.obj is missing: materialise shapenet_meshes"):
        rotated((UPath(tmp_path), meshes, masks))


def test_masks_of_another_resolution_are_refused(collected):
    root, meshes, masks = collected
    with pytest.raises(TactileError, match=r"masks have resolution 32 and .* should have 64"):
        rotated((root, meshes, masks.assign(resolution=32)))


def test_a_rotation_that_shows_no_pixel_is_left_out(collected, tmp_path):
    """A sheet seen from its edge, whose mask an earlier and thicker version left behind."""
    root, meshes, masks = collected
    sheet = UPath(tmp_path) / "sheet.obj"
    sheet.write_text("v 0 -0.5 0\nv 0 0.5 0\nv 0.1 0 0.1\nf 1 2 3\n")
    version = content_hash(sheet.read_bytes())
    meshes, masks = (
        some.assign(content_hash=[*some["content_hash"][:-1], version]) for some in (meshes, masks)
    )
    meshes = meshes.assign(file=[str(root / file) for file in meshes["file"][:-1]] + [str(sheet)])
    messages = []
    samples = rotated((UPath("/"), meshes, masks), progress=messages.append)
    assert len(samples) == 40
    assert "5 samples left out: no pixel lies inside" in messages[-1]
    assert messages[-1].endswith(f"(first: {masks['model_id'].iloc[-1]}-r0)")


def test_train_models_have_warped_copies_and_no_others_do(collected):
    plain = rotated(collected)
    more = rotated(collected, SplitSettings(warps=2))
    warped = more[more["warp"] > 0]
    assert set(warped["split"]) == {"train"}
    assert (warped["model_id"].value_counts() == 2).all()
    assert set(warped["model_id"]) == set(plain.loc[plain["split"] == "train", "model_id"])
    assert warped["warp"].is_unique and warped["mask"].is_unique
    assert not set(warped["mask"]) & set(plain["mask"])


def test_angles_and_warps_are_drawn_evenly_and_stay_what_they_are():
    """The numbers are those that were drawn on the first day: an id means the same sample."""
    views = [*views_of_model("mug-1", "train", SplitSettings(rotations=1, warps=1000))][1:]
    first = views[0]
    assert (first.sample_id, first.warp) == ("mug-1-w0", 858841128)
    assert first.rotation == pytest.approx(253.255192, abs=1e-6)
    rotations = np.array([view.rotation for view in views])
    assert rotations.min() < 2 and 358 < rotations.max() < 360
    assert np.quantile(rotations, [0.25, 0.5, 0.75]) == pytest.approx([90, 180, 270], abs=15)
    warps = np.array([view.warp for view in views])
    assert warps.min() < 2**32 / 100 and 2**32 * 0.99 < warps.max() < 2**32


def test_samples_as_they_are_do_not_depend_on_how_many_are_warped(collected):
    said = []
    plain = rotated(collected)
    more = rotated(collected, SplitSettings(warps=1), plain, said.append)
    unwarped = more[more["warp"] == 0].reset_index(drop=True)
    assert table_hash(unwarped) == table_hash(plain)
    assert said[-1] == f"{len(more) - len(plain)} masks rendered, {len(plain)} unchanged"
    again = rotated(collected, SplitSettings(warps=3)).set_index("sample_id")["key"]
    assert again[more["sample_id"]].tolist() == more["key"].tolist()
