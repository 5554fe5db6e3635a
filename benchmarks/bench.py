"""The table of ratios: `python -m benchmarks.bench`, or `make bench`; about five minutes.

Ours and the plain way are measured in turn, in one run on one machine, with one thread of torch
for both, as in the trainings, which run side by side, one a core (a U-Net's halves take one each).
`build/bench` receives

- bench.csv: what, ours, plain, unit, ratio, goal
- cost.csv: cost against size, as drawn in cost.png
- precision.csv: Jaccard indices in each precision that the machine has, as drawn in precision.png
- machine.json: the machine, versions, commit, date and command, and whose U-Net was compared
"""

import argparse
import json
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import torch

from benchmarks.figures import cost_figure, precision_figure
from benchmarks.machine import REPOSITORY, describe_machine
from benchmarks.memory import memory_curve
from benchmarks.precision import pair_summary, precision_pairs, precision_rows
from benchmarks.speed_elsewhere import elsewhere_rows
from benchmarks.speed_environment import environment_curves, environment_rows, ppo_rows
from benchmarks.speed_geometry import ray_rows, silhouette_rows, triangle_curve
from benchmarks.speed_unet import unet_rows
from benchmarks.timing import Curve, Pace, Row
from tactile_core.figures.style import png
from tactile_core.files import written_whole

MEASUREMENTS = (environment_rows, elsewhere_rows, ppo_rows, unet_rows, silhouette_rows, ray_rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="show that all of it runs")
    parser.add_argument("--to", type=Path, metavar="FOLDER", help="where the results are written")
    options = parser.parse_args()
    folder = options.to or REPOSITORY / "build" / "bench"
    torch.set_num_threads(1)
    warnings.simplefilter("ignore")  # a quick run fills less than one of PPO's batches
    start = time.perf_counter()
    pace = Pace(options.quick)

    rows: list[Row] = []
    for measure in MEASUREMENTS:
        print(f"{measure.__name__.replace('_rows', '')} …", flush=True)
        rows += measure(pace)
    print("precision …", flush=True)
    pairs, compared = precision_pairs(pace, print)
    rows += precision_rows(pairs)
    print("cost against size …", flush=True)
    curves = [*environment_curves(pace), triangle_curve(pace), memory_curve(pace)]

    machine = describe_machine(time.perf_counter() - start) | {"unet": compared}
    write(folder, rows, curves, pairs, machine)
    print_results(rows, curves, pairs, machine)
    print(f"\nWritten to {folder}")


def write(
    folder: Path, rows: Sequence[Row], curves: Sequence[Curve], pairs: pd.DataFrame, machine: dict
) -> None:
    """All files of the docstring above, each whole or not at all."""
    tables = {
        "bench.csv": pd.DataFrame(rows).drop(columns="met"),
        "cost.csv": cost_table(curves),
        "precision.csv": pairs,
    }
    for name, table in tables.items():
        with written_whole(folder / name) as file:
            table.to_csv(file, index=False, float_format="%.6g")
    figures = {"cost.png": cost_figure(curves), "precision.png": precision_figure(pairs)}
    for name, figure in figures.items():
        with written_whole(folder / name) as file:
            file.write(png(figure))
    with written_whole(folder / "machine.json") as file:
        file.write(json.dumps(machine, indent=2).encode())


def cost_table(curves: Sequence[Curve]) -> pd.DataFrame:
    """One row for each point of each curve."""
    points = [
        (curve.what, curve.size, size, value, curve.unit, curve.slope(), curve.last_slope())
        for curve in curves
        for size, value in zip(curve.sizes, curve.values, strict=True)
    ]
    columns = ["what", "against", "size", "value", "unit", "slope", "last_slope"]
    return pd.DataFrame(points, columns=columns)


def print_results(
    rows: Sequence[Row], curves: Sequence[Curve], pairs: pd.DataFrame, machine: dict
) -> None:
    """The tables as text."""
    print(f"\n{machine['cpu']}, {machine['cores']} cores, torch with one thread")
    verdicts = {True: "met", False: "missed", None: ""}
    print_table(pd.DataFrame(rows).assign(met=[verdicts[row.met] for row in rows]))
    print("\nCost against size: it grows with the size to the power `slope`, or `last_slope`")
    print("over the three largest; above `surprise` it would grow faster than the work there is")
    for curve in curves:
        points = zip(curve.sizes, curve.values, strict=True)
        values = ", ".join(f"{size}: {number(value)}" for size, value in points)
        print(f"  {curve.what} [{curve.unit}] against {curve.size}: {values}")
        print(
            f"    slope {curve.slope():.2f}, last_slope {curve.last_slope():.2f}, "
            f"surprise {curve.linear}"
        )
    print("\nJaccard index in points beside float32, pair by pair")
    print_table(pair_summary(pairs))


def print_table(table: pd.DataFrame) -> None:
    """Words on the left, numbers on the right."""
    words = {
        name: table[name].str.ljust(table[name].str.len().max())
        for name in table.columns
        if pd.api.types.is_string_dtype(table[name])
    }
    print(table.assign(**words).to_string(index=False, float_format=number))


def number(value: float) -> str:
    """Three digits, and no exponent."""
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


if __name__ == "__main__":
    main()
