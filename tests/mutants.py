"""Change the code a little, one place at a time, and see whether the tests tell: `make mutants`.

cosmic-ray finds the places and makes the changes. It would begin a process for each, which takes
seconds to import PyTorch; here each is a fork of one process that has imported it, in a copy of
the checkout. docs/mutation.md judges the survivors.

    python -m tests.mutants                                # all
    python -m tests.mutants exploration/world/rays keys    # some
    python -m tests.mutants --every 3 keys                 # every third place, for a first look
"""

import argparse
import importlib
import os
import re
import resource
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple

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
    "value_versions": ["test_value_versions.py"],
}
WITH_FIXTURES = {"exploration/world/state"}  # of conftest.py, which imports nearly everything
PLAIN_PYTHON = {"exploration/world/rays", "exploration/world/rewards"}
# Tests that take long (pytest's -k): asked only where no other tells.
SLOW = (
    "every_process or process_to_process or number_of_processes or takes_no_more_memory or "
    "little_memory or drawing_rows_again or lets_through or is_let_through"
)
LONGEST = 60  # seconds of computing, after which a mutant counts as told: it does not end
# cosmic-ray replaces each operator by every other; one of them is enough to see it tested.
ONE_OF = {
    "Add": "Sub", "Sub": "Add", "Mul": "Div", "Div": "Mul", "FloorDiv": "Mul", "Mod": "Mul",
    "Pow": "Mul", "BitAnd": "BitOr", "BitOr": "BitAnd", "BitXor": "BitOr", "LShift": "RShift",
    "RShift": "LShift", "Eq": "NotEq", "NotEq": "Eq", "Lt": "LtE", "LtE": "Lt", "Gt": "GtE",
    "GtE": "Gt", "Is": "IsNot", "IsNot": "Is", "In": "NotIn", "NotIn": "In",
}  # fmt: skip
# Two lines that become the same by these do the same; docs/mutation.md says why.
THE_SAME = [
    (r"(masks?|free)\.shape\[[+-]* ?[12]\]", "resolution"),
    (r"touches\[:, -?[01]\] (< [01]|<= 0)", "missed"),
    (r"touches\[:, -?[01]\] (>= [01]|> 0)", "hit"),
    (r"\((rows|places) (>= [01]|> 0)\)", r"(\1 inside)"),
    (r"reshape\(\(?- ?\d", "reshape(-1"),
    (r"return (0|-1), (0|-1)", "none"),
    (r"most_common\( ?[12]\)\[ ?(0|-1)\]", "the most common"),
    (r"(strict|frozen|optimize)=(True|False)", ""),
    (r"if (not )?TYPE_CHECKING", ""),
    (r"theta [+-] np\.pi", "the other way"),
    (r"(last_\w+|rows) >=? (row|column)", r"\1 > \2"),
]
# As do a loop that goes on once it has found something and finds the same again, and code that is
# not compiled.
ONLY_SLOWER = ("break", "continue")
COMPILED = ("@compiled", "@numba.njit")


class Mutant(NamedTuple):
    what: str
    changed: str  # the whole source
    equal: bool  # of a kind that was judged to do what the original does


def mutants(source: str) -> Iterator[Mutant]:
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
                before, after = (text.splitlines()[line - 1].strip() for text in (source, changed))
                what = f"line {line}, {kind} {parts}: {after}"
                decorated = kind == "RemoveDecorator"
                equal = before.startswith(COMPILED) if decorated else same(before, after)
                yield Mutant(what, changed, equal)


def same(before: str, after: str) -> bool:
    if (before, after) == ONLY_SLOWER:
        return True
    for pattern, common in THE_SAME:
        before, after = re.sub(pattern, common, before), re.sub(pattern, common, after)
    return before == after


def survives(tree: Path, tests: list[str]) -> bool:
    """Whether the tests pass, the slow ones last."""
    return all(passes(tree, [*tests, "-k", f"{which} ({SLOW})"]) for which in ("not", ""))


