"""Tasks on a cluster: what they return, say and raise arrives; those that are lost begin anew."""

import os
import signal
from pathlib import Path

import pytest

from tactile_core.errors import TactileError
from tactile_core.nodes import refuse_others, versions
from tactile_core.spread import ONE_PROCESSOR, handed_over, in_order, spread
from tests.ray_nodes import one_node


@pytest.fixture(scope="module")
def cluster(ray_token):
    """A cluster of two processors, named by RAY_ADDRESS, that asks for a token."""
    with one_node(2, ray_token):
        yield


def squared(number, exponent, progress):
    progress(f"{number} to the power of {exponent}")
    return number**exponent


def trained(name, *, work, progress):
    progress(f"{name} in {work}")
    return os.getpid()


def refuses(number, progress):
    raise TactileError(f"no {number} here")


def dies(marks: Path, progress):
    """Once, unless it is told to die each time."""
    once = marks / "died"
    if marks.name == "always" or not once.exists():
        once.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "alive"


def test_each_part_comes_back_with_its_number_and_its_words(cluster):
    said = []
    made = list(in_order(spread(squared, [3, 1, 2], 2, progress=said.append)))
    assert made == [9, 1, 4]
    assert {f"{number} to the power of 2" for number in (1, 2, 3)} < set(said)
    assert said[-1].startswith("squared: done by the Ray cluster, 3 on ")


def test_work_is_handed_over_only_where_there_is_a_cluster(cluster, monkeypatch):
    said = []
    ran = handed_over(trained, "gain", work="here", needs=ONE_PROCESSOR, progress=said.append)
    assert ran != os.getpid() and "gain in here" in said
    monkeypatch.delenv("RAY_ADDRESS")
    ran = handed_over(trained, "gain", work="here", needs=ONE_PROCESSOR, progress=said.append)
    assert ran == os.getpid() and said[-1] == "gain in here"


def test_what_a_task_raises_is_raised_as_it_is(cluster):
    with pytest.raises(TactileError, match=r"^no 7 here$"):
        list(spread(refuses, [7], progress=print))


def test_a_task_that_is_lost_begins_anew_and_not_for_ever(cluster, tmp_path):
    for name in ("once", "always"):
        (tmp_path / name).mkdir()
    assert list(spread(dies, [tmp_path / "once"], progress=print)) == [(0, "alive")]
    with pytest.raises(TactileError, match="was lost 4 times") as refused:
        list(spread(dies, [tmp_path / "always"], progress=print))
    assert "\n" not in str(refused.value)


def test_a_node_must_have_the_same_versions():
    mine = versions()
    refuse_others("10.0.0.7", mine, mine)
    other = {**mine, "torch": "1.0"}
    with pytest.raises(
        TactileError, match=rf"^node 10.0.0.7 .* has torch 1.0, and .* {mine['torch']}"
    ):
        refuse_others("10.0.0.7", other, mine)
    del other["torch"]
    with pytest.raises(TactileError, match="has torch not at all"):
        refuse_others("10.0.0.7", other, mine)
