"""What holds for all tests."""

from pathlib import Path

import pytest
from hypothesis import settings

# A busy machine is no fault of the code.
settings.register_profile("tests", deadline=None)
settings.load_profile("tests")

# These take the longest and begin first: a process that is left with one of them at the end keeps
# the others idle. The first makes the finished run; the next few do not wait for it.
FIRST = [
    "assets/test_chain.py",
    "assets/test_daemon.py",
    "core/reconstruction/test_search.py",
    "core/test_cluster.py",
    "assets/test_homes.py",
    "test_wheel.py",
    "test_bench.py",
    "assets/test_ui.py",
    "assets/test_cluster.py",
    "assets/test_object_store.py",
    "assets/test_chaos.py",
    "assets/test_errors.py",
    "assets/test_attainable.py",
    "core/test_recipes.py",
    "core/test_notebooks.py",
    "core/play/test_page.py",
]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    tests = Path(__file__).parent
    turn = {tests / file: number for number, file in enumerate(FIRST)}
    items.sort(key=lambda item: turn.get(item.path, len(turn)))
