"""Memory and time of the data set's assets against the number of models.

    python -m benchmarks.speed_size --models 1000 4000 --resolution 64 --times 13

Bodies of revolution are generated in ShapeNet's layout and go through the assets one by one, with
their checks, each in a process of its own; and a training is opened on them, up to its first batch.
`--times` repeats the rotated masks of the last size, moved by some pixels, so that what comes after
them is measured on more than there is time to render. It goes on where it was killed.

`build/size` receives

- size.csv: resolution, models, stage, seconds, processor seconds, peak memory of all processes
  together (MB), stored (MB); as drawn in size.png
- machine.json
"""

import argparse
import gc
import json
import os
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ["TACTILE_PROFILE"] = "smoke"  # whose sizes are replaced below; read at the first import

import numpy as np
import pandas as pd

from tactile_core.files import written_whole

REPOSITORY = Path(__file__).resolve().parents[1]
SYNSET = "03797390"
AROUND = 16  # faces around a body of revolution
SECONDS_BETWEEN_LOOKS = 0.5
STAGES = ("shapenet_meshes", "masks", "rotated_splits", "outlines", "tactile_samples")
OPENED = "opening a training"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", type=int, nargs="+", default=[1000, 4000])
    parser.add_argument("--resolution", type=int, default=64)
    parser.add_argument("--times", type=int, help="repeat the last size's masks so often")
    parser.add_argument("--to", type=Path, metavar="FOLDER", help="where the results are written")
    options = parser.parse_args()
    folder = (options.to or REPOSITORY / "build" / "size").resolve()
    table = folder / "size.csv"
    import tactile_core.exploration.practice.ray_touches  # noqa: F401
    from benchmarks.figures import size_figure
    from benchmarks.machine import describe_machine
    from tactile_core.figures.style import png

    start = time.perf_counter()
    rows = pd.read_csv(table).to_dict("records") if table.exists() else []
    sizes: list[tuple[int, tuple[str, ...]]] = [(n, (*STAGES, OPENED)) for n in options.models]
    if options.times:
        sizes.append((options.models[-1] * options.times, (*STAGES[3:], OPENED)))
    for models, stages in sizes:
        home = folder / f"home-{options.resolution}-{models}"
        if stages[0] not in STAGES[:3]:
            few = folder / f"home-{options.resolution}-{options.models[-1]}"
            repeat(few, home, options.times)
        source = folder / f"source-{models}"
        for stage in stages:
            size = {"resolution": options.resolution, "models": models, "stage": stage}
            if any(size.items() <= row.items() for row in rows):
                continue
            if stage == STAGES[0]:
                make_source(source, models)
            work = work_of(stage, options.resolution, home, source)
            rows.append(size | measured(work, home))
            print(rows[-1], flush=True)
            with written_whole(table) as file:
                file.write(pd.DataFrame(rows).to_csv(index=False).encode())
    for name, data in {
        "size.png": png(size_figure(pd.DataFrame(rows))),
        "machine.json": json.dumps(describe_machine(time.perf_counter() - start)).encode(),
    }.items():
        with written_whole(folder / name) as file:
            file.write(data)


def make_source(folder: Path, models: int) -> None:
    """A folder with an archive of so many different meshes, as ShapeNet has them."""
    archive = folder / f"{SYNSET}.zip"
    if not archive.exists():
        with written_whole(archive) as file, zipfile.ZipFile(file, "w") as packed:
            for number in range(models):
                name = f"{SYNSET}/{number:032x}/models/model_normalized.obj"
                packed.writestr(name, body(np.random.default_rng(number)))


def repeat(few: Path, many: Path, times: int) -> None:
    """The rotated masks of one home `times` over in another, each time moved by other pixels."""
    from tactile_core.dataset.rendering.pictures import decoded, encode_mask
    from tactile_core.parquet import read_table, write_table

    target = many / "artifacts" / "rotated_splits.parquet"
    if target.exists():
        return
    table = read_table(few / "artifacts" / "rotated_splits.parquet")
    copies = []
    for number in range(times):
        masks = [
            encode_mask(moved(mask, *divmod(number, 4)))
            for some in decoded(table["mask"])
            for mask in some
        ]
        names = {
            name: table[name] + f"-{number}"
            for name in ("sample_id", "model_id", "copy_of", "content_hash", "geometry")
        }
        copies.append(table.assign(**names, mask=pd.Series(masks, dtype=object)))
    write_table(pd.concat(copies, ignore_index=True), target)


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


