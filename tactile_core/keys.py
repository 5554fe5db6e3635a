"""Keys: whether what was made before is what would be made now.

Whatever is reused or resumed (masks, checkpoints, trials, rollouts) lies under a key of all that it
depends on: the code that makes it, its settings, its seed and the versions of its inputs. Where one
of them differs it is made anew.

Code counts as Python reads it, without comments and docstrings, together with every module of this
package that it imports and the versions of the libraries that those import.
"""

import ast
import functools
import importlib.metadata
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tactile_core.errors import TactileError
from tactile_core.files import content_hash
from tactile_core.settings import Settings

CORE = "tactile_core"
FOLDER = Path(__file__).resolve().parent
# Most modules import these, and what they do shows in the settings and in the content itself.
APART = {
    f"{CORE}.{name}" for name in (
        "settings", "profiles", "errors", "files", "parquet", "checksums", "keys",
        "value_versions", "progress", "spread",
    )
}  # fmt: skip
NAMED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
BLOCKS = ("body", "orelse", "handlers", "cases", "finalbody")  # where statements hold others
# Libraries that are installed under another name than they are imported by.
INSTALLED_AS = {"skimage": "scikit-image", "PIL": "pillow"}
LIBRARIES = (
    "numpy", "scipy", "numba", "torch", "skimage", "PIL", "trimesh", "stable_baselines3",
    "gymnasium", "ray", "hpbandster", "openvino",
)  # fmt: skip


def work_key(
    *modules: str,
    settings: Settings | Mapping[str, Any] | None = None,
    seed: int | None = None,
    **inputs: str,
) -> str:
    """The key of something that `modules` of the core, such as "dataset.splits", make.

    settings : those that its result depends on, as JSON can hold them
    inputs : the version of each input by name: a hash of its content, or the key it was made under

    Raises `TactileError` where the code was changed after this process had read it.
    """
    check_unchanged(modules)
    chosen = settings.model_dump() if isinstance(settings, Settings) else dict(settings or {})
    parts = {"settings": chosen, "seed": seed, "inputs": inputs}
    return content_hash(code_version(*modules), json.dumps(parts, sort_keys=True))


@functools.cache
def code_version(*modules: str) -> str:
    """The version of the code in `modules` of the core and of all that they run (12 hex digits)."""
    found = closure(modules)
    return content_hash(*(code_of(module) for module in found), libraries(found))[:12]


def check_unchanged(modules: tuple[str, ...]) -> None:
    """Raise `TactileError` where the code of `modules`, or of what they import, is another by now
    than it was when this process first looked: nobody could tell which of the two has run."""
    for module in closure(modules):
        if changed_on_disk(module):
            raise TactileError(
                f"{module} was changed while this process was running: start again, so that one "
                "version of the code makes it all"
            )


@functools.cache
def closure(modules: tuple[str, ...]) -> list[str]:
    """The full names of `modules` of the core and of all of it that they import, sorted."""
    found: set[str] = set()
    waiting = [f"{CORE}.{module}" for module in modules]
    while waiting:
        module = waiting.pop()
        if module not in found | APART:
            found.add(module)
            waiting += own_imports(module)
    return sorted(found)


def own_imports(module: str) -> Iterator[str]:
    """The modules of the core that a module imports, at its top or in its functions, and the
    packages that it lies in."""
    parts = module.split(".")
    yield from (".".join(parts[:depth]) for depth in range(1, len(parts)))
    for name in imported_names(module):
        if name.partition(".")[0] == CORE and source(name) is not None:
            yield name


def libraries(modules: list[str]) -> list[tuple[str, str]]:
    """The libraries that decide what `modules` compute, with the versions installed, sorted."""
    used = {name.partition(".")[0] for module in modules for name in imported_names(module)}
    return [(name, installed_version(name)) for name in sorted(used.intersection(LIBRARIES))]


@functools.cache
def installed_version(library: str) -> str:
    """The version of an installed library, the same for its CPU and GPU builds; "" without one."""
    try:
        found = importlib.metadata.version(INSTALLED_AS.get(library, library))
    except importlib.metadata.PackageNotFoundError:
        return ""
    return found.partition("+")[0]


@functools.cache
def imported_names(module: str) -> tuple[str, ...]:
    """Every module, and every name out of one, that a module imports, sorted."""
    names = set()
    for node in statements(parsed(module)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return tuple(sorted(names))


@functools.cache
def code_of(module: str) -> str:
    return content_hash(module, ast.dump(parsed(module)))


@functools.cache
def parsed(module: str) -> ast.Module:
    """A module's code as it was when this process first looked."""
    written_at(module)
    return read(module)


def read(module: str) -> ast.Module:
    """A module's code without its docstrings; comments are gone as well."""
    tree = ast.parse(file_of(module).read_bytes())
    for node in statements(tree):
        if isinstance(node, NAMED) and ast.get_docstring(node, clean=False) is not None:
            del node.body[0]
    return tree


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """A node and all statements in it, without expressions, which are ten times as many."""
    yield node
    for name in BLOCKS:
        for inner in getattr(node, name, ()):
            yield from statements(inner)


@functools.cache
def written_at(module: str) -> int:
    """When a module's file was last written, as this process first saw it; in nanoseconds."""
    return file_of(module).stat().st_mtime_ns


def changed_on_disk(module: str) -> bool:
    """Whether a module has other code by now than `parsed` found, or is gone."""
    try:
        if file_of(module).stat().st_mtime_ns == written_at(module):
            return False
        return ast.dump(read(module)) != ast.dump(parsed(module))
    except (FileNotFoundError, SyntaxError):  # removed, or half written
        return True


def file_of(module: str) -> Path:
    file = source(module)
    assert file is not None, f"there is no {module}"
    return file


@functools.cache
def source(module: str) -> Path | None:
    """The file of a module of the core or the `__init__.py` of a package; None for other names."""
    place = FOLDER.joinpath(*module.split(".")[1:])
    for file in (place.with_suffix(".py"), place / "__init__.py"):
        if file.is_file():
            return file
    return None
