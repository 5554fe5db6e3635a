"""Make the weights that the package ships, out of what a run has stored (see `pretrained`)."""

import hashlib
import json
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from upath import UPath

from tactile_core.checksums import sealed_json
from tactile_core.dataset.outlines import trace_outlines
from tactile_core.dataset.shapes import load_shapes
from tactile_core.evaluation.rollouts import cast_rollouts
from tactile_core.evaluation.unseen import refuse_known
from tactile_core.exploration.at_hand import ROTATED_SPLITS
from tactile_core.exploration.policies.store import describe, load_policies, trained_on
from tactile_core.exploration.pretrained import PROVENANCE, Provenance
from tactile_core.files import written_whole
from tactile_core.parquet import read_table, write_table
from tactile_core.reconstruction.trained import load_unet
from tactile_core.reconstruction.unets import INDEX
from tactile_core.settings import RolloutSettings

# Of all trainings these two: `gain`, which `recall` is made of, and the best that does not look.
POLICIES = ("gain-0", "sequence-0")
RULES = ["random", "even", "coverage"]  # what the shipped policies are measured beside
COLUMNS = ["sample_id", "model_id", "category", "split", "geometry", "mask"]


def ship(
    artifacts: UPath,
    folder: Path,
    made: Mapping[str, Any],
    progress: Callable[[str], None] = lambda message: None,
) -> Provenance:
    """Fill `folder`, in place of what is there, with what a run stored in `artifacts`.

    made : the run, as `Provenance` has it

    Raises `TactileError` where something is missing or damaged, does not belong together, or was
    trained on what it is measured on.
    """
    shutil.rmtree(folder, ignore_errors=True)
    pack(artifacts, folder)
    known = Provenance(made=dict(made), jaccard=measured(folder, progress), sha256=sums_of(folder))
    with written_whole(folder / PROVENANCE) as file:
        file.write(sealed_json(known))
    return known


def pack(artifacts: UPath, folder: Path) -> None:
    """Copy the U-Net, `POLICIES` and the splits of a run into `folder`."""
    names = ["unet", *(f"policies/{name}" for name in POLICIES)]
    for name in names:
        (folder / name).mkdir(parents=True)
        for file in sorted((artifacts / name).iterdir()):
            # Not what is for users of Stable-Baselines3, nor further U-Nets with their index.
            if file.is_file() and file.suffix != ".zip" and file.name != INDEX:
                (folder / name / file.name).write_bytes(file.read_bytes())
    versions = {name: describe(UPath(folder, "policies", name)).version for name in POLICIES}
    (folder / "policies" / "index.json").write_text(json.dumps(versions, indent=2))
    write_table(read_table(artifacts / ROTATED_SPLITS)[COLUMNS], folder / ROTATED_SPLITS)


def measured(folder: Path, progress: Callable[[str], None]) -> dict[str, list[float]]:
    """The mean Jaccard index after each of ten rays, of what lies in `folder` and of `RULES`.

    One sample of each test model is enough to see that the weights do what they should.
    """
    unet = load_unet(UPath(folder, "unet"))
    places = [UPath(folder, "policies", name) for name in POLICIES]
    policies = load_policies(places, unet.version(), unet.resolution)
    splits = read_table(folder / ROTATED_SPLITS)
    test = load_shapes(splits, trace_outlines(splits), "test")
    seen = {"unet": unet.trained_on, **trained_on(places)}
    refuse_known(test, seen, by_name=True, remedy="ship what one run has made")
    test = test.select(np.unique(test.model_ids, return_index=True)[1])
    settings = RolloutSettings(references=RULES, choices=["drawn"], ray_limit=10)
    table = cast_rollouts(policies, test, unet, settings, progress=progress)
    curves = table.pivot_table("jaccard", "policy", "ray", sort=False)
    return {str(name): curve.round(2).tolist() for name, curve in curves.iterrows()}


def sums_of(folder: Path) -> dict[str, str]:
    """The SHA-256 of every file below a folder, by its path."""
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    return {
        file.relative_to(folder).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
    }
