"""Train, eval and test splits by model, and rotated masks of each (report, section IV)."""

import math
from collections import Counter
from collections.abc import Callable, Iterator
from typing import NamedTuple

import pandas as pd
from upath import UPath

from tactile_core.dataset.copies import find_copies
from tactile_core.dataset.rendering.silhouettes import EMPTY, draw, mask_keys
from tactile_core.dataset.seeds import generator, name_hash
from tactile_core.errors import TactileError
from tactile_core.settings import MaskSettings, SplitSettings

COLUMNS = [
    "sample_id",
    "model_id",
    "category",
    "split",
    "rotation",
    "warp",
    "content_hash",
    "geometry",
    "copy_of",
    "resolution",
    "mask",
    "key",
]


def split_models(masks: pd.DataFrame, settings: SplitSettings) -> pd.DataFrame:
    """The split of every model that has a mask: model_id, category, split, copy_of.

    Stratified by category: eval and test take their share of each category, rounded to the
    nearest whole model, and train takes the rest; with three different objects or more a category
    has at least one in every split. Of 214 mugs and 498 bottles 71 go to test: with five rotations
    355 samples, where the report's 356 cannot be a number of whole models.

    Copies of one object (see `copies`) are dealt as one, so none stands in two splits, and one of
    more copies than a split still wants goes to train. The objects of a category line up by a hash
    of seed and id and are dealt out from there, so the split depends on nothing else, and one more
    model moves at most one other per boundary. Raises `TactileError` with fewer than three objects.
    """
    usable = masks[masks["status"] == "ok"].reset_index(drop=True)
    twice = usable.loc[usable["model_id"].duplicated(), "model_id"]
    if len(twice):
        raise TactileError(
            f"model {twice.iloc[0]} stands in masks twice: give each mesh its own id"
        )
    copy_of = find_copies(usable)
    if copy_of.nunique() < 3:
        raise TactileError(too_few(usable, copy_of))
    rank = usable["model_id"].map(lambda model: name_hash(settings.seed, model))
    queue = usable[["model_id", "category"]].assign(rank=rank, copy_of=copy_of)
    queue = queue.sort_values(["category", "rank", "model_id"])
    split_of: dict[str, str] = {}
    for _, models in queue.groupby("category", sort=True):
        deal(models["copy_of"], settings, split_of)
    for split in ("train", "test", "eval"):  # every category may be too small to fill it
        if split not in split_of.values():
            donor, count = Counter(sorted(split_of.values(), reverse=True)).most_common(1)[0]
            assert count > 1  # there are three objects, and one split is empty
            split_of[smallest(queue["copy_of"], split_of, donor)] = split
    table = queue.assign(split=queue["copy_of"].map(split_of)).drop(columns="rank")
    return table.sort_values(["category", "model_id"]).reset_index(drop=True)


def deal(objects: pd.Series, settings: SplitSettings, split_of: dict[str, str]) -> None:
    """Deal the objects of one category, given for each of its models in the order of the queue, to
    splits, in `split_of`. Objects that another category has dealt stay where they are."""
    tests, evals = _counts(len(objects), settings)
    sizes = objects.value_counts()
    own = [name for name in objects.drop_duplicates() if name not in split_of]
    held = Counter(objects.map(split_of).dropna())
    for split, wanted in (("test", tests), ("eval", evals)):
        for name in own:
            if name not in split_of and sizes[name] <= wanted - held[split]:
                split_of[name] = split
                held[split] += sizes[name]
    split_of |= {name: "train" for name in own if name not in split_of}
    if objects.nunique() >= 3:
        for split in ("test", "eval"):
            in_train = {name for name in own if split_of[name] == "train"}
            if not held[split] and len(in_train) > 1:
                split_of[smallest(objects[objects.isin(in_train)], split_of, "train")] = split


def smallest(objects: pd.Series, split_of: dict[str, str], donor: str) -> str:
    """The object of a split with fewest copies, the first of those in the order of the queue."""
    sizes = objects[objects.map(split_of) == donor].value_counts(sort=False)
    return str(sizes.idxmin())


def too_few(usable: pd.DataFrame, copy_of: pd.Series) -> str:
    copies = usable.loc[copy_of.duplicated(keep=False), "model_id"]
    said = f", as {', '.join(copies.head(5))} are copies of each other" if len(copies) else ""
    return (
        f"{len(usable)} models have a mask and are {copy_of.nunique()} different objects{said}; "
        "train, eval and test need one each: add meshes, or look at the status column of masks"
    )


