"""The shapes of one split as arrays: what training and evaluation work on."""

import functools
from dataclasses import dataclass

import numpy as np
import pandas as pd

from tactile_core.dataset.packed import PackedMasks, pack_pictures
from tactile_core.dataset.rendering.pictures import portions
from tactile_core.errors import TactileError
from tactile_core.files import content_hash

SPLITS = ("train", "eval", "test")


@dataclass(frozen=True)
class Shapes:
    """N rotated masks of one split with their outlines.

    packed : the masks, unpacked where they are indexed
    outlines : list of N arrays (K_i, 2) int16, outline pixels as (row, column)
    sample_ids, model_ids, categories, geometries : (N,) str arrays, see `geometry_hash`
    """

    packed: PackedMasks
    outlines: list[np.ndarray]
    sample_ids: np.ndarray
    model_ids: np.ndarray
    categories: np.ndarray
    geometries: np.ndarray

    def __len__(self) -> int:
        return len(self.packed)

    @property
    def resolution(self) -> int:
        return self.packed.resolution

    @property
    def masks(self) -> np.ndarray:
        """All masks at once, (N, R, R) bool: where there may be many, take some of `packed`."""
        return self.packed[:]

    @functools.cached_property
    def version(self) -> str:
        """Hash of all that these shapes are (16 hex digits)."""
        of_portions = [
            content_hash(
                np.packbits(self.packed[some]).tobytes(),
                *(outline.tobytes() for outline in self.outlines[some]),
            )
            for some in portions(len(self))
        ]
        return content_hash(
            self.packed.shape,
            of_portions,
            self.sample_ids.tolist(),
            self.model_ids.tolist(),
            self.categories.tolist(),
            self.geometries.tolist(),
        )

    def select(self, indices: np.ndarray) -> "Shapes":
        """The shapes at `indices`, in that order."""
        return Shapes(
            packed=self.packed.select(indices),
            outlines=[self.outlines[index] for index in indices],
            sample_ids=self.sample_ids[indices],
            model_ids=self.model_ids[indices],
            categories=self.categories[indices],
            geometries=self.geometries[indices],
        )

    def models(self) -> pd.DataFrame:
        """The models that these shapes are of, each once: model_id, geometry."""
        table = pd.DataFrame({"model_id": self.model_ids, "geometry": self.geometries})
        return table.drop_duplicates("model_id", ignore_index=True)


def load_shapes(rotated_splits: pd.DataFrame, outlines: pd.DataFrame, split: str) -> Shapes:
    """The shapes of `split` ("train", "eval" or "test"), in the order of `rotated_splits`.

    Raises `TactileError` where the split is empty, or a sample has no outline or another mask's.
    """
    rows = rotated_splits[rotated_splits["split"] == split]
    if rows.empty:
        raise TactileError(f"the {split} split is empty: rotated_splits has too few models")
    by_sample = outlines.set_index("sample_id")["outline"]
    missing = set(rows["sample_id"]) - set(by_sample.index)
    if missing:
        raise TactileError(
            f"{len(missing)} samples have no outline (first: {min(missing)}): "
            "materialise outlines again"
        )
    of_masks = outlines.set_index("sample_id")["mask_hash"].reindex(rows["sample_id"])
    others = of_masks.to_numpy() != rows["mask"].map(content_hash).to_numpy()
    if others.any():
        raise TactileError(
            f"{others.sum()} outlines are those of other masks (first: "
            f"{rows['sample_id'].iloc[int(others.argmax())]}): materialise outlines again"
        )
    return Shapes(
        packed=pack_pictures(rows["mask"]),
        outlines=[as_points(by_sample[sample]) for sample in rows["sample_id"]],
        sample_ids=rows["sample_id"].to_numpy(dtype=str),
        model_ids=rows["model_id"].to_numpy(dtype=str),
        categories=rows["category"].to_numpy(dtype=str),
        geometries=rows["geometry"].to_numpy(dtype=str),
    )


def as_points(cell: np.ndarray) -> np.ndarray:
    """A table cell that holds (row, column) pairs as a (K, 2) int16 array.

    `read_table` gives such arrays already; pandas by itself gives an array of pairs.
    """
    if isinstance(cell, np.ndarray) and cell.ndim == 2:
        return cell.astype(np.int16, copy=False)
    return np.array([tuple(point) for point in cell], dtype=np.int16).reshape(-1, 2)
