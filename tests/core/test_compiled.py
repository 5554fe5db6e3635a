"""Compiled loops: what numba keeps on disk is never older than the code."""

import ast
import importlib
import inspect
import types
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

import tactile_core

FOLDER = Path(tactile_core.__file__).parent
FILES = [file for file in sorted(FOLDER.rglob("*.py")) if "import compiled" in file.read_text()]


def compiled_in(file: Path) -> list[Dispatcher]:
    name = ".".join(("tactile_core", *file.relative_to(FOLDER).with_suffix("").parts))
    functions = vars(importlib.import_module(name)).values()
    return [some for some in functions if isinstance(some, Dispatcher)]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_compiled_loops_name_nothing_of_another_module_of_ours(file):
    """Numba looks at the function's own file alone to tell whether its machine code is old."""
    imported = {
        alias.asname or alias.name
        for node in ast.parse(file.read_text()).body
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("tactile_core")
        for alias in node.names
    }
    functions = compiled_in(file)
    assert functions
    for function in functions:
        named = set(inspect.unwrap(function.py_func).__code__.co_names)
        assert not named & imported, f"{function.__name__} names {named & imported}"
        for name in named:
            value = function.py_func.__globals__.get(name)
            assert isinstance(value, Dispatcher | types.ModuleType | int | float | None)
            assert not getattr(value, "__name__", "").startswith("tactile_core")
