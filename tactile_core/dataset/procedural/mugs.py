"""Generated mugs: cylinders, cones, barrels, tulips and bowls, with the handles that go with them.

Lengths are in rim radii until `surfaces.assemble` scales the mug.
"""

import numpy as np
import trimesh

from tactile_core.dataset.procedural.surfaces import assemble, loft, tube

# Share of each kind, and its height in rim radii (a coffee mug has about 2.2).
KINDS = {
    "cylinder": (0.36, (1.4, 3.3)),
    "cone": (0.17, (1.4, 3.1)),
    "barrel": (0.12, (1.5, 2.9)),
    "bowl": (0.15, (1.0, 2.1)),
    "tulip": (0.07, (1.4, 2.9)),
    "stein": (0.07, (2.5, 4.0)),
    "travel": (0.06, (2.9, 5.2)),
}
HANDLES = {"round": 0.34, "square": 0.22, "ear": 0.38, "none": 0.06}
WALL_RINGS = 30


def mug(rng: np.random.Generator) -> trimesh.Trimesh:
    """One random mug, its handle (if any) towards +X."""
    kind = str(rng.choice(list(KINDS), p=[share for share, _ in KINDS.values()]))
    low, high = KINDS[kind][1]
    height = rng.triangular(low, (low + high) / 2, high)
    share = np.linspace(0, 1, WALL_RINGS)
    radius = _wall(kind, share, rng) * _rounded_base(share, height, kind, rng)
    exponent = rng.uniform(2.5, 6) if rng.random() < 0.05 else 2.0
    bodies = [loft(_vessel(radius, share * height, rng), exponent=exponent)]
    if kind == "travel" and rng.random() < 0.7:
        bodies.append(_lid(radius[-1], height, rng))
    handle = str(rng.choice(list(HANDLES), p=list(HANDLES.values())))
    if kind == "stein" or handle != "none":
        bodies.append(_handle("ear" if handle == "none" else handle, radius, height, kind, rng))
    return assemble(bodies)


def _wall(kind: str, share: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Outer radius at each share of the height (0 the base, 1 the rim)."""
    if kind == "bowl":
        foot = rng.uniform(0.4, 0.7)
        stem = rng.uniform(0.0, 0.15)  # height of a foot ring
        power = rng.uniform(1.0, 2.6)
        rise = np.clip((share - stem) / (1 - stem), 0, 1)
        belly = foot + (1 - foot) * (1 - (1 - rise) ** power) ** (1 / power)
        return np.where(share < stem, foot * rng.uniform(0.95, 1.15), belly)
    foot = {
        "cylinder": rng.uniform(0.95, 1.03),
        "cone": rng.choice([rng.uniform(0.58, 0.93), rng.uniform(1.05, 1.25)], p=[0.8, 0.2]),
        "barrel": rng.uniform(0.7, 1.05),
        "tulip": rng.uniform(0.6, 1.05),
        "stein": rng.uniform(1.0, 1.3),
        "travel": rng.uniform(0.65, 1.02),
    }[kind]
    radius = foot + (1 - foot) * share
    if kind == "barrel":
        radius += rng.uniform(0.06, 0.35) * (4 * share * (1 - share)) ** rng.uniform(0.6, 1.4)
    if kind == "tulip":
        waist = np.exp(-(((share - rng.uniform(0.3, 0.75)) / rng.uniform(0.15, 0.35)) ** 2))
        radius -= rng.uniform(0.05, 0.22) * waist
    if kind == "stein" or rng.random() < 0.12:  # a foot that stands out
        radius += rng.uniform(0.0, 0.12) * (share < rng.uniform(0.04, 0.14))
    if rng.random() < 0.2:  # a lip that opens outwards
        radius += rng.uniform(0.02, 0.1) * np.clip((share - 0.8) / 0.2, 0, 1) ** 2
    return radius


def _rounded_base(
    share: np.ndarray, height: float, kind: str, rng: np.random.Generator
) -> np.ndarray:
    """Factor that draws the wall in towards the base."""
    size = rng.choice([rng.uniform(0.02, 0.1), rng.uniform(0.15, 0.8)], p=[0.55, 0.45])
    if kind in ("bowl", "stein"):
        size = 0.05
    inset = min(size, 0.6) * rng.uniform(0.6, 1.0)
    up = np.clip(share * height / size, 0, 1)
    return 1 - inset * (1 - np.sqrt(1 - (1 - up) ** 2))


def _vessel(radius: np.ndarray, height: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Profile of an open vessel: up the outer wall, over the rim, down the inner one."""
    wall = rng.uniform(0.05, 0.12)
    floor = height > 2 * wall
    inner = np.column_stack([np.maximum(radius - wall, 0.05), height])[floor][::-1]
    return np.concatenate([np.column_stack([radius, height]), inner])


def _lid(rim: float, height: float, rng: np.random.Generator) -> trimesh.Trimesh:
    """A travel mug's lid: a disc over the rim with a narrower top."""
    edge, top = rim * rng.uniform(1.0, 1.08), rim * rng.uniform(0.7, 0.95)
    low, high = rng.uniform(0.08, 0.2), rng.uniform(0.0, 0.25)
    steps = [(edge, -0.05), (edge, low), (top, low + 0.03), (top, low + 0.03 + high)]
    return loft([(r, height + h) for r, h in steps])


def _handle(
    kind: str, radius: np.ndarray, height: float, mug_kind: str, rng: np.random.Generator
) -> trimesh.Trimesh:
    """A strap from the upper to the lower wall, reaching towards +X."""
    thickness = rng.uniform(0.06, 0.16)
    top = rng.uniform(0.72, 0.96) * height
    bottom = rng.uniform(0.06, 0.45) * height
    if mug_kind in ("bowl", "travel"):
        bottom = rng.uniform(0.25, 0.55) * height
    bottom = max(bottom, 1.2 * thickness)
    middle, half = (top + bottom) / 2, (top - bottom) / 2
    reach = np.clip(rng.uniform(0.45, 1.2), 0.5 * half, 2.2 * half)
    power, lean = {
        "round": (rng.uniform(1.8, 2.4), 0.0),
        "square": (rng.uniform(3.5, 8.0), rng.uniform(-0.1, 0.2)),
        "ear": (rng.uniform(1.8, 3.0), rng.uniform(0.2, 0.6)),
    }[kind]
    turn = np.linspace(-np.pi / 2, np.pi / 2, 32)
    out = np.cos(turn).clip(0) ** (2 / power)
    up = np.sign(np.sin(turn)) * np.abs(np.sin(turn)) ** (2 / power)
    wall = np.interp(middle + half * up, np.linspace(0, height, len(radius)), radius)
    path = np.column_stack(
        [wall - 0.5 * thickness + reach * out * (1 + lean * up), middle + half * up]
    )
    width = rng.uniform(0.1, 0.35)
    return tube(path, thickness, width, exponent=rng.uniform(2, 4))