def moved(mask: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """A mask (R, R) some pixels further, where it keeps within the middle half."""
    inside = slice(len(mask) // 4, len(mask) - len(mask) // 4)
    other = np.zeros_like(mask)
    other[inside, inside] = np.roll(mask, (rows, columns), axis=(0, 1))[inside, inside]
    return other


def work_of(stage: str, resolution: int, home: Path, source: Path) -> Callable[[], None]:
    if stage == OPENED:
        return lambda: open_training(home / "artifacts")
    fields: dict[str, Any] = {
        "shapenet_meshes": {"classes": {"body": SYNSET}, "location": str(source)},
        "masks": {"resolution": resolution, "renderer": "rasteriser"},
        "rotated_splits": {"rotations": 5, "renderer": "rasteriser"},
        "outlines": {},
        "tactile_samples": {"sets_per_mask": 5},
    }
    return lambda: materialise(stage, fields[stage], home)


def materialise(asset: str, fields: dict[str, Any], home: Path) -> None:
    """One asset with its checks, as Dagster does it."""
    import dagster as dg

    from tactile_assets import definitions
    from tactile_assets.resources import Store

    defs: Any = definitions.defs
    store = Store(home=str(home), artifacts=str(home / "artifacts"))
    dg.materialize(
        [*defs.assets, *defs.asset_checks],
        selection=dg.AssetSelection.assets(asset),
        resources={**defs.resources, "store": store},
        run_config={"ops": {asset: {"config": fields}}} if fields else {},
    )


def open_training(artifacts: Path) -> None:
    """As the asset `unet` does, with the stored touches."""
    from tactile_core.dataset.shapes import load_shapes
    from tactile_core.exploration.practice.ray_touches import touch_source
    from tactile_core.parquet import read_table
    from tactile_core.reconstruction.batches import training_batches

    splits, outlines, samples = (
        read_table(artifacts / f"{name}.parquet")
        for name in ("rotated_splits", "outlines", "tactile_samples")
    )
    train, eval_shapes = (load_shapes(splits, outlines, split) for split in ("train", "eval"))
    touches = touch_source("stored", train, samples, seed=0)
    assert len({train.version, eval_shapes.version, touches.key}) == 3  # as the key of a training
    next(training_batches(train, 32, np.random.default_rng(0), touches.draw))


def measured(work: Callable[[], None], home: Path) -> dict[str, float]:
    """What some work takes: seconds, processor seconds, peak memory and what it stored in MB."""
    home.mkdir(parents=True, exist_ok=True)
    gc.freeze()
    before, start, peak = stored(home), time.monotonic(), 0.0
    child = os.fork()
    if child == 0:
        os.setsid()
        try:
            log = os.open(home / "log", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
            os.dup2(log, 1)
            os.dup2(log, 2)
            work()
        except BaseException:  # a process that was forked goes no further
            import traceback

            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    while (ended := os.wait4(child, os.WNOHANG))[0] == 0:
        peak = max(peak, memory_of_session(child))
        time.sleep(SECONDS_BETWEEN_LOOKS)
    if ended[1]:
        sys.exit(f"it failed: {home / 'log'} says why")
    return {
        "seconds": round(time.monotonic() - start, 1),
        "processor_seconds": round(ended[2].ru_utime + ended[2].ru_stime, 1),
        # On a busy machine the look at the peak may come too late; of this process it is known.
        "peak_mb": round(max(peak, ended[2].ru_maxrss / 1024)),
        "stored_mb": round(stored(home) - before, 1),
    }


def memory_of_session(session: int) -> float:
    """What the processes of a session hold, in MB; pages that they share count for each."""
    total = 0
    for process in Path("/proc").iterdir():
        try:
            if process.name.isdigit() and os.getsid(int(process.name)) == session:
                fields = (process / "smaps_rollup").read_text()
                total += int(fields.partition("\nRss:")[2].split()[0])
        except (OSError, IndexError):  # it has just ended
            continue
    return total / 1024


def stored(home: Path) -> float:
    """What lies among the artifacts, in MB."""
    files = (home / "artifacts").rglob("*") if (home / "artifacts").exists() else []
    return sum(file.stat().st_size for file in files if file.is_file()) / 2**20


if __name__ == "__main__":
    main()
