"""Versions of values that hold code: what a reward does counts, and nothing else."""

import functools
import os
import re
import subprocess
import sys
import threading
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import pytest

from tactile_core import keys
from tactile_core.compiled import compiled
from tactile_core.errors import TactileError
from tactile_core.value_versions import module_version, value_version

# Each a reward as users write them; of every pair the second does something else.
START = """
import functools
from dataclasses import dataclass
import numpy as np
"""
PAIRS = {
    "constant": ("def reward(x): return x + 1", "def reward(x): return x + 2"),
    "operator": ("def reward(x): return x + 1", "def reward(x): return x - 1"),
    "default": ("def reward(x, k=1): return x + k", "def reward(x, k=2): return x + k"),
    "lambda": ("reward = lambda x: x + 1", "reward = lambda x: x + 2"),
    "global": ("K = 1\ndef reward(x): return x + K", "K = 2\ndef reward(x): return x + K"),
    "global in a container": (
        "K = {'miss': [1]}\ndef reward(x): return x + K['miss'][0]",
        "K = {'miss': [2]}\ndef reward(x): return x + K['miss'][0]",
    ),
    "global array": (
        "K = np.arange(3)\ndef reward(x): return x * K",
        "K = np.arange(3) * 2\ndef reward(x): return x * K",
    ),
    "helper": (
        "def helper(x): return x\ndef reward(x): return helper(x)",
        "def helper(x): return -x\ndef reward(x): return helper(x)",
    ),
    "helper inside a function inside": (
        "def helper(x): return x\ndef reward(x): return [helper(y) for y in x]",
        "def helper(x): return -x\ndef reward(x): return [helper(y) for y in x]",
    ),
    "cached helper": (
        "@functools.cache\ndef helper(x): return x\ndef reward(x): return helper(x)",
        "@functools.cache\ndef helper(x): return -x\ndef reward(x): return helper(x)",
    ),
    "closure": (
        "def scaled(k):\n  def reward(x): return k * x\n  return reward\nreward = scaled(1)",
        "def scaled(k):\n  def reward(x): return k * x\n  return reward\nreward = scaled(2)",
    ),
    "partial": (
        "def some(k, x): return k * x\nreward = functools.partial(some, 1)",
        "def some(k, x): return k * x\nreward = functools.partial(some, 2)",
    ),
    "field": (
        "@dataclass\nclass Some:\n  k: int\n  def __call__(self, x): ...\nreward = Some(1)",
        "@dataclass\nclass Some:\n  k: int\n  def __call__(self, x): ...\nreward = Some(2)",
    ),
    "code of a class": (
        "@dataclass\nclass Some:\n  k: int\n  def __call__(self, x): return x\nreward = Some(1)",
        "@dataclass\nclass Some:\n  k: int\n  def __call__(self, x): return -x\nreward = Some(1)",
    ),
    "code of its base": (
        "class Base:\n  def f(self): return 1\nclass Some(Base): pass\nreward = Some().f",
        "class Base:\n  def f(self): return 2\nclass Some(Base): pass\nreward = Some().f",
    ),
    "attribute of a class": (
        "class Some:\n  K = [1]\n  def __call__(self, x): return x * self.K[0]\nreward = Some()",
        "class Some:\n  K = [2]\n  def __call__(self, x): return x * self.K[0]\nreward = Some()",
    ),
    "library's function": (
        "from numpy import where as some\ndef reward(x): return some(x)",
        "from numpy import argsort as some\ndef reward(x): return some(x)",
    ),
    "what an error leads to": (
        "def reward(x):\n  try: return x()\n  except ValueError: return 1",
        "def reward(x):\n  try: return x()\n  except KeyError: return 1",
    ),
}


def version(text: str) -> str:
    space = {"__name__": "somebody"}
    exec(START + text, space)
    return value_version(space["reward"])


@pytest.mark.parametrize("pair", PAIRS)
def test_whatever_a_reward_does_counts(pair):
    one, other = PAIRS[pair]
    assert version(one) == version(one) != version(other)


def test_compiled_functions_count_by_what_they_compile():
    def plain(x):
        return x

    def negative(x):
        return -x

    assert value_version(compiled(plain)) == value_version(compiled(plain))
    assert value_version(compiled(plain)) != value_version(compiled(negative))


@pytest.mark.parametrize(
    "said",
    [
        'def reward(x):\n  """Words."""\n  return None if x else K',
        'def reward(x):\n  """Other words."""\n  # and a comment\n\n  return None if x else K',
        "OTHER = 3\ndef another(x): return 0\n\ndef reward(x): return None if x else K",
    ],
)
def test_words_places_and_neighbours_do_not_count(said):
    assert version(f"K = 1\n{said}") == version("K = 1\ndef reward(x): return None if x else K")


@dataclass(frozen=True)
class Scaled:
    """A reward with settings."""

    factor: float
    words: frozenset[str] = frozenset({"a", "b", "c", "d"})

    def __call__(self, x: np.ndarray) -> np.ndarray:
        return self.factor * x if "a" in {"a", "b", "c"} else functools.reduce(max, x)


def test_versions_are_equal_in_every_process():
    code = (
        "from tests.core.test_value_versions import Scaled;"
        "from tactile_core.value_versions import value_version;"
        "print(value_version((Scaled(2.0), Scaled, len, {1: 'x', 'y': {3, 'z'}})))"
    )
    found = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True, text=True, check=True,
        ).stdout
        for seed in ("1", "2")
    }  # fmt: skip
    assert len(found) == 1


