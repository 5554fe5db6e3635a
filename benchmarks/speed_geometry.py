"""Silhouettes of meshes, and the first hits of rays."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import trimesh
from skimage.draw import line

from benchmarks.samples import RESOLUTION, masks, meshes
from benchmarks.timing import Curve, Pace, Row, Work, alternated, at_least, swept
from tactile_core.dataset.rendering.camera import project
from tactile_core.dataset.rendering.opengl import Silhouettes, silhouette, working_platform
from tactile_core.dataset.rendering.rasteriser import rasterise
from tactile_core.exploration.world.circle import circle_pixels
from tactile_core.exploration.world.rays import cast_rays

MASK_RESOLUTION = 256
TRIANGLES = (1_000, 3_000, 10_000, 30_000, 100_000, 200_000)
RAYS, PLAIN_RAYS = 10_000, 200


def silhouette_rows(pace: Pace) -> list[Row]:
    """Masks by our rasteriser and by one OpenGL renderer, beside a renderer made anew each time.

    All give the same pixels, by the same projection.
    """
    platform = working_platform()
    what = f"silhouettes at {MASK_RESOLUTION}×{MASK_RESOLUTION}"
    if platform is None:
        nothing = f"{what} beside pyrender: not measured, OpenGL does not work here"
        rate = swept([masks_of(drawn_by_rasteriser)], pace)[0]
        return [Row(nothing, rate, math.nan, "masks/s", math.nan, "ratio ≥ 40")]

    def drawn_anew(mesh: trimesh.Trimesh, rotation: float) -> None:
        silhouettes = Silhouettes(platform, MASK_RESOLUTION)
        silhouettes.render(mesh.vertices, mesh.faces, rotation)
        silhouettes.renderer.delete()

    def drawn_again(mesh: trimesh.Trimesh, rotation: float) -> None:
        silhouette(mesh.vertices, mesh.faces, rotation, MASK_RESOLUTION, platform)

    ours = alternated(masks_of(drawn_by_rasteriser), masks_of(drawn_anew), pace)
    # Not in turn: with EGL, deleting one renderer closes the display of all others.
    reused = swept([masks_of(drawn_again)], pace)[0]
    return [
        at_least(f"{what}, rasteriser beside pyrender ({platform}) made anew", ours, "masks/s", 40),
        Row(
            f"{what}, pyrender ({platform}) reused beside made anew",
            reused, ours.plain, "masks/s", reused / ours.plain,
        ),
    ]  # fmt: skip


def ray_rows(pace: Pace) -> list[Row]:
    """First hits in one call, beside scikit-image's line for each ray."""
    rows = []
    for resolution in (RESOLUTION, MASK_RESOLUTION):
        rates = alternated(batched_rays(resolution), single_rays(resolution), pace)
        ours, plain = 1e6 / rates.ours, 1e6 / rates.plain
        what = f"first hit of a ray at {resolution}×{resolution}, batches of {RAYS}"
        rows.append(Row(what, ours, plain, "µs", rates.ratio, "ours < 1 µs", ours < 1))
    return rows


def triangle_curve(pace: Pace) -> Curve:
    """Masks per second against triangles, on rings with ever finer faces."""
    sizes, works = [], []
    for triangles in pace.some(TRIANGLES):
        sections = round(math.sqrt(triangles / 2))
        ring = trimesh.creation.torus(0.25, 0.1, major_sections=sections, minor_sections=sections)
        sizes.append(len(ring.faces))
        works.append(masks_of(drawn_by_rasteriser, [ring]))
    rates = swept(works, pace)
    return Curve(
        f"masks by the rasteriser at {MASK_RESOLUTION}×{MASK_RESOLUTION}", "triangles", sizes,
        rates, "masks/s", [1 / rate for rate in rates],
    )  # fmt: skip


def drawn_by_rasteriser(mesh: trimesh.Trimesh, rotation: float) -> None:
    rasterise(project(mesh.vertices, rotation, MASK_RESOLUTION), mesh.faces, MASK_RESOLUTION)


def masks_of(
    draw: Callable[[trimesh.Trimesh, float], None], some: list[trimesh.Trimesh] | None = None
) -> Work:
    """One mask of the next mesh in turn."""
    turns = itertools.cycle(meshes() if some is None else some)

    def work() -> float:
        draw(next(turns), 30.0)
        return 1

    return work


def batched_rays(resolution: int) -> Work:
    rays, which = random_rays(resolution, RAYS)

    def work() -> float:
        cast_rays(masks(resolution), rays, which)
        return RAYS

    return work


def single_rays(resolution: int) -> Work:
    rays, which = random_rays(resolution, PLAIN_RAYS)
    ends = circle_pixels(resolution)[rays]
    some = masks(resolution)

    def work() -> float:
        for (alpha, beta), index in zip(ends, which, strict=True):
            rows, columns = line(*map(int, (*alpha, *beta)))
            np.flatnonzero(some[index, rows, columns])[:1]
        return PLAIN_RAYS

    return work


def random_rays(resolution: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Random rays (count, 2), and the mask that each of them meets (count,)."""
    rng = np.random.default_rng(0)
    rays = rng.integers(len(circle_pixels(resolution)), size=(count, 2))
    return rays, rng.integers(len(masks(resolution)), size=count)
