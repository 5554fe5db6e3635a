"""Where a result was made: figures without their machine and commit say nothing."""

import math
import os
import platform
import re
import subprocess
from pathlib import Path


def processors() -> int:
    """How many processors this process may use: of the machine, of its affinity, of its cgroup."""
    try:
        allowed = len(os.sched_getaffinity(0))
    except AttributeError:  # macOS
        allowed = os.cpu_count() or 1
    return max(1, math.ceil(min(allowed, cgroup_processors(Path("/sys/fs/cgroup")))))


def cgroup_processors(root: Path) -> float:
    """How much time, in processors, the cgroup of a container gives; infinite without."""
    version_2, version_1 = ["cpu.max"], ["cpu/cpu.cfs_quota_us", "cpu/cpu.cfs_period_us"]
    for files in (version_2, version_1):
        try:
            words = [word for file in files for word in (root / file).read_text().split()]
            quota, period = map(int, words)
        except (OSError, ValueError):  # no such file, or "max"
            continue
        if quota > 0 and period > 0:
            return quota / period
    return math.inf


def has_gpu() -> bool:
    """Whether this machine has an NVIDIA GPU that is not hidden; PyTorch takes seconds to tell."""
    hidden = os.environ.get("CUDA_VISIBLE_DEVICES") in ("", "-1")
    return not hidden and any(Path("/dev").glob("nvidia[0-9]*"))


def processor() -> str:
    """The processor's name, with family and model, since virtual machines often hide the name."""
    cpuinfo = Path("/proc/cpuinfo")
    if not cpuinfo.exists():
        return platform.processor() or platform.machine()
    fields = dict(
        re.findall(r"^(model name|cpu family|model)\s*: (.*)$", cpuinfo.read_text(), re.M)
    )
    if "model name" not in fields:
        return platform.machine()
    return f"{fields['model name']} (family {fields['cpu family']}, model {fields['model']})"


def memory_gib() -> float:
    """The machine's memory in GiB."""
    return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1)


def commit(checkout: Path) -> str | None:
    """The commit of a checkout (12 digits), marked where files differ from it; None outside one."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    result = subprocess.run(command, cwd=checkout, capture_output=True, text=True, check=False)
    return result.stdout.strip() or None


if __name__ == "__main__":
    print(processors())
