"""Masks: the silhouettes of meshes, rendered by OpenGL or by our own rasteriser.

Both renderers give equal pixels, so which one draws is a matter of what the machine has.
Meshes are spread over processes where there are enough of them, or over a Ray cluster; the masks do
not depend on it.
"""

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import PurePosixPath
from typing import NamedTuple

import numpy as np
import pandas as pd
from upath import UPath

from tactile_core.dataset.rendering import opengl
from tactile_core.dataset.rendering.camera import project
from tactile_core.dataset.rendering.pictures import encode_mask
from tactile_core.dataset.rendering.rasteriser import rasterise
from tactile_core.dataset.rendering.warps import warp
from tactile_core.dataset.sources.parsing import load_mesh
from tactile_core.errors import DamagedError, OutOfReachError, TactileError
from tactile_core.keys import work_key
from tactile_core.machine import processors
from tactile_core.processes import end_with
from tactile_core.progress import counted
from tactile_core.settings import MaskSettings
from tactile_core.spread import Needs, in_order, on_cluster, spread

EMPTY = "no pixel lies inside its silhouette"
MOST_WORKERS = 8
MESHES_PER_WORKER = 50  # fewer are rendered before another process has started
MESHES_PER_TASK = 5
MESHES_PER_OSMESA_WORKER = 150  # OSMesa leaks about 0.7 MB a render: its processes are replaced


class View(NamedTuple):
    """How a mesh is looked at: turned in the image plane, in degrees, and warped (see `warp`)."""

    rotation: float
    warp: int


class Job(NamedTuple):
    """One mesh file, its content hash, and the views to render it at."""

    file: str
    version: str
    views: tuple[View, ...]


def render_masks(
    meshes: pd.DataFrame,
    root: UPath,
    settings: MaskSettings,
    previous: pd.DataFrame | None = None,
    progress: Callable[[str], None] = lambda message: None,
    workers: int | None = None,
) -> pd.DataFrame:
    """The mask of every usable mesh: model_id, category, content_hash, geometry, resolution,
    status, mask and key, see `mask_keys`.

    meshes : the manifest; meshes whose status is not "ok" are left out
    root : the folder that the manifest's files are relative to
    previous : the masks of an earlier run; meshes that have not changed since keep theirs
    workers : processes at most; None: as many as there are CPUs for this process

    A mesh that cannot be loaded, or that covers no pixel, is set aside: its status is the
    reason and its mask is null. Raises `TactileError` where no mask is left, or a file is gone or
    has changed since it was collected.
    """
    wanted = meshes.loc[meshes["status"] == "ok"].reset_index(drop=True)
    wanted = wanted.assign(rotation=0.0, warp=0)
    if settings.renderer == "auto" and opengl.working_platform() is None:
        progress(
            "no OpenGL here: the software rasteriser renders the masks, with equal pixels "
            f"(for OpenGL, install {opengl.DEBIAN_PACKAGES})"
        )
    drawn = draw(wanted, root, settings, previous, progress, workers)
    reasons = [mask for mask in drawn if isinstance(mask, str)]
    if len(reasons) == len(drawn):
        usual = "none is usable, as the status column of shapenet_meshes tells"
        raise TactileError(f"no mesh gives a mask: {reasons[0] if reasons else usual}")
    table = wanted[["model_id", "category", "content_hash", "geometry"]]
    return table.assign(
        resolution=settings.resolution,
        status=["ok" if isinstance(mask, bytes) else mask for mask in drawn],
        mask=pd.Series([m if isinstance(m, bytes) else None for m in drawn], dtype=object),
        key=mask_keys(wanted, settings.resolution),
    )


def draw(
    wanted: pd.DataFrame,
    root: UPath,
    settings: MaskSettings,
    previous: pd.DataFrame | None = None,
    progress: Callable[[str], None] = lambda message: None,
    workers: int | None = None,
) -> list[bytes | str]:
    """For each row of `wanted` (model_id, content_hash, file, rotation, warp) the mask as PNG
    bytes, or the reason why there is none.

    Rows that `previous` holds under the same key are taken from there, and their meshes are not
    even loaded.
    """
    keys = mask_keys(wanted, settings.resolution)
    drawn: dict[str, bytes | str] = {}
    if previous is not None and "key" in previous:
        same = previous[previous["mask"].notna()]
        drawn = dict(zip(same["key"], same["mask"], strict=True))
    missing = [key not in drawn for key in keys]
    if any(missing):
        files = wanted[missing].groupby(["file", "content_hash"], sort=False)
        jobs = [Job(file, version, tuple(views_of(some))) for (file, version), some in files]
        results = render_jobs(jobs, root, settings, progress, workers)
        new = {
            (job.file, view): mask
            for job, masks in zip(jobs, results, strict=True)
            for view, mask in zip(job.views, masks, strict=True)
        }
        rows = zip(keys, wanted["file"], views_of(wanted), missing, strict=True)
        drawn |= {key: new[file, view] for key, file, view, absent in rows if absent}
    progress(f"{sum(missing)} masks rendered, {len(keys) - sum(missing)} unchanged")
    return [drawn[key] for key in keys]


def views_of(wanted: pd.DataFrame) -> Iterator[View]:
    return (View(*view) for view in zip(wanted["rotation"], wanted["warp"], strict=True))


