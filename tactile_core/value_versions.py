"""Versions of values that hold code: what a reward does, whoever wrote it and wherever.

Its module may hold others that do not concern it. So it is the function that counts, as Python has
compiled it, with all that it names or holds: functions, constants, classes, what a closure keeps.
Comments and docstrings do not count.
"""

import ast
import dis
import functools
import importlib.util
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path
from types import (
    CodeType,
    FunctionType,
    GetSetDescriptorType,
    MemberDescriptorType,
    MethodType,
    ModuleType,
)
from typing import Any

import numpy as np

from tactile_core import keys
from tactile_core.errors import TactileError
from tactile_core.files import content_hash

PLAIN = (type(None), bool, int, float, complex, str, bytes, type(...))
NAMES_A_GLOBAL = {"LOAD_GLOBAL", "LOAD_NAME"}
INSTALLED = {"site-packages", "dist-packages"}


def value_version(value: Any) -> str:
    """The version of a value with all the code that it holds (12 hex digits).

    Raises `TactileError` where that cannot be told.
    """
    return content_hash(described(value, set()))[:12]


def described(value: Any, seen: set[int]) -> tuple:
    """`value` as nested tuples of words, equal for equal values in any process.

    seen : ids of the functions and classes that were met on the way; once is enough
    """
    name = type(value).__name__
    if isinstance(value, PLAIN):
        return name, repr(value)
    if isinstance(value, list | tuple):
        return name, *(described(part, seen) for part in value)
    if isinstance(value, dict):
        pairs = ((described(key, seen), described(part, seen)) for key, part in value.items())
        return name, *sorted(pairs, key=repr)
    if isinstance(value, set | frozenset):
        # Each as if it were met first: a set has no order of its own.
        return name, *sorted((described(part, set(seen)) for part in value), key=repr)
    if isinstance(value, np.ndarray | np.generic) and value.dtype != object:
        return name, str(value.dtype), value.shape, content_hash(value.tobytes())
    if isinstance(value, functools.partial):
        return name, described((value.func, value.args, value.keywords), seen)
    if isinstance(value, MethodType):
        return name, described((value.__func__, value.__self__), seen)
    if isinstance(value, CodeType):
        return name, *instructions(value, seen)
    if isinstance(value, ModuleType):
        return name, value.__name__, module_version(value)
    if hasattr(value, "py_func"):  # compiled by numba
        return name, described(value.py_func, seen)
    if isinstance(value, staticmethod | classmethod | property):
        parts = [getattr(value, part, None) for part in ("__func__", "fget", "fset")]
        return name, described(parts, seen)
    if isinstance(value, type) or (callable(value) and hasattr(value, "__qualname__")):
        return code_described(value, seen)
    if hasattr(value, "__dict__") and not is_library(type(value).__module__):
        return name, code_described(type(value), seen), described(vars(value), seen)
    try:
        return name, content_hash(pickle.dumps(value))
    except Exception as error:  # pickle raises whatever the value does
        raise TactileError(
            f"{value!r} cannot be told from others of its kind: give a reward numbers, words, "
            "arrays, functions and dataclasses of these"
        ) from error


def code_described(value: Any, seen: set[int]) -> tuple:
    """A function or class: by its name and release where it is a library's, else by what it
    does."""
    name = f"{value.__module__}.{value.__qualname__}"
    if is_library(value.__module__):
        return name, keys.installed_version((value.__module__ or "builtins").partition(".")[0])
    if id(value) in seen:
        return (name,)
    seen.add(id(value))
    if isinstance(value, type):
        own = {key: part for key, part in vars(value).items() if is_written(key, part)}
        return name, described(value.__bases__, seen), described(own, seen)
    if not isinstance(value, FunctionType):  # such as what functools.cache makes of one
        return name, described(getattr(value, "__wrapped__", None), seen)
    held = [cell.cell_contents for cell in value.__closure__ or ()]
    named = {
        word: value.__globals__[word]
        for word in sorted(names_of(value.__code__))
        if word in value.__globals__
    }
    parts = [value.__code__, value.__defaults__, value.__kwdefaults__, held, named]
    return name, *(described(part, seen) for part in parts)


