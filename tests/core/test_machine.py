"""How many processors a process may use."""

import math
import os
import subprocess
import sys

import pytest

from tactile_core.machine import cgroup_processors, processors


@pytest.mark.parametrize(
    ("text", "expected"),
    [("150000 100000\n", 1.5), ("max 100000\n", math.inf), ("", math.inf), ("0 0", math.inf)],
)
def test_a_container_of_version_2_counts_by_its_quota(tmp_path, text, expected):
    (tmp_path / "cpu.max").write_text(text)
    assert cgroup_processors(tmp_path) == expected


@pytest.mark.parametrize(("quota", "expected"), [("50000", 0.5), ("-1", math.inf)])
def test_a_container_of_version_1_counts_by_its_quota(tmp_path, quota, expected):
    (tmp_path / "cpu").mkdir()
    (tmp_path / "cpu" / "cpu.cfs_quota_us").write_text(quota)
    (tmp_path / "cpu" / "cpu.cfs_period_us").write_text("100000")
    assert cgroup_processors(tmp_path) == expected


def test_without_a_container_there_is_no_limit(tmp_path):
    assert cgroup_processors(tmp_path / "nowhere") == math.inf


def test_a_process_that_is_bound_to_one_processor_counts_one():
    code = (
        "import os; os.sched_setaffinity(0, [min(os.sched_getaffinity(0))]); "
        "from tactile_core.machine import processors; print(processors())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "1\n"
    assert 1 <= processors() <= (os.cpu_count() or 1)
