"""The benchmark, quickly: what it says about speed is not asserted here."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from tactile_core.reconstruction.inference import bfloat16_pays

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The folder that a quick run of the benchmark writes, and what it prints."""
    folder = tmp_path_factory.mktemp("bench")
    command = [sys.executable, "-m", "benchmarks.bench", "--quick", "--to", str(folder)]
    run = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return folder, run.stdout


def test_every_row_has_a_finite_ratio_and_is_printed(results):
    folder, printed = results
    table = pd.read_csv(folder / "bench.csv")
    assert list(table.columns) == ["what", "ours", "plain", "unit", "ratio", "goal"]
    assert len(table) >= 10
    assert all(what in printed for what in table["what"])
    measured = table[~table["what"].str.contains("not measured")]
    assert len(measured) >= 9
    numbers = measured[["ours", "plain", "ratio"]].to_numpy()
    assert np.isfinite(numbers).all()
    assert (numbers > 0).all()


def test_cost_against_size_is_measured_at_growing_sizes_with_a_finite_slope(results):
    folder, printed = results
    cost = pd.read_csv(folder / "cost.csv")
    assert set(cost["against"]) == {"environments", "resolution", "triangles"}
    for what, points in cost.groupby("what"):
        assert what in printed
        assert points["size"].is_monotonic_increasing
        assert points["size"].is_unique
        assert (points["value"] > 0).all()
    assert np.isfinite(cost[["slope", "last_slope"]].to_numpy()).all()


def test_all_precisions_reconstruct_the_same_touches(results):
    folder, _ = results
    pairs = pd.read_csv(folder / "precision.csv")
    assert set(pairs["touches"]) == {"sets of 1 to 10 touches", "touches of 1 to 10 rays"}
    rough = {"bfloat16"} if bfloat16_pays("cpu") else set()
    assert set(pairs) == {"touches", "float32", "int8"} | rough
    scores = pairs.drop(columns="touches")
    assert scores.stack().between(0, 100).all()
    assert scores.corr()["float32"].min() > 0.95


def test_the_machine_is_described_and_figures_are_drawn(results):
    folder, _ = results
    machine = json.loads((folder / "machine.json").read_text())
    assert {"cpu", "cores", "memory_gib", "python", "torch", "commit", "date"} <= machine.keys()
    assert machine["command"].startswith("python -m benchmarks.bench --quick")
    for name in ("cost.png", "precision.png"):
        with Image.open(folder / name) as picture:
            assert picture.width == 800
