"""Change the code a little, one place at a time, and see whether the tests tell: `make mutants`.

cosmic-ray finds the places and makes the changes. It would begin a process for each, which takes
seconds to import PyTorch; here each is a fork of one process that has imported it, in a copy of
the checkout. docs/mutation.md judges the survivors.

    python -m tests.mutants                                # all
    python -m tests.mutants exploration/world/rays keys    # some
"""

import argparse
import importlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.shared import ELSEWHERE

CHECKOUT = Path(__file__).parents[1]
# Module → the tests that are to tell. What numba compiles is run as Python where that is quick.
TESTS = {
    "exploration/world/rays": ["exploration/world/test_rays.py"],
    "exploration/world/state": ["exploration/world/test_state.py", "exploration/world/test_env.py"],
    "exploration/world/rewards": ["exploration/world/test_rewards.py"],
    "evaluation/statistics": ["evaluation/test_statistics.py"],
    "evaluation/bootstrap": ["evaluation/test_bootstrap.py"],
    "dataset/splits": ["dataset/test_splits.py"],
    "dataset/sources/archives": ["dataset/sources/test_archives.py"],
    "keys": ["test_keys.py"],
}
PLAIN_PYTHON = {"exploration/world/rays", "exploration/world/rewards"}
LIBRARIES = (
    "numpy", "scipy.ndimage", "pandas", "pyarrow.parquet", "torch", "numba", "skimage.draw",
    "hypothesis", "pytest", "trimesh", "gymnasium", "stable_baselines3", "upath", "pydantic",
    "safetensors.torch", "ray", "requests",
)  # fmt: skip
LONGEST = 60  # seconds, after which a mutant counts as told: it does not end
# cosmic-ray replaces each operator by every other; one of them is enough to see it tested.
ONE_OF = {
    "Add": "Sub", "Sub": "Add", "Mul": "Div", "Div": "Mul", "FloorDiv": "Mul", "Mod": "Mul",
    "Pow": "Mul", "BitAnd": "BitOr", "BitOr": "BitAnd", "BitXor": "BitOr", "LShift": "RShift",
    "RShift": "LShift", "Eq": "NotEq", "NotEq": "Eq", "Lt": "LtE", "LtE": "Lt", "Gt": "GtE",
    "GtE": "Gt", "Is": "IsNot", "IsNot": "Is", "In": "NotIn", "NotIn": "In",
}  # fmt: skip


def mutants(source: str) -> Iterator[tuple[str, str]]:
    """What was changed, and the whole source with that change."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator, operator_names

    tree = get_ast(source)
    for name in operator_names():
        kind, _, parts = name.rpartition("/")[2].partition("_")
        if kind in ("ReplaceBinaryOperator", "ReplaceComparisonOperator"):
            old, _, new = parts.partition("_")
            if ONE_OF.get(old) != new:
                continue
        if parts.endswith("_Invert") or parts == "Delete_USub":  # as one more or less, and as +
            continue
        operator_class = get_operator(name)
        if operator_class.arguments():
            continue
        operator = operator_class()
        places = [
            start for node in ast_nodes(tree) for start, _ in operator.mutation_positions(node)
        ]
        for occurrence, (line, _) in enumerate(places):
            try:
                changed = mutate_code(source, operator, occurrence)
            except AttributeError:  # cosmic-ray 8.7 cannot change `except some.Error`
                continue
            if changed is not None and changed != source:
                text = changed.splitlines()[line - 1].strip()
                yield f"line {line}, {kind} {parts}: {text}", changed


def forked(tree: Path, tests: list[str]) -> int:
    """Exit status of pytest in a fork of this process, in `tree`; 1 where it takes too long."""
    child = os.fork()
    if child == 0:
        os.setsid()
        os.chdir(tree)
        sys.path.insert(0, str(tree))
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        import pytest

        options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:randomly", "-p", "no:xdist"]
        options += ["--hypothesis-seed=0", f"--basetemp={tree.parent / 'temporary'}"]
        try:
            os._exit(int(pytest.main([*options, *tests])))
        except BaseException:
            os._exit(1)
    end = time.monotonic() + LONGEST
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return 1


def survivors(module: str, folder: Path) -> tuple[list[str], int]:
    """The mutants of a module that its tests do not tell, and how many there were."""
    tree = folder / "tree"
    left_out = shutil.ignore_patterns(".git", ".venv", ".tactile", "build", "__pycache__", "docs")
    shutil.copytree(CHECKOUT, tree, ignore=left_out)
    tests = [f"tests/core/{test}" for test in TESTS[module]]
    # Once as they are: they have to pass, and leave fixtures and compiled code to be used again.
    os.environ[ELSEWHERE] = str(folder / "shared")
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    subprocess.run(command, cwd=tree, check=True, stdout=subprocess.DEVNULL)
    if module in PLAIN_PYTHON:
        os.environ["NUMBA_DISABLE_JIT"] = "1"
    for name in LIBRARIES:
        importlib.import_module(name)
    file = tree / "tactile_core" / f"{module}.py"
    for stale in (file.parent / "__pycache__").glob(f"{file.stem}.*"):
        stale.unlink()
    sys.dont_write_bytecode = True
    source, alive, count = file.read_text(), [], 0
    for what, changed in mutants(source):
        count += 1
        file.write_text(changed)
        if forked(tree, tests) == 0:
            alive.append(what)
            print(f"  {module} {what}", flush=True)
    return alive, count


def main(modules: list[str]) -> None:
    for module in modules:
        # Each in a process of its own: whether numba compiles is decided when it is imported.
        child = os.fork()
        if child == 0:
            with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
                alive, count = survivors(module, Path(folder))
            told = count - len(alive)
            print(f"{module}: {told} of {count} told ({told / max(count, 1):.0%})", flush=True)
            os._exit(0)
        os.waitpid(child, 0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("modules", nargs="*", metavar="module", help="below tactile_core")
    main(parser.parse_args().modules or list(TESTS))