def passes(tree: Path, arguments: list[str]) -> bool:
    """Whether pytest, in a fork of this process, finds nothing wrong, or nothing to do."""
    child = os.fork()
    if child == 0:
        used = int(sum(os.times()[:2]))
        resource.setrlimit(resource.RLIMIT_CPU, (used + LONGEST, used + LONGEST))
        options = ["-x", "--hypothesis-profile=mutants", f"--basetemp={tree.parent / 'temporary'}"]
        os._exit(asked([*options, *arguments]))
    return os.waitpid(child, 0)[1] in (0, 5 << 8)


def asked(arguments: list[str]) -> int:
    """Exit status of pytest, which says nothing."""
    import pytest
    from hypothesis import Phase, settings

    # Nothing is shrunk, as nobody reads it.
    phases = (Phase.explicit, Phase.generate)
    settings.register_profile("mutants", deadline=None, derandomize=True, phases=phases)
    options = ["-q", "--timeout=0"]
    for plugin in ("cacheprovider", "randomly", "xdist"):
        options += ["-p", f"no:{plugin}"]
    with Path(os.devnull).open("w") as nothing, redirect_stdout(nothing), redirect_stderr(nothing):
        try:
            return int(pytest.main([*options, *arguments]))
        except BaseException:
            return 1


def survivors(module: str, every: int, folder: Path) -> tuple[list[str], int, int]:
    """The mutants of a module that its tests do not tell, how many were tried, and how many more
    were not as they do the same."""
    tree = folder / "tree"
    left_out = shutil.ignore_patterns(".git", ".venv", ".tactile", "build", "__pycache__", "docs")
    shutil.copytree(CHECKOUT, tree, ignore=left_out)
    os.chdir(tree)
    sys.path.insert(0, str(tree))
    os.environ[ELSEWHERE] = str(folder / "shared")
    if module in PLAIN_PYTHON:
        os.environ["NUMBA_DISABLE_JIT"] = "1"
    tests = [f"tests/core/{test}" for test in TESTS[module]]
    if module not in WITH_FIXTURES:
        tests.append("--noconftest")
    asked(["--collect-only", *tests])  # imports all that they need
    forget_what_imports(module, tree)
    # Once as they are: they leave fixtures and compiled code to be used again.
    if not survives(tree, tests):
        sys.exit(f"{' '.join(tests)}: fail as they are")
    file = tree / "tactile_core" / f"{module}.py"
    for stale in (file.parent / "__pycache__").glob(f"{file.stem}.*"):
        stale.unlink()
    sys.dont_write_bytecode = True
    alive, count, equal = [], 0, 0
    for mutant in [*mutants(file.read_text())][::every]:
        if mutant.equal:
            equal += 1
            continue
        count += 1
        file.write_text(mutant.changed)
        if survives(tree, tests):
            alive.append(mutant.what)
            print(f"  {module} {mutant.what}", flush=True)
    return alive, count, equal


def forget_what_imports(module: str, tree: Path) -> None:
    """Let `module`, all that imports it and the tests be imported anew, and nothing else."""
    keys = importlib.import_module("tactile_core.keys")
    files = [file.relative_to(tree).with_suffix("") for file in keys.FOLDER.rglob("*.py")]
    names = {".".join(file.parts).removesuffix(".__init__") for file in files}
    above = {f"tactile_core.{module.replace('/', '.')}"}
    while more := {n for n in names - above if not above.isdisjoint(keys.own_imports(n))}:
        above |= more
    for name in [*sys.modules]:
        package, _, last = name.rpartition(".")
        if name in above or (package.partition(".")[0] == "tests" and name != "tests.shared"):
            del sys.modules[name]
            if package in sys.modules:  # else `from package import last` finds it
                vars(sys.modules[package]).pop(last, None)


def main(modules: list[str], every: int) -> None:
    for module in modules:
        # Each in a process of its own: whether numba compiles is decided when it is imported.
        child = os.fork()
        if child == 0:
            with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
                alive, count, equal = survivors(module, every, Path(folder))
            told = count - len(alive)
            share = f"{told} of {count} told ({told / max(count, 1):.0%})"
            print(f"{module}: {share}, {equal} more do the same", flush=True)
            os._exit(0)
        os.waitpid(child, 0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("modules", nargs="*", metavar="module", help="below tactile_core")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="each Nth place only")
    chosen = parser.parse_args()
    main(chosen.modules or list(TESTS), chosen.every)
