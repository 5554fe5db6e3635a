"""What the columns of the stored tables mean, as the UI shows them: column → description."""

from collections.abc import Mapping

import dagster as dg
import pandas as pd

MODEL = {
    "model_id": "The 3D model: its name in ShapeNet or of its file; a hash where generated.",
    "category": "Class of the object.",
}
SAMPLE = {"sample_id": "The sample: a model at one rotation.", **MODEL}
GEOMETRY = {
    "content_hash": "Hash of the mesh file's bytes.",
    "geometry": "Hash of vertices and faces: the same for copies in another format.",
}
KEY = {"key": "Key of the code, settings and inputs behind the row, which is kept while it stands."}
MASK = {
    "resolution": "Height and width R of the mask, in pixels.",
    "mask": "The mask as PNG bytes, 1 where the object projects.",
    **KEY,
}
SPLIT = {"split": "train, eval or test; all rotations and copies of a model are in one."}
POLICY = {
    "policy": "Name of the policy.",
    "seed": "Seed of its training; of a rule, that of the U-Net it went with.",
}
JACCARD = {"jaccard": "Jaccard index of reconstruction and mask, 0 to 100."}
HIT_OR_MISS = {
    "missed": "Whether the ray met nothing.",
    "repeated": "Whether its touch was held already.",
}

MESHES = {
    **MODEL,
    "synset": "ShapeNet's number of the class.",
    "source": "procedural (that is, generated), archive or folder.",
    "file": "The mesh file, below the asset's folder; empty where the mesh is set aside.",
    "vertices": "Number of vertices.",
    "faces": "Number of triangles.",
    **GEOMETRY,
    "status": "ok, or why the mesh is set aside.",
}
MASKS = {**MODEL, **GEOMETRY, "status": "ok, or why there is no mask.", **MASK}
ROTATED = {
    **SAMPLE,
    **SPLIT,
    "rotation": "Angle of the rotation in the image plane, in degrees.",
    "warp": "Seed of the stretching and bending of a train model's copy; 0: as the model is.",
    **GEOMETRY,
    "copy_of": "The first of the models that this one is a copy of; itself where it is none.",
    **MASK,
}
OUTLINES = {
    **SAMPLE,
    **SPLIT,
    "outline": "Pixels (row, column) of the mask that a ray from outside can reach.",
    "mask_hash": "Hash of the mask that was traced.",
    **KEY,
}
TOUCHES = {
    **SAMPLE,
    **SPLIT,
    "set": "Number of the touch set of this sample, from 0.",
    "touches": "The touches (row, column): different pixels of the outline.",
}
TRIALS = {
    "trial": "Rank of the trial: 1 has the least loss.",
    "learning_rate": "Learning rate.",
    "batch_size": "Masks in a batch.",
    "depth": "Levels of the U-Net.",
    "channels": "Channels of its first level.",
    "epochs": "Epochs that the trial was given before HyperBand stopped it.",
    "loss": "Loss on the eval split, which trials are ranked by.",
    **JACCARD,
    **KEY,
}
PRACTICE = {
    "sample_id": SAMPLE["sample_id"],
    "sequence": "Number of the run of rays.",
    **POLICY,
    "strays": "Share of its rays (0 to 1) that any other replaced.",
    "rays": "Rays (alpha, beta): indices of the circle's pixels where each starts and ends.",
    "touches": "Where each ray met the shape (row, column); -1 where it missed.",
    **KEY,
}
RECONSTRUCTION = {
    "split": SPLIT["split"],
    "touches": "Number of touches seen; empty: the stored touch sets, as in Table II.",
    "loss": "Mean loss, as in training.",
    **JACCARD,
    "samples": "Number of touch sets that this is the mean of.",
    **KEY,
    "seed": "That of the U-Net.",
}
ROLLOUTS = {
    **POLICY,
    "choice": "rule, or how a ray was taken from a policy's distribution: likeliest or drawn.",
    **SAMPLE,
    "ray": "Number of the ray, from 1.",
    "alpha": "Index of the circle's pixel where the ray starts.",
    "beta": "Index of the circle's pixel where the ray ends.",
    "row": "Row of the touch; -1 where the ray missed.",
    "column": "Column of the touch; -1 where the ray missed.",
    **HIT_OR_MISS,
    "touches": "Number of different touches held after the ray.",
    **JACCARD,
    **KEY,
}
PER_STEP = {
    **POLICY,
    **SAMPLE,
    "step": "Number of rays cast.",
    **JACCARD,
    "touches": ROLLOUTS["touches"],
    **HIT_OR_MISS,
}
PER_GRASP = {
    **POLICY,
    **SAMPLE,
    "grasp": "Number of touches held.",
    "jaccard": f"{JACCARD['jaccard']} Empty where rays ran out before this touch.",
    "rays": "Rays cast until then.",
}


def column_schema(table: pd.DataFrame, meanings: Mapping[str, str]) -> dg.TableSchema:
    """Name, type and meaning of every column of `table`."""
    return dg.TableSchema(
        [
            dg.TableColumn(name, type=kind(column), description=meanings[name])
            for name, column in table.items()
        ]
    )


def kind(column: pd.Series) -> str:
    """The type of a column in a word: of an object column, that of its first cell."""
    if column.dtype != object or not len(column):
        return str(column.dtype)
    first = column.iloc[0]
    return "bytes" if isinstance(first, bytes) else f"array of pairs, {first.dtype}"
