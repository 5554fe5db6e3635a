"""Memory and time of the data set's assets against the number of models.

    python -m benchmarks.speed_size --models 1000 4000 --resolution 64

Bodies of revolution are generated in ShapeNet's layout and go through the assets one by one, each
with the plain command. It goes on where it was killed. `build/size` receives

- size.csv: resolution, models, stage, seconds, processor seconds, peak memory of all processes
  together (MB), stored (MB); as drawn in size.png
- machine.json
"""

import argparse
import json
import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.figures import size_figure
from benchmarks.machine import REPOSITORY, describe_machine
from tactile_core.figures.style import png
from tactile_core.files import written_whole

STAGES = ("shapenet_meshes", "masks", "rotated_splits", "outlines", "tactile_samples")
OPENED = "opening a training"
SYNSET = "03797390"
AROUND = 16  # faces around a body of revolution
SECONDS_BETWEEN_LOOKS = 0.5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", type=int, nargs="+", default=[1000, 4000])
    parser.add_argument("--resolution", type=int, default=64)
    parser.add_argument("--to", type=Path, metavar="FOLDER", help="where the results are written")
    options = parser.parse_args()
    folder = (options.to or REPOSITORY / "build" / "size").resolve()
    table = folder / "size.csv"
    start = time.perf_counter()
    rows = pd.read_csv(table).to_dict("records") if table.exists() else []
    for models in options.models:
        home = folder / f"home-{options.resolution}-{models}"
        source = source_of(folder / f"source-{models}", models)
        for stage in (*STAGES, OPENED):
            size = {"resolution": options.resolution, "models": models, "stage": stage}
            if any(size.items() <= row.items() for row in rows):
                continue
            rows.append(size | measured(command_of(stage, options.resolution), home, source))
            print(rows[-1], flush=True)
            with written_whole(table) as file:
                file.write(pd.DataFrame(rows).to_csv(index=False).encode())
    for name, data in {
        "size.png": png(size_figure(pd.DataFrame(rows))),
        "machine.json": json.dumps(describe_machine(time.perf_counter() - start)).encode(),
    }.items():
        with written_whole(folder / name) as file:
            file.write(data)


def source_of(folder: Path, models: int) -> Path:
    """A folder with an archive of so many different meshes, as ShapeNet has them."""
    archive = folder / f"{SYNSET}.zip"
    if not archive.exists():
        with written_whole(archive) as file, zipfile.ZipFile(file, "w") as packed:
            for number in range(models):
                name = f"{SYNSET}/{number:032x}/models/model_normalized.obj"
                packed.writestr(name, body(np.random.default_rng(number)))
    return folder


def body(rng: np.random.Generator) -> str:
    """A body of revolution about the upright axis, as OBJ."""
    heights = np.linspace(0, rng.uniform(0.6, 3), 9)
    radii = rng.uniform(0.15, 1, len(heights))
    angles = 2 * np.pi * np.arange(AROUND) / AROUND
    x, z = radii[:, None] * np.cos(angles), radii[:, None] * np.sin(angles)
    y = np.repeat(heights[:, None], AROUND, axis=1)
    lines = [f"v {a:.5f} {b:.5f} {c:.5f}" for a, b, c in np.stack([x, y, z], -1).reshape(-1, 3)]
    for ring in range(len(heights) - 1):
        for one in range(AROUND):
            other = (one + 1) % AROUND
            low, high = ring * AROUND + 1, (ring + 1) * AROUND + 1
            lines.append(f"f {low + one} {low + other} {high + other} {high + one}")
    return "\n".join(lines) + "\n"


def command_of(stage: str, resolution: int) -> list[str]:
    if stage == OPENED:
        return [sys.executable, "-m", "benchmarks.opening"]
    classes = {"classes": {"body": SYNSET}}
    fields = {
        "shapenet_meshes": classes,
        "masks": {"resolution": resolution, "renderer": "rasteriser"},
        "rotated_splits": {"renderer": "rasteriser"},
    }.get(stage)
    config = json.dumps({"ops": {stage: {"config": fields}}} if fields else {})
    return ["dagster", "asset", "materialize", "--select", stage, "--config-json", config]


def measured(command: list[str], home: Path, source: Path) -> dict[str, float]:
    """What a command takes: seconds, processor seconds, peak memory and what it stored in MB."""
    environment = os.environ | {
        "TACTILE_HOME": str(home),
        "DAGSTER_HOME": str(home / "dagster"),
        "TACTILE_SHAPENET": str(source),
        "DAGSTER_DISABLE_TELEMETRY": "yes",
    }
    (home / "dagster").mkdir(parents=True, exist_ok=True)
    before, start, peak = stored(home), time.monotonic(), 0.0
    with (home / "log").open("a") as log:
        child = subprocess.Popen(
            command, cwd=REPOSITORY, env=environment, stdout=log, stderr=log, start_new_session=True
        )
        while (ended := os.wait4(child.pid, os.WNOHANG))[0] == 0:
            peak = max(peak, memory_of_session(child.pid))
            time.sleep(SECONDS_BETWEEN_LOOKS)
    if ended[1]:
        sys.exit(f"{' '.join(command)} failed: {home / 'log'} says why")
    return {
        "seconds": round(time.monotonic() - start, 1),
        "processor_seconds": round(ended[2].ru_utime + ended[2].ru_stime, 1),
        "peak_mb": round(peak),
        "stored_mb": round(stored(home) - before, 1),
    }


def memory_of_session(session: int) -> float:
    """What the processes of a session hold together, pages that they share counted once, in MB."""
    total = 0
    for process in Path("/proc").iterdir():
        try:
            if process.name.isdigit() and os.getsid(int(process.name)) == session:
                fields = (process / "smaps_rollup").read_text()
                total += int(fields.partition("\nPss:")[2].split()[0])
        except (OSError, IndexError):  # it has just ended
            continue
    return total / 1024


def stored(home: Path) -> float:
    """What lies among the artifacts, in MB."""
    files = (home / "artifacts").rglob("*") if (home / "artifacts").exists() else []
    return sum(file.stat().st_size for file in files if file.is_file()) / 2**20


if __name__ == "__main__":
    main()
