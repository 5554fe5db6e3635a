"""The wheel by itself: `tactile_core` in an environment that has what it declares, and no more.

Its dependencies weigh two gigabytes, so they are lent by the environment that runs the tests: a
module of a library that the wheel does not ask for, by itself or through another, is refused there.
"""

import json
import os
import subprocess
import sys
import venv
from collections.abc import Iterator
from importlib.metadata import Distribution, distribution, packages_distributions
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from PIL import Image

REPOSITORY = Path(__file__).resolve().parents[1]
REFUSING = """
import sys

REFUSED = frozenset({refused})

class OnlyDeclared:
    def find_spec(self, name, path=None, target=None):
        if name in REFUSED:
            raise ModuleNotFoundError(f"{{name}} is not among what the wheel asks for", name=name)

sys.meta_path.insert(0, OnlyDeclared())
"""


def requirements(of: Distribution, extras: tuple[str, ...] = ("",)) -> Iterator[Requirement]:
    """What a distribution asks for on this machine."""
    for line in of.requires or []:
        need = Requirement(line)
        if need.marker is None or any(need.marker.evaluate({"extra": extra}) for extra in extras):
            yield need


def closure(start: Distribution) -> dict[str, Distribution]:
    """A distribution with all that it asks for, directly or through others, by name.

    Fails where one of them is not installed, or in another version than asked for.
    """
    found = {canonicalize_name(start.name): start}
    waiting = [*requirements(start)]
    while waiting:
        need = waiting.pop()
        name = canonicalize_name(need.name)
        if name not in found:
            found[name] = distribution(need.name)
            waiting += requirements(found[name], ("", *need.extras))
        assert need.specifier.contains(found[name].version, prereleases=True), need
    return found


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel of the checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    built = tmp_path_factory.mktemp("source") / "checkout"
    files = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=REPOSITORY, check=True, capture_output=True, text=True,
    ).stdout.splitlines()  # fmt: skip
    for file in files:
        if (REPOSITORY / file).is_file():
            (built / file).parent.mkdir(parents=True, exist_ok=True)
            (built / file).write_bytes((REPOSITORY / file).read_bytes())
    build = f"from setuptools import build_meta; build_meta.build_wheel({str(folder)!r})"
    subprocess.run([sys.executable, "-c", build], cwd=built, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """The Python of an environment into which pip installed the wheel."""
    place = tmp_path_factory.mktemp("environment")
    venv.create(place, symlinks=True)
    python = place / "bin" / "python"
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-index",
         "--no-deps", "--disable-pip-version-check", wheel],
        check=True,
    )  # fmt: skip
    (site,) = place.glob("lib/python*/site-packages")
    (own,) = Distribution.discover(name="tactile-exploration", path=[str(site)])
    wanted = closure(own)
    refused = [
        module
        for module, owners in packages_distributions().items()
        if not any(canonicalize_name(owner) in wanted for owner in owners)
    ]
    (site / "only_declared.py").write_text(REFUSING.format(refused=json.dumps(refused)))
    lent = Path(np.__file__).parents[1]
    (site / "lent.pth").write_text(f"{lent}\nimport only_declared\n")
    return python


def run(python: Path, *arguments: str, home: Path) -> str:
    """What a command in that environment prints; it knows of no checkout and no home."""
    kept = {name: os.environ[name] for name in ("PATH", "LANG") if name in os.environ}
    environment = kept | {"HOME": str(home), "XDG_DATA_HOME": str(home / "data")}
    done = subprocess.run(
        [python, *arguments], env=environment, cwd=home, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def stored(python: Path) -> set[Path]:
    """Every file of the installed packages, but what Python and Numba compiled."""
    (site,) = python.parents[1].glob("lib/python*/site-packages")
    packages = [
        file for name in ("tactile_core", "tactile_assets") for file in (site / name).rglob("*")
    ]
    return {file for file in packages if "__pycache__" not in file.parts}


def test_every_module_of_the_core_has_what_it_needs_but_those_of_search_and_play(
    installed, tmp_path
):
    program = """
import importlib, pkgutil, tactile_core
names = [found.name for found in pkgutil.walk_packages(tactile_core.__path__, "tactile_core.")]
for name in sorted({*names} - {"tactile_core.__main__"}):
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        print(name, error.name)
"""
    lines = run(installed, "-c", program, home=tmp_path).splitlines()
    missing = dict(line.split() for line in lines)
    page = {name for name in missing if name.startswith("tactile_core.play.")}
    assert {missing.pop(name) for name in page} <= {"nicegui", "fastapi", "uvicorn"}
    assert missing == {
        "tactile_core.cluster": "ray",
        "tactile_core.nodes": "ray",
        "tactile_core.reconstruction.search": "ray",
        "tactile_core.reconstruction.trial": "ray",
    }


def test_a_mug_is_felt_out_where_nothing_was_run(installed, tmp_path):
    before = stored(installed)
    tactile = str(installed.with_name("tactile"))
    told = json.loads(run(installed, tactile, "feel", "mug", "--json", home=tmp_path))
    assert len(told["rays"]) == 10
    assert Image.open(tmp_path / "run.gif").is_animated
    assert stored(installed) == before


def test_the_environment_is_made_by_its_name_alone(installed, tmp_path):
    program = """
import gymnasium
env = gymnasium.make("tactile_core:TactileExploration-v1")
observation, info = env.reset(seed=0)
print(env.observation_space.contains(observation), *info)
"""
    assert run(installed, "-c", program, home=tmp_path).startswith("True mask jaccard")