def rotate_splits(
    masks: pd.DataFrame,
    meshes: pd.DataFrame,
    root: UPath,
    mask_settings: MaskSettings,
    split_settings: SplitSettings,
    previous: pd.DataFrame | None = None,
    progress: Callable[[str], None] = lambda message: None,
    workers: int | None = None,
) -> pd.DataFrame:
    """Every model at `rotations` random angles, rendered anew: sample_id, model_id, category,
    split, rotation, warp, content_hash, geometry, copy_of, resolution, mask, key.

    The geometry is rotated, in the image plane, rather than the pixels. A train model has `warps`
    samples besides, each warped in its own way (`warp` is its seed, and 0 for all others). A
    model's angles and warps depend on the seed and its id only. Samples of `previous` (an earlier
    result) that have not changed are not rendered again. `meshes`, `root` and `workers` are as in
    `render_masks`.
    """
    resolution = mask_settings.resolution
    usable = masks[masks["status"] == "ok"]
    other = set(usable["resolution"]) - {resolution}
    if other:
        raise TactileError(
            f"masks have resolution {min(other)} and rotated_splits should have {resolution}: "
            "give both the same resolution and materialise masks again"
        )
    identity = ["model_id", "category", "content_hash", "geometry"]
    models = split_models(masks, split_settings).merge(usable[identity])
    if copies := len(models) - models["copy_of"].nunique():
        progress(f"{copies} models are copies of others, and stand in the same split as those")
    models = models.merge(meshes.loc[meshes["status"] == "ok", [*identity, "file"]])
    if len(models) < len(usable):
        changed = min(set(usable["model_id"]) - set(models["model_id"]))
        raise TactileError(
            f"the mesh of model {changed} is gone or has changed since its mask was rendered: "
            "materialise masks again"
        )
    return rotate(models, root, mask_settings, split_settings, previous, progress, workers)


def rotate(
    models: pd.DataFrame,
    root: UPath,
    mask_settings: MaskSettings,
    split_settings: SplitSettings,
    previous: pd.DataFrame | None = None,
    progress: Callable[[str], None] = lambda message: None,
    workers: int | None = None,
) -> pd.DataFrame:
    """The samples of `models` (model_id, category, split, content_hash, file), in their order.

    What `rotate_splits` returns, for models whose split is known.
    """
    views = pd.DataFrame(
        [
            view
            for model, split in zip(models["model_id"], models["split"], strict=True)
            for view in views_of_model(model, split, split_settings)
        ]
    )
    samples = models.merge(views, on="model_id").assign(resolution=mask_settings.resolution)
    drawn = draw(samples, root, mask_settings, previous, progress, workers)
    for file, mask in zip(samples["file"], drawn, strict=True):
        if isinstance(mask, str) and mask != EMPTY:
            raise TactileError(
                f"{file} can no longer be rendered ({mask}): materialise masks again"
            )
    samples = samples.assign(
        mask=pd.Series(drawn, dtype=object), key=mask_keys(samples, mask_settings.resolution)
    )
    empty = samples["mask"] == EMPTY
    if empty.any():
        first = samples.loc[empty, "sample_id"].iloc[0]
        progress(f"{empty.sum()} samples left out: {EMPTY} (first: {first})")
    return samples.loc[~empty, COLUMNS].reset_index(drop=True)


class SampleView(NamedTuple):
    """How one sample shows its model: rotated, in degrees, and warped (see `warps`)."""

    model_id: str
    sample_id: str
    rotation: float
    warp: int


def views_of_model(model: str, split: str, settings: SplitSettings) -> Iterator[SampleView]:
    """The samples of one model, the warped ones of a train model last."""
    rotations = generator(settings.seed, model).uniform(0, 360, settings.rotations)
    for number, rotation in enumerate(rotations.tolist()):
        yield SampleView(model, f"{model}-r{number}", rotation, 0)
    if split == "train" and settings.warps:
        # Drawn in pairs: those of the first warps are the same however many follow.
        rng = generator(settings.seed, f"warps of {model}")
        pairs = rng.integers(1, 2**32, (settings.warps, 2)).tolist()
        for number, (turn, warp) in enumerate(pairs):
            yield SampleView(model, f"{model}-w{number}", 360 * turn / 2**32, warp)


def _counts(models: int, settings: SplitSettings) -> tuple[int, int]:
    """How many of a category's models go to test and to eval; at least one stays for train."""
    if models < 3:
        return 0, 0
    tests, evals = (
        max(1, math.floor(models * share + 0.5))
        for share in (settings.test_share, settings.eval_share)
    )
    # Shares are below a half: where nothing is left, each is half of an even number.
    return tests, evals - int(tests + evals >= models)
