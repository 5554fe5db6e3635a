"""Where a result was made: figures without their machine and commit say nothing."""

import os
import platform
import re
import subprocess
from pathlib import Path


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