def is_written(name: str, part: Any) -> bool:
    """Whether somebody wrote this part of a class, or Python did, or `dataclass`, whose fields each
    instance tells."""
    if isinstance(part, FunctionType):
        return "__create_fn__" not in part.__code__.co_qualname
    made = isinstance(part, MemberDescriptorType | GetSetDescriptorType)
    return not (made or name.startswith(("__", "_abc_")))


def instructions(code: CodeType, seen: set[int]) -> list[tuple]:
    """What code does, one step after the other; where it stands and what is said there aside."""
    steps = [
        (step.opname, described(step.argval, seen) if step.opcode in dis.hasconst else step.argrepr)
        for step in dis.get_instructions(code)
    ]
    return [*steps, (repr(code.co_exceptiontable), code.co_argcount, code.co_flags)]


def names_of(code: CodeType) -> set[str]:
    """The globals that code names, and the functions inside it."""
    names = {step.argval for step in dis.get_instructions(code) if step.opname in NAMES_A_GLOBAL}
    inside = (names_of(part) for part in code.co_consts if isinstance(part, CodeType))
    return names.union(*inside)


def module_version(module: ModuleType) -> str:
    """The version of a module that a function names: of the core's and one's own with all that they
    import."""
    root, _, rest = module.__name__.partition(".")
    if root == keys.CORE:
        return keys.code_version(rest)
    if is_library(module.__name__) or getattr(module, "__file__", None) is None:
        return keys.installed_version(root)
    files, core = code_behind(module.__name__)
    behind = [(name, file.read_bytes()) for name, file in sorted(files.items())]
    return content_hash(behind, keys.code_version(*sorted(core)) if core else "")


def code_behind(module: str) -> tuple[dict[str, Path], set[str]]:
    """The files of one's own that a module is made of, by name, and the modules of the core that
    these import. They are its own file, those of the packages that it lies in, for a package all
    below it, and those of what they import, in turn; libraries are left out."""
    files: dict[str, Path] = {}
    core: set[str] = set()
    waiting = [(module, own_file(module))]
    while waiting:
        name, file = waiting.pop()
        root, _, rest = name.partition(".")
        if root == keys.CORE and rest and keys.source(name) is not None:
            core.add(rest)
        if name in files or root == keys.CORE or file is None:
            continue
        files[name] = file
        above = [name.rpartition(".")[0], *imports(name, file)]
        waiting += [(other, own_file(other)) for other in above]
        if name == module and file.name == "__init__.py":
            parts = [part for part in file.parent.rglob("*.py") if part != file]
            waiting += [(named(name, part.relative_to(file.parent)), part) for part in parts]
    return files, core


def named(package: str, part: Path) -> str:
    """What the module in a file below a package's folder is called."""
    parts = part.with_suffix("").parts
    return ".".join([package, *(parts[:-1] if parts[-1] == "__init__" else parts)])


def own_file(module: str) -> Path | None:
    """The file of a module of one's own; None for a library's, and for what is no module."""
    try:
        found = importlib.util.find_spec(module) if module else None
    except (ImportError, AttributeError, ValueError):  # a name out of a module
        return None
    origin = Path((found and found.origin) or "")
    is_own = module.partition(".")[0] not in sys.stdlib_module_names and not is_installed(origin)
    return origin if is_own and origin.suffix == ".py" else None


def imports(module: str, file: Path) -> Iterator[str]:
    """Every module, and every name out of one, that the code of a module imports; nothing where it
    is no code."""
    try:
        tree = ast.parse(file.read_bytes())
    except SyntaxError:  # such as a template beside a package's modules
        return
    package = module if file.name == "__init__.py" else module.rpartition(".")[0]
    for node in keys.statements(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = importlib.util.resolve_name("." * node.level, package) if node.level else ""
            base = ".".join(filter(None, [above, node.module]))
            yield from (base, *(f"{base}.{alias.name}" for alias in node.names))


def is_installed(file: Path) -> bool:
    return not INSTALLED.isdisjoint(file.parts)


@functools.cache
def is_library(module: str | None) -> bool:
    """Whether a module is Python's own or lies where packages are installed; the core is none."""
    root = (module or "builtins").partition(".")[0]
    file = getattr(sys.modules.get(root), "__file__", None) or ""
    return root in sys.stdlib_module_names or (is_installed(Path(file)) and root != keys.CORE)
