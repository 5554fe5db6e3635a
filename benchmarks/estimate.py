"""What the profile `paper` takes on all of ShapeNet, worked out from what `speed_size` measured.

    python -m benchmarks.estimate docs/results/size/size.csv

The data set's part is measured on this machine and extended along a line. The nets' part counts
the multiplications of the profile's own settings; how many a GPU does in a second is assumed, and
said. It prints the tables of docs/scale.md.
"""

import sys
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd
import torch
from torch.utils.flop_counter import FlopCounterMode

from tactile_core.evaluation.tables import markdown_table
from tactile_core.exploration.learning.approaches import APPROACHES
from tactile_core.profiles import PROFILES
from tactile_core.progress import duration
from tactile_core.reconstruction.unet import UNet

PAPER = PROFILES["paper"]
MODELS = 51_300
RESOLUTION = PAPER.masks.resolution
GPU_FLOPS = 3e14  # a second: a third of what an H100's data sheet says of bfloat16
DOLLARS_AN_HOUR = {"one GPU machine": 3.0, "eight such": 24.0}
EPOCHS = 60  # of at most 200: early stopping ends it; an assumption
NET = (6, 128)  # depth and channels that the report's search chose
TOUCHES_TRIED = 100  # by the oracle at each ray: different new touches of its 396 rays, about
# By `recall`: different touches of what it tries, over ten rays on three test shapes of the profile
# `report`; for the first two rays, which many shapes share, none are counted.
TOUCHES_OF_RECALL = 200


class Work(NamedTuple):
    what: str
    images: float  # that pass a net forward; one that is learnt from counts as three
    gflop: float  # of one image


def main() -> None:
    sizes = pd.read_csv(sys.argv[1])
    data = data_set(sizes)
    print(markdown_table(data.map(str)))
    nets = pd.DataFrame(gpu_rows(list(net_work())))
    print(markdown_table(nets.map(str)))
    hours = sum(work.images * work.gflop * 1e9 for work in net_work()) / GPU_FLOPS / 3600
    for machine, dollars in DOLLARS_AN_HOUR.items():
        gpus = dollars / DOLLARS_AN_HOUR["one GPU machine"]
        print(f"{machine}: {duration(3600 * hours / gpus)}, {hours * 3:,.0f} dollars")


def data_set(sizes: pd.DataFrame) -> pd.DataFrame:
    """For each stage: processor time, peak memory and storage at ShapeNet's size.

    What a stage takes before its first model is where the line through the smaller resolution's
    two largest sizes begins; the rest of what was measured at the profile's grows with the models,
    and no slower than that line.
    """
    rows = []
    for stage, measured in sizes.groupby("stage", sort=False):
        at = measured[measured["resolution"] == RESOLUTION].tail(1)
        small = measured[measured["resolution"] < RESOLUTION].sort_values("models").tail(2)
        if at.empty:
            continue

        def extended(name: str, at: pd.DataFrame = at, small: pd.DataFrame = small) -> float:
            slope, begun = np.polyfit(small["models"], small[name], 1)
            begun = max(0.0, begun)
            each = (float(at[name].iloc[0]) - begun) / int(at["models"].iloc[0])
            return float(begun + max(slope, each) * MODELS)

        rows.append(
            {
                "asset": stage,
                "processor time": duration(extended("processor_seconds")),
                "peak memory": f"{extended('peak_mb') / 1024:.1f} GiB",
                "stored": f"{extended('stored_mb') / 1024:.2f} GiB",
            }
        )
    return pd.DataFrame(rows)


def net_work() -> Iterator[Work]:
    """What the nets of the profile have to do."""
    splits, search, policies = PAPER.splits, PAPER.search, PAPER.policies
    samples = MODELS * splits.rotations
    train = samples * (1 - splits.eval_share - splits.test_share)
    test = samples * splits.test_share
    tried = np.mean([gflop(d, c) for d in search.depths for c in search.channels])
    # HyperBand gives one trial in four all its epochs, and the others about a quarter of them.
    epochs = search.trials * search.epochs * (0.25 + 0.75 * 0.25)
    yield Work("unet_search", 3 * train * epochs, float(tried))
    yield Work("unet", 3 * train * EPOCHS, gflop(*NET))
    stages = sum(len(approach.stages) for approach in APPROACHES.values())
    rays = stages * policies.steps_per_stage * len(policies.seeds)
    states = policies.gain_iterations * policies.gain_states * len(policies.seeds)
    yield Work("policies", rays + states * (1 + policies.gain_tries), gflop(*NET))
    trained = (len(APPROACHES) + 1) * len(policies.seeds) * len(PAPER.rollouts.choices)
    cast = test * PAPER.rollouts.count * (4 + 2 * trained)
    yield Work("other rollouts", cast, gflop(*NET))
    recalled = test * PAPER.rollouts.count * TOUCHES_OF_RECALL * len(policies.seeds)
    yield Work("the rollouts of recall", recalled, gflop(*NET))
    oracle = test * PAPER.rollouts.count * TOUCHES_TRIED
    yield Work("the rollouts of the oracle", oracle, gflop(*NET))


def gflop(depth: int, channels: int) -> float:
    """Multiplications and additions of one image of the profile through a U-Net, in billions."""
    with torch.device("meta"), FlopCounterMode(display=False) as counter:
        UNet(depth, channels)(torch.zeros(1, 1, RESOLUTION, RESOLUTION))
    return counter.get_total_flops() / 1e9


def gpu_rows(works: list[Work]) -> Iterator[dict[str, str]]:
    for work in works:
        yield {
            "work": work.what,
            "images": f"{work.images:.2e}",
            "GFLOP each": f"{work.gflop:.0f}",
            "on one GPU": duration(work.images * work.gflop * 1e9 / GPU_FLOPS),
        }


if __name__ == "__main__":
    main()
