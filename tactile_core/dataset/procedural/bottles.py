"""Generated bottles: a body, a shoulder, a neck and a closure, drawn by family.

Lengths are in body radii until `surfaces.assemble` scales the bottle.
"""

import numpy as np
import trimesh

from tactile_core.dataset.procedural.closures import CLOSURES
from tactile_core.dataset.procedural.families import FAMILIES, Family
from tactile_core.dataset.procedural.surfaces import assemble, loft, tube

BODY_RINGS, SHOULDER_RINGS = 24, 16


def bottle(rng: np.random.Generator) -> trimesh.Trimesh:
    """One random bottle."""
    shares = np.array([family.share for family in FAMILIES.values()])
    name = str(rng.choice(list(FAMILIES), p=shares / shares.sum()))
    family = FAMILIES[name]
    body, shoulder, neck = (
        rng.uniform(*part) for part in (family.body, family.shoulder, family.neck)
    )
    mouth = rng.uniform(*family.mouth)
    radius, height = _outline(family, body, shoulder, neck, mouth, rng)

    # The section is square or flat up to the shoulder and becomes round on the way to the neck.
    squareness = np.clip((height[-1] - neck - height) / max(shoulder, 0.1), 0, 1)
    exponent = 2 + (rng.uniform(*family.exponent) - 2) * squareness * (rng.random() < 0.6)
    depth = 1 + (rng.uniform(*family.depth) - 1) * squareness
    shift = rng.uniform(*family.offset) * squareness
    profile = np.column_stack([radius, height])
    bodies = [loft(profile, exponent=exponent, depth=depth, shift=shift)]
    closure = CLOSURES[str(rng.choice(family.closures))]
    bodies += closure(rng, mouth, height[-1])
    if rng.random() < family.handle:
        bodies.append(_handle(radius + shift, height, rng))
    return assemble(bodies)


def _outline(
    family: Family,
    body: float,
    shoulder: float,
    neck: float,
    mouth: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Radius and height of every ring, from the base to the mouth."""
    share = np.linspace(0, 1, BODY_RINGS)
    foot = rng.uniform(*family.foot)
    wall = foot + (1 - foot) * share
    peak = rng.uniform(0.35, 0.65)  # height at which the body is widest, or its waist narrowest
    wall += rng.uniform(*family.swell) * np.sin(np.pi * share ** (np.log(0.5) / np.log(peak)))
    if rng.random() < family.ribs:
        wall += rng.uniform(0.01, 0.04) * np.sin(2 * np.pi * rng.integers(3, 8) * share)
    size = min(rng.uniform(*family.base), body / 2)
    up = np.clip(share * body / size, 0, 1)
    wall -= min(size, 0.3) * (1 - np.sqrt(1 - (1 - up) ** 2))

    rise = np.linspace(0, 1, SHOULDER_RINGS)
    root = mouth * rng.uniform(1.0, 1.25)  # the neck may taper
    power = rng.uniform(1.3, 2.8)
    drop = {
        "sloped": rise,
        "round": 1 - (1 - rise**power) ** (1 / power),
        "concave": (1 - (1 - rise) ** power) ** (1 / power),
        "swan": rise**power / (rise**power + (1 - rise) ** power),
    }[str(rng.choice(family.shoulders))]
    slope = wall[-1] + (root - wall[-1]) * drop

    radius = np.concatenate([wall, slope[1:], np.linspace(root, mouth, 6)[1:]])
    height = np.concatenate(
        [share * body, body + rise[1:] * shoulder, body + shoulder + np.linspace(0, neck, 6)[1:]]
    )
    if rng.random() < family.pedestal:
        disc, stem, rises = rng.uniform(0.4, 0.8), rng.uniform(0.12, 0.3), rng.uniform(0.15, 0.4)
        radius = np.concatenate([[disc, disc, stem, stem], radius])
        height = np.concatenate([[0, 0.08, 0.12, rises], height + rises])
    return radius, height


def _handle(outside: np.ndarray, height: np.ndarray, rng: np.random.Generator) -> trimesh.Trimesh:
    """A jug's handle from the neck or the shoulder down to the body, towards +X."""
    top = rng.uniform(0.6, 0.98) * height[-1]
    bottom = rng.uniform(0.15, 0.45) * height[-1]
    turn = np.linspace(-np.pi / 2, np.pi / 2, 28)
    power = rng.uniform(1.8, 4.0)
    up = np.sign(np.sin(turn)) * np.abs(np.sin(turn)) ** (2 / power)
    y = (top + bottom) / 2 + (top - bottom) / 2 * up
    ends = np.interp([bottom, top], height, outside)
    thickness = rng.uniform(0.06, 0.16)
    wall = np.interp(y, [bottom, top], ends) - 0.6 * thickness
    reach = rng.uniform(0.15, 0.8) * np.cos(turn).clip(0) ** (2 / power)
    return tube(np.column_stack([wall + reach, y]), thickness, rng.uniform(0.08, 0.2), exponent=3)
