"""A class added to those that are there: its own models alone are rendered, split and traced."""

import numpy as np
import pandas as pd

from tactile_core.dataset.outlines import trace_outlines
from tactile_core.dataset.rendering.silhouettes import render_masks
from tactile_core.dataset.splits import rotate_splits
from tactile_core.parquet import table_hash
from tactile_core.settings import MaskSettings, SplitSettings
from tests.core.dataset.mesh_files import make_folder, obj

CLASSES = {"bottle": np.linspace(2.5, 4.5, 6), "mug": np.linspace(0.4, 1.4, 6)}
ADDED = {"aeroplane": np.linspace(7, 16, 4)}  # first in the alphabet, so the others' rows move
RENDERING = MaskSettings(resolution=64, renderer="rasteriser")
Tables = tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]


def test_an_added_class_is_all_that_is_made_anew(collect, root, tmp_path):
    def put(classes: dict[str, np.ndarray]) -> None:
        for name, heights in classes.items():
            files = {f"{number}.obj": obj(height) for number, height in enumerate(heights)}
            make_folder(tmp_path / "source" / name, files)

    def made(previous: Tables | tuple[None, None, None]) -> tuple[Tables, list[str]]:
        said: list[str] = []
        meshes = collect(classes=None)
        masks = render_masks(meshes, root, RENDERING, previous[0], said.append)
        splits = rotate_splits(
            masks, meshes, root, RENDERING, SplitSettings(), previous[1], said.append
        )
        return (masks, splits, trace_outlines(splits, previous[2], said.append)), said

    put(CLASSES)
    before, _ = made((None, None, None))
    put(ADDED)
    after, said = made(before)
    assert "4 masks rendered, 12 unchanged" in said
    assert "20 masks rendered, 60 unchanged" in said
    assert "20 outlines traced, 60 unchanged" in said
    anew, _ = made((None, None, None))
    for first, second, whole in zip(before, after, anew, strict=True):
        others = second[second["category"] != "aeroplane"].reset_index(drop=True)
        assert table_hash(others) == table_hash(first)
        assert table_hash(second) == table_hash(whole)
