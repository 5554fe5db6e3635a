"""Keys: whether what was made before is what would be made now.

Whatever is reused or resumed (masks, checkpoints, trials, rollouts) lies under a key of all that it
depends on: the code that makes it, its settings, its seed and the versions of its inputs. Where one
of them differs it is made anew.

Code counts as Python reads it, without comments and docstrings, together with every module of this
package that it imports and the versions of the libraries that those import.
"""

import ast
import functools
import hashlib
import importlib.metadata
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tactile_core.files import content_hash
from tactile_core.settings import Settings

CORE = "tactile_core"
FOLDER = Path(__file__).resolve().parent
# Every module imports these, and what they do shows in the settings and in the content itself.
APART = {f"{CORE}.{name}" for name in ("settings", "errors", "files", "keys", "value_versions")}
NAMED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
# Libraries that are installed under another name than they are imported by.
INSTALLED_AS = {"skimage": "scikit-image", "PIL": "pillow"}
LIBRARIES = (
    "numpy", "scipy", "numba", "torch", "skimage", "PIL", "trimesh", "stable_baselines3",
    "gymnasium", "ray", "hpbandster",
)  # fmt: skip


def work_key(
    *modules: str,
    settings: Settings | Mapping[str, Any] | None = None,
    seed: int | None = None,
    **inputs: str,
) -> str:
    """The key of something that `modules` of the core, such as "dataset.splits", make.

    settings : those that its result depends on
    inputs : the version of each input by name: a hash of its content, or the key it was made under
    """
    chosen = settings.model_dump() if isinstance(settings, Settings) else dict(settings or {})
    return content_hash(
        code_version(*modules), sorted(chosen.items()), seed, sorted(inputs.items())
    )


@functools.cache
def code_version(*modules: str) -> str:
    """The version of the code in `modules` of the core and of all that they run (12 hex digits)."""
    found = closure([f"{CORE}.{module}" for module in modules])
    return content_hash(*(code_of(module) for module in found), libraries(found))[:12]


def closure(modules: list[str]) -> list[str]:
    """These modules and all of the core that they import, sorted."""
    found: set[str] = set()
    waiting = list(modules)
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
    for node in ast.walk(parsed(module)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return tuple(sorted(names))


@functools.cache
def code_of(module: str) -> str:
    return hashlib.sha256(f"{module}:{ast.dump(parsed(module))}".encode()).hexdigest()


@functools.cache
def parsed(module: str) -> ast.Module:
    """A module's code without its docstrings; comments are gone as well."""
    file = source(module)
    assert file is not None, f"there is no {module}"
    return without_docstrings(ast.parse(file.read_bytes()))


def without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, NAMED) and ast.get_docstring(node, clean=False) is not None:
            del node.body[0]
    return tree


def source(module: str) -> Path | None:
    """The file of a module of the core or the `__init__.py` of a package; None for other names."""
    place = FOLDER.joinpath(*module.split(".")[1:])
    for file in (place.with_suffix(".py"), place / "__init__.py"):
        if file.is_file():
            return file
    return None
