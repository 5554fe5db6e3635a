"""The families that generated bottles are drawn from, and what their bottles have in common.

Lengths are in body radii, before the mesh is scaled.
"""

from dataclasses import dataclass

Range = tuple[float, float]


@dataclass(frozen=True)
class Family:
    """What bottles of one kind have in common; every range is drawn from uniformly.

    share : how many bottles are of this family, relative to the others
    body, shoulder, neck : heights
    mouth : radius of the neck where the closure sits
    shoulders : any of "sloped" (straight), "round", "concave" and "swan" (S-shaped)
    closures : keys of `CLOSURES`
    foot : radius at the base as a share of that at the shoulder
    swell : widening (or, negative, waist) of the body between the two
    base : size of the rounding at the base
    exponent, depth : section of the body: 2 round, larger squarer; radius along Z by that along X
    offset : how far the body stands off the neck's axis, along X
    pedestal, handle : share of bottles that have one
    """

    share: float
    body: Range
    shoulder: Range
    neck: Range
    mouth: Range
    shoulders: tuple[str, ...]
    closures: tuple[str, ...]
    foot: Range = (0.92, 1.03)
    swell: Range = (-0.02, 0.02)
    base: Range = (0.03, 0.3)
    exponent: Range = (2.0, 2.0)
    depth: Range = (1.0, 1.0)
    offset: Range = (0.0, 0.0)
    ribs: float = 0.0
    pedestal: float = 0.0
    handle: float = 0.0


FAMILIES = {
    "wine": Family(
        11,
        (3.2, 5.0),
        (0.5, 2.6),
        (1.2, 2.6),
        (0.3, 0.42),
        ("round", "swan", "sloped"),
        ("cork", "foil", "none", "cap"),
        foot=(0.9, 1.0),
    ),
    "beer": Family(
        11,
        (2.8, 4.6),
        (0.6, 2.4),
        (0.9, 2.4),
        (0.36, 0.5),
        ("round", "swan", "sloped"),
        ("crown", "crown", "none", "foil", "swing"),
        base=(0.1, 0.4),
    ),
    "water": Family(
        10,
        (3.4, 5.0),
        (0.6, 1.9),
        (0.05, 0.3),
        (0.3, 0.5),
        ("round", "swan", "sloped"),
        ("screw", "screw", "sport", "none"),
        swell=(-0.1, 0.04),
        base=(0.1, 0.5),
        ribs=0.6,
    ),
    "soda": Family(
        8,
        (2.6, 4.2),
        (1.2, 2.8),
        (0.1, 0.6),
        (0.28, 0.55),
        ("swan", "sloped", "concave"),
        ("screw", "crown", "none"),
        foot=(0.8, 1.0),
        swell=(-0.22, 0.08),
        base=(0.1, 0.5),
        ribs=0.2,
    ),
    "milk": Family(
        7,
        (2.2, 3.8),
        (0.7, 1.8),
        (0.2, 0.9),
        (0.45, 0.75),
        ("swan", "sloped", "round"),
        ("screw", "cap", "none"),
        swell=(-0.16, 0.05),
        exponent=(2.0, 5.0),
        base=(0.1, 0.5),
    ),
    "medicine": Family(
        10,
        (1.4, 3.2),
        (0.1, 0.8),
        (0.05, 0.5),
        (0.35, 0.75),
        ("round", "sloped"),
        ("cap", "screw", "dropper", "tall_cap"),
        exponent=(2.0, 4.0),
    ),
    "detergent": Family(
        9,
        (2.2, 4.2),
        (0.4, 1.6),
        (0.1, 0.6),
        (0.25, 0.45),
        ("round", "sloped", "swan"),
        ("screw", "cap", "sport", "trigger", "pump"),
        foot=(0.8, 1.15),
        swell=(-0.16, 0.08),
        exponent=(2.0, 4.0),
        depth=(0.45, 0.8),
        offset=(0.0, 0.35),
        handle=0.35,
    ),
    "squeeze": Family(
        7,
        (2.4, 4.0),
        (0.2, 1.2),
        (0.05, 0.3),
        (0.4, 0.7),
        ("round", "sloped"),
        ("nozzle", "nipple", "sport", "pump"),
        swell=(-0.15, 0.06),
        base=(0.05, 0.5),
        exponent=(2.0, 3.0),
        depth=(0.6, 1.0),
    ),
    "spray": Family(
        5,
        (2.2, 3.6),
        (0.9, 2.0),
        (0.3, 0.9),
        (0.28, 0.42),
        ("sloped", "concave", "swan"),
        ("trigger",),
        swell=(-0.12, 0.04),
        depth=(0.6, 1.0),
    ),
    "jar": Family(
        5,
        (1.2, 2.6),
        (0.1, 0.5),
        (0.02, 0.15),
        (0.65, 0.92),
        ("round", "sloped"),
        ("screw", "cap", "tall_cap"),
        base=(0.05, 0.4),
        exponent=(2.0, 4.0),
    ),
    "jug": Family(
        5,
        (1.3, 2.6),
        (0.7, 1.8),
        (0.2, 0.9),
        (0.2, 0.45),
        ("round", "swan", "sloped"),
        ("cork", "screw", "none"),
        foot=(0.75, 1.05),
        swell=(0.0, 0.2),
        handle=1.0,
    ),
    "potion": Family(
        10,
        (0.2, 1.3),
        (0.7, 2.4),
        (0.1, 0.5),
        (0.18, 0.38),
        ("sloped", "concave", "round"),
        ("stopper", "cork", "none"),
        foot=(0.55, 0.95),
        swell=(0.0, 0.1),
        base=(0.01, 0.2),
    ),
    "round flask": Family(
        4,
        (0.9, 1.5),
        (0.5, 1.2),
        (0.5, 2.4),
        (0.18, 0.4),
        ("round", "swan"),
        ("none", "cork", "stopper"),
        foot=(0.4, 0.7),
        swell=(0.25, 0.5),
    ),
    "conical flask": Family(
        3,
        (0.1, 0.4),
        (1.4, 2.4),
        (0.3, 1.2),
        (0.22, 0.45),
        ("sloped", "concave"),
        ("none", "cork"),
    ),
    "perfume": Family(
        9,
        (0.6, 2.4),
        (0.02, 0.4),
        (0.1, 0.4),
        (0.18, 0.4),
        ("round", "sloped"),
        ("tall_cap", "stopper", "cap", "ball"),
        foot=(0.4, 1.1),
        exponent=(2.0, 8.0),
        depth=(0.35, 1.0),
        base=(0.01, 0.15),
    ),
    "flask": Family(
        4,
        (1.6, 3.0),
        (0.2, 0.9),
        (0.2, 0.7),
        (0.2, 0.4),
        ("round", "sloped"),
        ("screw", "cap", "cork"),
        swell=(-0.05, 0.15),
        exponent=(2.5, 6.0),
        depth=(0.3, 0.6),
    ),
    "decanter": Family(
        7,
        (1.2, 3.4),
        (0.6, 2.2),
        (0.2, 2.0),
        (0.22, 0.55),
        ("swan", "concave", "sloped"),
        ("stopper", "ball", "none"),
        foot=(0.4, 1.2),
        swell=(-0.35, 0.35),
        exponent=(2.0, 5.0),
        pedestal=0.3,
    ),
    "thermos": Family(
        4,
        (4.0, 6.0),
        (0.1, 0.5),
        (0.02, 0.3),
        (0.55, 0.95),
        ("round", "sloped"),
        ("tall_cap", "sport", "cap", "screw"),
        foot=(0.85, 1.0),
    ),
}
