"""Helpers end with the process that started them, whenever it ended."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from tactile_core.processes import Worker, end_those_with, works

linux = pytest.mark.skipif(sys.platform != "linux", reason="Linux's kernel is asked")
# Prints the number of a helper that waits for a line and then says that it ends with its parent.
PARENT = """
import os, subprocess, sys
helper = "import os, sys, time; from tactile_core.processes import end_with\\n" \\
    "sys.stdin.readline(); end_with(int(sys.argv[1])); print('heard', flush=True); time.sleep(600)"
begun = subprocess.Popen([sys.executable, "-c", helper, str(os.getpid())])
print(begun.pid, flush=True)
begun.wait()
"""


@pytest.fixture
def family():
    """A process, and its helper."""
    with subprocess.Popen(
        [sys.executable, "-c", PARENT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        helper = psutil.Process(int(parent.stdout.readline()))
        yield parent, helper
        parent.kill()
        if helper.is_running():
            helper.kill()


def ends(pid: int) -> bool:
    """Whether a process ends within 20 seconds; its zombie may stay for longer."""
    last = time.monotonic() + 20
    while works(pid) and time.monotonic() < last:
        time.sleep(0.01)
    return not works(pid)


@linux
def test_a_helper_ends_with_its_parent(family):
    parent, helper = family
    parent.stdin.write("go\n")
    parent.stdin.flush()
    assert parent.stdout.readline() == "heard\n"
    parent.kill()
    assert ends(helper.pid)


@linux
def test_a_helper_ends_whose_parent_was_gone_before_it_could_ask(family):
    parent, helper = family
    parent.kill()
    parent.wait()
    assert helper.is_running()
    parent.stdin.write("go\n")
    parent.stdin.flush()
    assert parent.stdout.readline() == ""
    assert ends(helper.pid)


@linux
def test_a_process_is_known_though_the_clock_was_set_and_a_later_one_is_not_taken_for_it():
    here = Worker.here()
    assert not here.is_gone()
    assert not here._replace(started=here.started - 3600).is_gone()
    assert here._replace(mark="another boot:1").is_gone()
    assert not here._replace(mark="").is_gone()  # as recorded before there were marks
    assert here._replace(mark="", started=here.started - 3600).is_gone()


def test_a_process_that_ended_and_that_nobody_asked_for_does_not_work():
    with subprocess.Popen(["sleep", "600"]) as begun:
        assert works(begun.pid)
        os.kill(begun.pid, signal.SIGKILL)
        assert ends(begun.pid)
    assert not works(begun.pid)


def test_processes_are_known_by_what_they_were_given():
    given = [{"TACTILE_TEST": str(number)} for number in (1, 2)]
    one, other = (subprocess.Popen(["sleep", "600"], env=os.environ | some) for some in given)
    with one, other:
        try:
            end_those_with("TACTILE_TEST", "1")
            assert [works(one.pid), works(other.pid)] == [False, True]
        finally:
            one.kill()
            other.kill()
