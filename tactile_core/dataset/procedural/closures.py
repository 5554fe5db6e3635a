"""What sits on a generated bottle's neck: caps, corks, stoppers, pumps, sprayers.

Each closure is a function (rng, mouth, top) -> bodies; `mouth` is the neck's radius, `top` the
height where it ends, both in radii of the bottle's body.
"""

from collections.abc import Callable, Sequence

import numpy as np
import trimesh

from tactile_core.dataset.procedural.surfaces import loft, tube, turned

SINK = 0.03  # closures reach so far down over the neck, so that no gap shows


def _stack(top: float, *steps: tuple[float, float]) -> trimesh.Trimesh:
    """A body of revolution through (radius, height above `top`)."""
    return loft([(radius, top + height) for radius, height in steps])


def no_closure(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """An open mouth with a lip or bead."""
    lip, height = mouth * rng.uniform(1.0, 1.3), rng.uniform(0.05, 0.2)
    return [_stack(top, (mouth, -height), (lip, -0.8 * height), (lip, 0.0))]


def cap(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A plain cap, somewhat wider than the neck."""
    return [_cap(mouth * rng.uniform(1.05, 1.35), rng.uniform(0.25, 0.7), top, rng)]


def tall_cap(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A cap taller than wide, as on perfume, medicine and thermos bottles."""
    return [_cap(mouth * rng.uniform(1.05, 1.6), rng.uniform(0.6, 1.6), top, rng)]


def screw(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A short screw cap above a neck ring."""
    ring = mouth * rng.uniform(1.15, 1.35)
    gap = rng.uniform(0.06, 0.15)
    collar = _stack(top, (ring, -SINK), (ring, 0.05), (mouth, 0.06), (mouth, gap + SINK))
    lid = _cap(mouth * rng.uniform(1.02, 1.25), rng.uniform(0.25, 0.5), top + gap, rng)
    return [collar, lid]


def crown(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A crown cork: a low flared cap over the bead of a beer bottle."""
    bead = mouth * rng.uniform(1.05, 1.25)
    edge = mouth * rng.uniform(1.15, 1.35)
    return [
        _stack(top, (mouth, -0.3), (bead, -0.25), (bead, -0.05), (mouth, 0.0)),
        _stack(top, (edge, -0.02), (mouth, 0.14), (0.8 * mouth, 0.17)),
    ]


def foil(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """The sleeve of a wine or champagne bottle, over the top of its neck."""
    sleeve = mouth * rng.uniform(1.05, 1.3)
    down = rng.uniform(0.2, 0.8)
    return [_stack(top, (sleeve, -down), (sleeve, 0.05), (0.9 * sleeve, rng.uniform(0.08, 0.3)))]


def cork(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A cork that stands out of a lipped mouth."""
    plug = mouth * rng.uniform(0.65, 0.95)
    wider = plug * rng.uniform(1.0, 1.2)
    stand = rng.uniform(0.1, 0.5)
    return [*no_closure(rng, mouth, top), _stack(top, (plug, -SINK), (wider, stand))]


def swing(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A swing top: a ceramic plug on its gasket."""
    head = mouth * rng.uniform(0.8, 1.1)
    return [
        *no_closure(rng, mouth, top),
        _stack(
            top,
            (0.7 * head, -SINK),
            (0.8 * head, 0.1),
            (head, 0.15),
            (head, 0.35),
            (0.6 * head, 0.5),
        ),
    ]


def stopper(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A glass stopper: a waist, then a wedge, disc or drop."""
    waist = mouth * rng.uniform(0.6, 0.9)
    head = mouth * rng.uniform(1.0, 1.9)
    rise = rng.uniform(0.08, 0.3)
    tall = rng.uniform(0.2, 1.0)
    widest = rise + tall * rng.uniform(0.2, 0.9)
    flange = mouth * rng.uniform(1.1, 1.7)
    lip = _stack(top, (mouth, -0.25), (flange, -0.05), (flange, 0.0))
    tip = head * rng.uniform(0.1, 0.9)
    return [lip, _stack(top, (waist, -SINK), (waist, rise), (head, widest), (tip, rise + tall))]


def ball(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A spherical or flattened stopper."""
    size, flat = mouth * rng.uniform(1.1, 2.2), rng.uniform(0.6, 1.3)
    turn = np.linspace(-0.45 * np.pi, 0.5 * np.pi, 20)
    sphere = np.column_stack(
        [size * np.cos(turn).clip(1e-3), top + size * flat * (1 + np.sin(turn))]
    )
    return [*no_closure(rng, mouth, top), loft(sphere)]


def sport(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A sports cap: a wide base, a cone and a pull spout."""
    base, spout = mouth * rng.uniform(1.1, 1.5), mouth * rng.uniform(0.35, 0.6)
    low, cone, out = rng.uniform(0.15, 0.5), rng.uniform(0.1, 0.5), rng.uniform(0.15, 0.5)
    return [
        _stack(
            top,
            (base, -SINK),
            (base, low),
            (spout, low + cone),
            (spout, low + cone + out),
            (0.7 * spout, low + cone + out + 0.05),
        )
    ]


def nozzle(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """The pointed top of a ketchup or glue bottle, above its collar."""
    base, root = mouth * rng.uniform(1.05, 1.4), mouth * rng.uniform(0.5, 1.0)
    low, tall = rng.uniform(0.15, 0.45), rng.uniform(0.5, 1.3)
    tip = root * rng.uniform(0.15, 0.5)
    return [_stack(top, (base, -SINK), (base, low), (root, low + 0.05), (tip, low + tall))]


def nipple(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A baby bottle's collar and teat."""
    base, root, teat = mouth * rng.uniform(1.15, 1.5), mouth * 0.95, mouth * rng.uniform(0.3, 0.5)
    low, tall = rng.uniform(0.3, 0.6), rng.uniform(0.5, 1.0)
    turn = np.linspace(0, np.pi / 2, 8)
    teat_tip = [(teat * np.cos(a) + 1e-3, low + tall + 0.6 * teat * np.sin(a)) for a in turn]
    return [
        _stack(top, (base, -SINK), (base, low), (root, low), (teat, low + 0.5 * tall), *teat_tip)
    ]


def dropper(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A pipette's collar and rubber bulb."""
    base, bulb = mouth * rng.uniform(1.05, 1.3), mouth * rng.uniform(0.5, 0.8)
    low, tall = rng.uniform(0.3, 0.6), rng.uniform(0.4, 1.0)
    steps = [(base, -SINK), (base, low), (bulb, low + 0.03), (1.1 * bulb, low + 0.7 * tall)]
    return [_stack(top, *steps, (0.5 * bulb, low + tall))]


def pump(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A soap dispenser: collar, stem and a sideways spout."""
    collar, stem = mouth * rng.uniform(1.1, 1.4), mouth * rng.uniform(0.2, 0.4)
    low, tall = rng.uniform(0.2, 0.5), rng.uniform(0.3, 0.9)
    head = low + tall
    thick, reach = rng.uniform(0.06, 0.12), rng.uniform(0.5, 1.3)
    spout = tube(
        [(-0.25, head), (0.3 * reach, head + thick), (0.9 * reach, head), (reach, head - 0.15)],
        thick,
        thick * rng.uniform(0.8, 1.6),
    )
    spout.apply_translation((0, top, 0))
    body = _stack(top, (collar, -SINK), (collar, low), (stem, low + 0.02), (stem, head))
    return [body, turned(spout, float(rng.choice([0, 90, 180, 270])))]


def trigger(rng: np.random.Generator, mouth: float, top: float) -> list[trimesh.Trimesh]:
    """A spray head: collar, a housing with its nozzle, and the trigger below it."""
    collar, low = mouth * rng.uniform(1.1, 1.4), rng.uniform(0.2, 0.4)
    stem, neck = mouth * rng.uniform(0.6, 0.9), rng.uniform(0.1, 0.4)
    height, front, back = rng.uniform(0.17, 0.35), rng.uniform(0.6, 1.3), rng.uniform(0.4, 1.0)
    middle = low + neck + 0.8 * height
    housing = tube(
        [(-back, middle - 0.05), (0, middle), (0.6 * front, middle), (front, middle)],
        height,
        rng.uniform(0.12, 0.25),
        exponent=rng.uniform(2.5, 5),
    )
    drop = rng.uniform(0.5, 1.0)
    lever = tube(
        [(0.6 * front, middle), (0.65 * front, middle - 0.5 * drop), (0.5 * front, middle - drop)],
        0.07,
        0.1,
    )
    parts = [housing, lever]
    for part in parts:
        part.apply_translation((0, top, 0))
    aim = float(rng.choice([0, 90, 180, 270]))
    body = _stack(top, (collar, -SINK), (collar, low), (stem, low + 0.05), (stem, middle))
    return [body, *(turned(part, aim) for part in parts)]


def _cap(radius: float, tall: float, top: float, rng: np.random.Generator) -> trimesh.Trimesh:
    """A cap with straight or tapering sides and a slightly rounded edge."""
    upper = radius * rng.choice([1.0, rng.uniform(0.75, 1.05)])
    edge = min(0.08, 0.3 * tall)
    return _stack(
        top,
        (radius, -SINK),
        (upper, tall - edge),
        (upper - 0.5 * edge, tall - 0.2 * edge),
        (upper - edge, tall),
    )


Closure = Callable[[np.random.Generator, float, float], Sequence[trimesh.Trimesh]]
CLOSURES: dict[str, Closure] = {
    "none": no_closure,
    "cap": cap,
    "tall_cap": tall_cap,
    "screw": screw,
    "crown": crown,
    "foil": foil,
    "cork": cork,
    "swing": swing,
    "stopper": stopper,
    "ball": ball,
    "sport": sport,
    "nozzle": nozzle,
    "nipple": nipple,
    "dropper": dropper,
    "pump": pump,
    "trigger": trigger,
}