def test_a_version_is_twelve_hex_digits():
    assert re.fullmatch("[0-9a-f]{12}", value_version(1))


def test_a_module_that_is_named_counts_by_its_code_or_by_its_release(tmp_path, monkeypatch):
    from tactile_core import files

    assert module_version(files) == keys.code_version("files")
    assert module_version(np) == keys.installed_version("numpy") != ""
    assert module_version(sys) == ""  # Python's own, in no file
    assert module_version(ModuleType("made_up")) == ""

    monkeypatch.syspath_prepend(tmp_path)
    versions = []
    for text in ("def helper(x): return x", "def helper(x): return -x"):
        (tmp_path / "helpers_of_one_s_own.py").write_text(text)
        reward = "import helpers_of_one_s_own as own\ndef reward(x): return own.helper(x)"
        versions += [version(reward), version(reward)]
    assert versions[0] == versions[1] != versions[2] == versions[3]


PACKAGE = "import package.part\ndef reward(x): return package.part.score(x)"
MODULE = "import helpers\ndef reward(x): return helpers.score(x)"


@pytest.mark.parametrize(
    ("reward", "files", "changed"),
    [
        (MODULE, {"helpers": "from deeper import K\ndef score(x): return K"}, "deeper"),
        (MODULE, {"helpers": "def score(x):\n  import deeper\n  return deeper.K"}, "deeper"),
        (MODULE, {"helpers": "from package.part import K as score"}, "package/part"),
        (MODULE, {"helpers": "from package.one import score"}, "package/__init__"),
        (MODULE, {"helpers": "from package.one import score"}, "package/deeper"),
        (PACKAGE, {"package/part": "def score(x): return 0"}, "package/part"),
        (PACKAGE, {"package/part": "from .deeper import K as score"}, "package/deeper"),
        (PACKAGE, {"package/part": "def score(x): return 0"}, "package/inner/__init__"),
        (PACKAGE, {"package/part": "def score(x): return 0"}, "package/template"),
    ],
)
def test_a_module_of_one_s_own_counts_with_all_that_it_imports(tmp_path, reward, files, changed):
    """In a process of its own each, as Python keeps what it has imported."""
    code = f"""
from tactile_core.value_versions import value_version
exec({reward!r})
print(value_version(reward))
"""
    some = {
        "deeper": "K = 0", "helpers": "", "package/__init__": "", "package/part": "K = 0",
        "package/deeper": "K = 0", "package/one": "from .deeper import K as score",
        "package/inner/__init__": "raise ValueError", "package/template": "{{ a template }}}",
        "by_the_way": "", **files,
    }  # fmt: skip

    def version_with(**others: str) -> str:
        for name, text in (some | others).items():
            file = tmp_path / f"{name}.py"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
        found = subprocess.run(
            [sys.executable, "-B", "-c", code],
            env={**os.environ, "PYTHONPATH": str(tmp_path)},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        return found.stdout

    before = version_with()
    assert version_with(by_the_way="K = 1") == before
    assert version_with(**{changed: f"{some[changed]}\nK = 1"}) != before


def test_arrays_count_by_what_they_hold_not_by_where_it_lies():
    grid = np.arange(6).reshape(2, 3)
    assert value_version(grid.T) == value_version(grid.T.copy()) != value_version(grid)
    words = [np.array(["".join(["a", "b", end]), end], dtype=object) for end in "ccd"]
    assert value_version(words[0]) == value_version(words[1]) != value_version(words[2])


class Slotted:
    __slots__ = ("factor",)

    def __init__(self, factor: float) -> None:
        self.factor = factor


def test_a_value_without_a_dict_of_its_own_counts_by_what_it_holds():
    one, again, other = (value_version(Slotted(factor)) for factor in (1.0, 1.0, 2.0))
    assert one == again != other


def test_a_function_that_calls_itself_has_a_version():
    assert version("def reward(x): return x if x < 1 else reward(x - 1)") == version(
        "def reward(x): return x if x < 1 else reward(x - 1)"
    )


def test_what_cannot_be_told_apart_is_refused_in_one_line():
    lock = threading.Lock()
    with pytest.raises(TactileError, match="cannot be told from others of its kind") as refused:
        value_version(lambda: lock)
    assert "\n" not in str(refused.value)


DIAMOND = """
from tactile_core.value_versions import value_version
def third(x): return x + 7
def one(x): return third(x) * 2
def two(x): return third(x) * 3
def reward(x): return one(x) + two(x)
print(value_version(reward), value_version({one, two}), value_version({"b": one, "a": two}))
"""


def test_the_order_of_sets_which_changes_from_process_to_process_changes_no_version():
    """Two functions name a third: whichever is met first must not decide."""
    said = {
        subprocess.run(
            [sys.executable, "-c", DIAMOND],
            env={**os.environ, "PYTHONHASHSEED": str(seed)},
            capture_output=True, text=True, check=True,
        ).stdout
        for seed in range(6)
    }  # fmt: skip
    assert len(said) == 1


def test_a_set_of_functions_has_one_version_wherever_they_lie_in_memory():
    made, versions = [], set()
    for number in range(40):
        space = {"__name__": "own"}
        exec(DIAMOND.partition("def reward")[0], space)
        made.append((space, bytearray(37 * number)))  # keeps the next ones elsewhere
        versions.add(value_version({space["one"], space["two"]}))
    assert len(versions) == 1
