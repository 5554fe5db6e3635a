"""Code versions: what an asset is computed by, as a hash of the core's code that it runs.

A changed code version marks the asset stale. It changes with the settings of the stage and with any
module of the core that the named ones import, however far; comments and docstrings do not count.
"""

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

from tactile_assets.paths import REPOSITORY
from tactile_core.files import content_hash
from tactile_core.settings import Settings

CORE = "tactile_core"
# Every module imports these, and what they do shows in the settings and the content itself.
APART = {f"{CORE}.settings", f"{CORE}.errors", f"{CORE}.files"}
NAMED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def code_version(*parts: str | Settings) -> str:
    """The version of code in modules of the core, such as "dataset.splits", with its settings."""
    modules = [f"{CORE}.{part}" for part in parts if isinstance(part, str)]
    settings = [part.model_dump() for part in parts if isinstance(part, Settings)]
    return content_hash(*(code_of(module) for module in closure(modules)), *settings)[:12]


def closure(modules: list[str]) -> list[str]:
    """These modules and all of the core that they import, sorted."""
    found: set[str] = set()
    waiting = list(modules)
    while waiting:
        module = waiting.pop()
        if module not in found | APART:
            found.add(module)
            waiting += imports(module)
    return sorted(found)


@functools.cache
def parsed(module: str) -> ast.Module:
    """A module's code without its docstrings; comments are gone as well."""
    tree = ast.parse(source(module).read_bytes())
    for node in ast.walk(tree):
        if isinstance(node, NAMED) and ast.get_docstring(node, clean=False) is not None:
            del node.body[0]
    return tree


@functools.cache
def code_of(module: str) -> str:
    return content_hash(module, ast.dump(parsed(module)))


def imports(module: str) -> Iterator[str]:
    """The modules of the core that a module imports, at its top or in its functions."""
    for node in ast.walk(parsed(module)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(CORE):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (name for name in (str(node.module), *names) if source(name).is_file())


def source(module: str) -> Path:
    return REPOSITORY / f"{module.replace('.', '/')}.py"
