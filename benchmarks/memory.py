"""Peak memory of a PPO training against the number of environments.

Each is measured in a process of its own: `python -m benchmarks.memory 32`.
"""

import json
import resource
import subprocess
import sys
import warnings
from pathlib import Path

from benchmarks.timing import Curve, Pace

ENVIRONMENTS = (4, 16, 64, 256)


def memory_curve(pace: Pace) -> Curve:
    """Peak memory of two rollouts with their updates; the cost is what they add to the imports."""
    counts = pace.some(ENVIRONMENTS)
    before, peaks = zip(*(measured(count) for count in counts), strict=True)
    added = [peak - idle for peak, idle in zip(peaks, before, strict=True)]
    return Curve("peak memory of a PPO training", "environments", counts, peaks, "MB", added)


def measured(environments: int) -> tuple[float, float]:
    """MB before the environments were made, and at the peak."""
    command = [sys.executable, "-m", "benchmarks.memory", str(environments)]
    child = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True)
    before, peak = json.loads(child.stdout)
    return before, peak


def train(environments: int) -> tuple[float, float]:
    import torch

    from benchmarks.samples import masks
    from benchmarks.speed_environment import LAPTOP, batched_env
    from tactile_core.exploration.learning.ppo import new_model

    torch.set_num_threads(1)
    masks()
    before = peak_memory()
    env = batched_env(environments, LAPTOP.reward_scale)
    model = new_model(env, LAPTOP, seed=0)
    model.learn(2 * LAPTOP.rays_per_rollout * environments)
    return before, peak_memory()


def peak_memory() -> float:
    """The most memory that this process has held so far, in MB."""
    status = Path("/proc/self/status")
    if status.exists():  # ru_maxrss would begin with what the parent process held
        fields = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return int(fields["VmHWM"].split()[0]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # macOS counts bytes


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # few environments fill less than one of PPO's batches
    print(json.dumps(train(int(sys.argv[1]))))
