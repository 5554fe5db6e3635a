"""Real meshes to test on: rendered and rotated like those of the data set, and not split."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd
from upath import UPath

from tactile_core.dataset.copies import find_copies
from tactile_core.dataset.meshes import collect_meshes
from tactile_core.dataset.rendering.silhouettes import render_masks
from tactile_core.dataset.splits import rotate
from tactile_core.settings import MaskSettings, MeshSettings, SplitSettings


def render_real(
    mesh_settings: MeshSettings,
    mask_settings: MaskSettings,
    split_settings: SplitSettings,
    root: UPath,
    cache: Path,
    previous: pd.DataFrame | None = None,
    progress: Callable[[str], None] = lambda message: None,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Every usable mesh at its random rotations, and the meshes that were set aside.

    root, cache : where the meshes and downloaded archives are kept, as in `collect_meshes`
    previous : the samples of an earlier run; those that have not changed are not rotated and
        rendered again. Meshes as they stand are rendered each time, to see which are usable

    The samples have the columns of `rotate_splits`, and "test" for their split: however few
    there are, nothing is trained on them. A mesh may be set aside when it is read or when its
    mask is drawn: model_id, category and status, which is the reason.
    """
    manifest = collect_meshes(mesh_settings, root, cache, progress)
    masks = render_masks(manifest, root, mask_settings, progress=progress)
    looked_at = pd.concat([manifest, masks])[["model_id", "category", "status"]]
    files = manifest[["model_id", "file"]]
    usable = masks[masks["status"] == "ok"]
    usable = usable.assign(copy_of=find_copies(usable), split="test")
    models = usable.drop(columns=["mask", "key"]).merge(files)
    samples = rotate(models, root, mask_settings, split_settings, previous, progress)
    aside = looked_at[looked_at["status"] != "ok"].reset_index(drop=True)
    aside.attrs = manifest.attrs
    return samples, aside
