"""How long PPO takes in the profile `report`: `python -m benchmarks.speed_report 64 256`.

On one thread and with freed memory kept, as each training has it, and with an untrained U-Net of
the laptop's size. For each resolution: an update for one minibatch, a ray, and the hours that a
stage takes of both.
"""

import argparse
import time

import pandas as pd

from benchmarks.machine import processor
from benchmarks.speed_environment import batched_env
from tactile_core.exploration.learning.ppo import new_model
from tactile_core.freed_memory import keep_freed_memory
from tactile_core.profiles import PROFILES
from tactile_core.threads import one_thread

REPORT = PROFILES["report"].policies
ROLLOUT = REPORT.environments * REPORT.rays_per_rollout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("resolutions", type=int, nargs="+")
    keep_freed_memory()
    with one_thread():
        rows = [measured(resolution) for resolution in parser.parse_args().resolutions]
    print(processor())
    print(pd.DataFrame(rows).round(2).to_string(index=False))


def measured(resolution: int) -> dict[str, float]:
    """A rollout and one pass over it, after one of each to warm up."""
    env = batched_env(REPORT.environments, REPORT.reward_scale, resolution)
    model = new_model(env, REPORT.model_copy(update={"epochs": 1}), seed=0)
    model.learn(ROLLOUT)
    began = time.perf_counter()
    model.train()
    update = (time.perf_counter() - began) * REPORT.batch_size / ROLLOUT
    began = time.perf_counter()
    model.learn(ROLLOUT, reset_num_timesteps=False)  # a rollout, and a pass over it as before
    ray = (time.perf_counter() - began) / ROLLOUT - update / REPORT.batch_size
    rays = REPORT.steps_per_stage
    updates = rays * REPORT.epochs / REPORT.batch_size
    return {
        "resolution": resolution,
        "update, ms": 1000 * update,
        "ray, ms": 1000 * ray,
        "hours a stage": (updates * update + rays * ray) / 3600,
    }


if __name__ == "__main__":
    main()
