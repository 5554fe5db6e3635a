"""What the code decides is made anew when the code changes, and nothing else is."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import pytest

import tactile_core

# Imports what the core needs, which takes longer than all else, and then makes things in the home
# that each line names; in a process of its own, that finds the core as it is by then.
WAITS = """
import json, os, sys
import numba, pandas, scipy.ndimage, stable_baselines3, torch, trimesh, upath
for home in sys.stdin:
    child = os.fork()
    if child == 0:
        sys.argv[1:] = [home.strip()]
        exec(os.environ["MAKES"])
        sys.stdout.flush()
        os._exit(0)
    print(json.dumps({"failed": os.waitpid(child, 0)[1]}), flush=True)
"""
# What is made, by which code it is decided, and a change there that a reader would call one.
MAKES = """
import json, sys
import numpy as np
import pandas as pd
from pathlib import Path
from upath import UPath
from tactile_core.dataset.outlines import trace_outlines
from tactile_core.dataset.shapes import load_shapes
from tactile_core.dataset.meshes import collect_meshes
from tactile_core.dataset.rendering.silhouettes import render_masks
from tactile_core.dataset.splits import rotate_splits
from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.learning.train import train_policy
from tactile_core.parquet import read_table, write_table
from tactile_core.reconstruction.trained import load_unet, save_unet
from tactile_core.reconstruction.training import train_unet
from tactile_core.reconstruction.batches import outline_source
from tactile_core.reconstruction.trial import trial_key
from tactile_core.settings import (
    MaskSettings, MeshSettings, PolicySettings, SearchSettings, SplitSettings, UNetSettings,
)

home = Path(sys.argv[1])
said = []
root = UPath(home / "meshes")
drawing = MaskSettings(resolution=48, renderer="rasteriser")
def earlier(name):
    return read_table(home / name) if (home / name).exists() else None
meshes = MeshSettings(procedural_models={"mug": 3, "bottle": 3})
manifest = collect_meshes(meshes, root, home / "cache")
masks = render_masks(manifest, root, drawing, earlier("masks"), said.append, workers=1)
write_table(masks, home / "masks")
splits = rotate_splits(
    masks, manifest, root, drawing, SplitSettings(rotations=1), earlier("splits"), said.append, 1
)
write_table(splits, home / "splits")
rendered = [int(line.split()[0]) for line in said if "masks rendered" in line]
outlines = trace_outlines(splits)
train, eval_shapes = (load_shapes(splits, outlines, split) for split in ("train", "eval"))

class Cut(Exception):
    pass

def cut_after(word):
    def progress(message):
        said.append(message)
        if word in message:
            raise Cut
    return progress

net = UNetSettings(learning_rate=1e-2, batch_size=4, depth=2, channels=2, epochs=2, patience=9)
said.clear()
try:
    train_unet(train, eval_shapes, net, work=home / "unet", progress=cut_after("epoch 2/2"))
except Cut:
    pass
unet_resumed = any("resuming" in line for line in said)
if not (home / "kept" / "settings.json").exists():
    save_unet(train_unet(train, eval_shapes, net, work=home / "other"), UPath(home / "kept"))
quick = PolicySettings(
    steps_per_stage=128, environments=4, rays_per_rollout=32, batch_size=32, epochs=1,
    gain_iterations=2, gain_states=4, gain_tries=2, gain_updates=1,
)
kept = {}
for name in ("total", "gain"):
    said.clear()
    train_policy(
        find_approach(name), 0, train, load_unet(UPath(home / "kept")), quick,
        directory=UPath(home / name), work=home / "work" / name, progress=said.append,
    )
    kept[name] = any("kept" in line for line in said)
key = trial_key({"depth": 2}, train, eval_shapes, SearchSettings(), outline_source(train))
print(json.dumps({"masks": rendered[0], "rotated": rendered[1], "unet": unet_resumed, **kept,
                  "trial": key}))
"""


@pytest.fixture(scope="module")
def core(tmp_path_factory) -> Path:
    """A copy of the core whose files may be changed."""
    folder = tmp_path_factory.mktemp("copy")
    shutil.copytree(Path(tactile_core.__file__).parent, folder / "tactile_core")
    return folder / "tactile_core"


@pytest.fixture(scope="module")
def made(core, tmp_path_factory) -> Iterator:
    """Everything made once, and a way to make it again in a copy of that home."""
    home = tmp_path_factory.mktemp("made")
    environment = {
        **os.environ, "PYTHONPATH": str(core.parent), "PYTHONDONTWRITEBYTECODE": "1",
        "MAKES": MAKES,
    }  # fmt: skip
    with subprocess.Popen(
        [sys.executable, "-c", WAITS],
        cwd=home, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdin is not None and process.stdout is not None
        first = make(home, process.stdin, process.stdout)
        assert (first["masks"], first["rotated"]) == (6, 6)

        def again(folder: Path) -> dict:
            shutil.copytree(home, folder)
            found = make(folder, process.stdin, process.stdout)
            return {**found, "trial": found["trial"] == first["trial"]}

        yield again
        process.stdin.close()


def make(folder: Path, asks: IO[str], said: IO[str]) -> dict:
    print(folder, file=asks, flush=True)
    lines = [json.loads(said.readline())]
    while "failed" not in lines[-1]:
        lines.append(json.loads(said.readline()))
    assert not lines[-1]["failed"]  # the reason stands on its standard error
    return lines[-2]


REUSED = {"masks": 0, "rotated": 0, "unet": True, "total": True, "gain": True, "trial": True}
CHANGES = {
    "pictures": ("figures/style.py", "import", "X = 1\nimport", {}),
    # Where the camera looks: other masks, and with them all that was learnt from the old ones.
    "camera": (
        "dataset/rendering/camera.py", "(z - x)", "(z + x)",
        {"masks": 6, "rotated": 6, "unet": False, "total": False, "gain": False, "trial": False},
    ),
    "training": (
        "reconstruction/epoch.py", "weight_decay=1e-4", "weight_decay=1e-3",
        {"unet": False, "trial": False},
    ),
    "ppo": ("exploration/learning/ppo.py", "ent_coef=settings.entropy", "ent_coef=0.5",
            {"total": False, "gain": False}),
    "trial": ("reconstruction/trial.py", "*curve, {", "*curve[:], {", {"trial": False}),
    "one more approach": (
        "exploration/learning/approaches.py", "    for approach in (\n",
        "    for approach in (\n        Approach(\"own\", \"Any.\", (DIFF,)),\n", {},
    ),
    "another reward": (
        "exploration/learning/approaches.py", "            (TOTAL,),", "            (DIFF,),",
        {"total": False},
    ),
}  # fmt: skip


@pytest.mark.parametrize("change", CHANGES)
def test_what_the_code_decides_is_made_anew_when_the_code_changes(core, made, tmp_path, change):
    file, old, new, expected = CHANGES[change]
    text = (core / file).read_text()
    assert old in text
    (core / file).write_text(text.replace(old, new, 1))
    try:
        assert made(tmp_path / "home") == REUSED | expected
    finally:
        (core / file).write_text(text)
