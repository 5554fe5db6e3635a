"""Silhouettes by OpenGL, through pyrender (report, section IV).

pyrender needs a platform for drawing without a screen: EGL or OSMesa. Which one works is
found out in a process of its own, because broken OpenGL libraries can take a process down.
The SEG pass alone draws hard edges, but it culls back faces, so that meshes with wrongly wound
faces lose parts: every face is drawn a second time with its winding reversed.
"""

import functools
import os
import subprocess
import sys
import threading
import types
from typing import Any

import numpy as np

from tactile_core.dataset.rendering.camera import project
from tactile_core.errors import TactileError

PLATFORMS = ("egl", "osmesa")
DEBIAN_PACKAGES = "libosmesa6, or libegl1 libgl1-mesa-dri libopengl0"
PROBE = """
import numpy as np
from tactile_core.dataset.rendering.opengl import Silhouettes
square = np.array([[0, -0.25, -0.25], [0, 0.25, -0.25], [0, 0.25, 0.25], [0, -0.25, 0.25]])
mask = Silhouettes("{platform}", 64).render(square, np.array([[0, 1, 2], [0, 3, 2]]), 0)
assert 0 < mask.sum() < mask.size / 4
"""

_of_thread = threading.local()


@functools.cache
def working_platform() -> str | None:
    """The first platform that draws a mask here: egl, osmesa or None.

    `PYOPENGL_PLATFORM`, where it is set, is the only one tried.
    """
    chosen = os.environ.get("PYOPENGL_PLATFORM")
    for platform in (chosen,) if chosen else PLATFORMS:
        if _draws(platform):
            return platform
    return None


def required_platform() -> str:
    """The working platform; raises `TactileError` where there is none."""
    platform = working_platform()
    if platform is None:
        tried = os.environ.get("PYOPENGL_PLATFORM") or " and ".join(PLATFORMS)
        raise TactileError(
            f"renderer pyrender needs OpenGL, and it does not work here (tried {tried}): install "
            f"the Debian packages {DEBIAN_PACKAGES}, or choose renderer auto or rasteriser"
        )
    return platform


def silhouette(
    vertices: np.ndarray, faces: np.ndarray, rotation: float, resolution: int, platform: str
) -> np.ndarray:
    """The (R, R) bool mask of a mesh, turned in the image plane by `rotation` degrees.

    A renderer costs far more to make than to use: each thread keeps one.
    """
    kept: Silhouettes | None = getattr(_of_thread, "silhouettes", None)
    if kept is None or (kept.platform, kept.resolution) != (platform, resolution):
        if kept is not None:
            kept.renderer.delete()
        kept = _of_thread.silhouettes = Silhouettes(platform, resolution)
    return kept.render(vertices, faces, rotation)


class Silhouettes:
    """One OpenGL context that draws masks of one resolution."""

    def __init__(self, platform: str, resolution: int):
        self.platform = platform
        self.resolution = resolution
        self.pyrender = _import_pyrender(platform)
        self.renderer = self.pyrender.OffscreenRenderer(resolution, resolution)

    def render(self, vertices: np.ndarray, faces: np.ndarray, rotation: float) -> np.ndarray:
        """The (R, R) bool mask of (V, 3) vertices and (F, 3) faces.

        The vertices are projected here and drawn flat, so that OpenGL has nothing left to
        round and the rasteriser agrees with it to the pixel.
        """
        pyrender = self.pyrender
        row, column = project(vertices, rotation, self.resolution).T * 2 / self.resolution - 1
        triangles = pyrender.Primitive(
            positions=np.stack([column, -row, np.zeros_like(row)], axis=1),
            indices=np.concatenate([faces, faces[:, ::-1]]),
        )
        scene = pyrender.Scene()
        node = scene.add(pyrender.Mesh([triangles]))
        pose = np.eye(4)
        pose[2, 3] = 1
        scene.add(pyrender.OrthographicCamera(xmag=1, ymag=1), pose=pose)
        colour, _ = self.renderer.render(
            scene, flags=pyrender.RenderFlags.SEG, seg_node_map={node: (255, 255, 255)}
        )
        return colour[:, :, 0] > 0


def _import_pyrender(platform: str) -> Any:
    """pyrender, set up for `platform`, without the viewer that wants X libraries."""
    os.environ["PYOPENGL_PLATFORM"] = platform
    viewer: Any = types.ModuleType("pyrender.viewer")
    viewer.Viewer = None
    sys.modules.setdefault("pyrender.viewer", viewer)
    import pyrender

    return pyrender


def _draws(platform: str) -> bool:
    """Whether a fresh process draws a mask on `platform`."""
    command = [sys.executable, "-c", PROBE.format(platform=platform)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        probe = subprocess.run(
            command, env=environment, capture_output=True, timeout=60, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return probe.returncode == 0