def mask_keys(wanted: pd.DataFrame, resolution: int) -> list[str]:
    """What each mask depends on: its mesh, its view, and the code that renders it.

    Not the renderer, as both give equal pixels. The same bytes may be read in more than one format.
    """
    rendering = work_key("dataset.rendering.silhouettes", settings={"resolution": resolution})
    columns = wanted["content_hash"], wanted["file"], views_of(wanted)
    return [
        work_key(
            rendering=rendering,
            mesh=mesh,
            format=suffix_of(file),
            rotation=float.hex(view.rotation),
            warp=str(view.warp),
        )
        for mesh, file, view in zip(*columns, strict=True)
    ]


def suffix_of(file: str) -> str:
    return PurePosixPath(file).suffix.lower()


def render_jobs(
    jobs: list[Job],
    root: UPath,
    settings: MaskSettings,
    progress: Callable[[str], None],
    workers: int | None,
) -> Iterator[list[bytes | str]]:
    """For each job, in order, its masks as PNG bytes, or reasons, one for each view.

    OpenGL always draws in processes of its own: a crash there leaves this one alone, and
    this one can still be forked, which hangs once OpenGL was used.
    """
    platform = platform_for(settings.renderer)
    renderer = f"pyrender ({platform})" if platform else "the software rasteriser"
    progress(f"rendering {len(jobs)} meshes with {renderer} at {settings.resolution} pixels")

    if workers is None:
        workers = min(processors(), MOST_WORKERS, len(jobs) // MESHES_PER_WORKER)
    results: Iterator[list[bytes | str]]
    if on_cluster():
        results = _on_cluster(jobs, root, settings, platform, progress)
    elif platform is None and workers <= 1:
        results = (render(job, root, settings.resolution, None) for job in jobs)
    else:
        results = _in_processes(jobs, root, settings.resolution, platform, max(workers, 1))
    yield from counted(results, len(jobs), progress, "meshes rendered")


def platform_for(renderer: str) -> str | None:
    """What OpenGL draws with on this machine; None where the rasteriser does. Raises `TactileError`
    where it must be OpenGL and none is there."""
    if renderer == "pyrender":
        return opengl.required_platform()
    return opengl.working_platform() if renderer == "auto" else None


def render(job: Job, root: UPath, resolution: int, platform: str | None) -> list[bytes | str]:
    """The masks of one mesh as PNG bytes, or the reason, for each of the job's views."""
    try:
        mesh = load_mesh(root, job.file, job.version)
    except (DamagedError, OutOfReachError):  # the mesh is not to blame: mend the store
        raise
    except TactileError as error:  # tables hold no absolute paths
        return [str(error).replace(str(root / job.file), job.file)] * len(job.views)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    masks: list[bytes | str] = []
    for view in job.views:
        warped = warp(vertices, view.warp)
        if platform:
            mask = opengl.silhouette(warped, faces, view.rotation, resolution, platform)
        else:
            mask = rasterise(project(warped, view.rotation, resolution), faces, resolution)
        masks.append(encode_mask(mask) if mask.any() else EMPTY)
    return masks


def _in_processes(
    jobs: list[Job], root: UPath, resolution: int, platform: str | None, workers: int
) -> Iterator[list[bytes | str]]:
    per_pool = len(jobs) if platform != "osmesa" else workers * MESHES_PER_OSMESA_WORKER
    spawn = multiprocessing.get_context("spawn")
    for start in range(0, len(jobs), per_pool):
        batch = jobs[start : start + per_pool]
        tasks = [batch[i : i + MESHES_PER_TASK] for i in range(0, len(batch), MESHES_PER_TASK)]
        with ProcessPoolExecutor(
            min(workers, len(tasks)), spawn, initializer=end_with, initargs=(os.getpid(),)
        ) as pool:
            done = [pool.submit(_render_all, t, root, resolution, platform) for t in tasks]
            try:
                for future in done:
                    yield from future.result()
            except BrokenProcessPool as error:
                raise TactileError(
                    "a process that renders masks died: give it more memory, choose masks.renderer "
                    "rasteriser if OpenGL is to blame or, in a script of your own, call this below "
                    'if __name__ == "__main__"'
                ) from error


def _on_cluster(
    jobs: list[Job],
    root: UPath,
    settings: MaskSettings,
    platform: str | None,
    progress: Callable[[str], None],
) -> Iterator[list[bytes | str]]:
    tasks = [jobs[i : i + MESHES_PER_TASK] for i in range(0, len(jobs), MESHES_PER_TASK)]
    lasts = MESHES_PER_OSMESA_WORKER // MESHES_PER_TASK if platform == "osmesa" else 0
    drawn = spread(
        render_there, tasks, root, settings.resolution, settings.renderer,
        needs=Needs(tasks_per_process=lasts), progress=progress,
    )  # fmt: skip
    for masks in in_order(drawn):
        yield from masks


def render_there(
    jobs: list[Job],
    root: UPath,
    resolution: int,
    renderer: str,
    progress: Callable[[str], None],
) -> list[list[bytes | str]]:
    """In a process of the cluster, with what its node has."""
    return _render_all(jobs, root, resolution, platform_for(renderer))


def _render_all(
    jobs: list[Job], root: UPath, resolution: int, platform: str | None
) -> list[list[bytes | str]]:
    return [render(job, root, resolution, platform) for job in jobs]
