"""Long work keeps the memory that it frees: the system need not clear it again."""

import platform
import subprocess
import sys

import pytest

from tactile_core import freed_memory

GLIBC = sys.platform == "linux" and "glibc" in platform.libc_ver()
TENSORS, PAGES = 40, 8192  # of 32 MB each, in pages of 4 kB
# Prints how many pages the system had to clear for tensors that come and go.
COUNT = f"""
import resource, torch
from tactile_core.spread import TRAINING, handed_over

def cleared(progress):
    faults = []
    for _ in range({TENSORS}):
        torch.ones({PAGES} * 1024)
        faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
    return faults[-1] - faults[{TENSORS // 2}]  # the heap has its size by then

torch.set_num_threads(1)
"""
HERE = "print(cleared(print))"
HANDED_OVER = "print(handed_over(cleared, needs=TRAINING, progress=print))"


def pages_cleared(call: str) -> int:
    done = subprocess.run(
        [sys.executable, "-c", COUNT + call], stdout=subprocess.PIPE, check=True, text=True
    )
    return int(done.stdout)


@pytest.mark.skipif(not GLIBC, reason="other allocators are not asked")
def test_work_that_is_handed_over_finds_the_pages_of_its_last_tensor_for_the_next():
    # No number of pages: where the system has huge ones there are few in either case.
    assert 4 * pages_cleared(HANDED_OVER) < pages_cleared(HERE)


def test_where_there_is_no_glibc_nothing_is_asked_of_it(monkeypatch):
    monkeypatch.setattr(freed_memory.sys, "platform", "darwin")
    monkeypatch.setattr(freed_memory.ctypes, "CDLL", lambda name: pytest.fail("it was asked"))
    freed_memory.keep_freed_memory()
