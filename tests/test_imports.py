"""The house is a stair: data goes one way, and so do imports."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
# From the ground up: a room may import from its own and those before it.
WINGS = ["dataset", "reconstruction", "exploration", "evaluation", "figures", "play", "commands"]
ROOMS = {
    "dataset": [
        "seeds", "sources", "procedural", "geometry", "finding", "meshes", "rendering", "packed",
        "copies", "splits", "outlines", "shapes", "touches", "real", "drawings", "things",
    ],
    "exploration": [
        "world", "policies", "learning", "practice", "pretrained", "at_hand", "environments",
        "acting",
    ],
    "play": [
        "aim", "game", "drawing", "hidden", "materials", "scene", "workers", "legend", "chart",
        "board", "view", "page", "server",
    ],
}  # fmt: skip


def modules(package: str) -> dict[str, Path]:
    """Every module of a package: dotted name → file."""
    files = sorted((REPOSITORY / package).rglob("*.py"))
    return {
        ".".join(file.relative_to(REPOSITORY).with_suffix("").parts).removesuffix(".__init__"): file
        for file in files
    }


CORE = modules("tactile_core")


def imported(file: Path) -> Iterator[str]:
    """Modules that a file imports, at its top or in its functions."""
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file} imports relatively"
            yield str(node.module)
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def part(module: str, depth: int) -> str:
    return (module.split(".") + [""] * 3)[depth]


@pytest.mark.parametrize("module", CORE)
def test_the_core_never_imports_dagster_or_the_assets(module):
    roots = {part(name, 0) for name in imported(CORE[module])}
    assert not any(root == "tactile_assets" or root.startswith("dagster") for root in roots)


@pytest.mark.parametrize("module", [m for m in CORE if part(m, 1) in WINGS])
def test_imports_go_down_the_stair_between_wings(module):
    own = WINGS.index(part(module, 1))
    for name in imported(CORE[module]):
        if name in CORE and part(name, 1) in WINGS:
            assert WINGS.index(part(name, 1)) <= own, f"{module} imports {name}"


@pytest.mark.parametrize("module", [m for m in CORE if part(m, 1) in ROOMS and part(m, 2)])
def test_imports_go_down_the_stair_inside_a_wing(module):
    wing = part(module, 1)
    rooms = ROOMS[wing]
    assert part(module, 2) in rooms, f"say in this test where {module} stands"
    for name in imported(CORE[module]):
        if name in CORE and part(name, 1) == wing and part(name, 2):
            assert rooms.index(part(name, 2)) <= rooms.index(part(module, 2)), (
                f"{module} imports {name}"
            )


def test_nothing_below_imports_a_command():
    for module, file in CORE.items():
        if part(module, 1) not in ("commands", "__main__"):
            assert not any(part(name, 1) == "commands" for name in imported(file)), module


def test_no_module_imports_in_a_circle():
    waiting = {
        module: {name for name in imported(file) if name in CORE and name != module}
        for module, file in CORE.items()
    }
    while free := [module for module, needs in waiting.items() if not needs]:
        for module in free:
            del waiting[module]
        for needs in waiting.values():
            needs.difference_update(free)
    assert not waiting, f"in a circle: {', '.join(waiting)}"
