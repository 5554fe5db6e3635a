"""How much faster is the rasteriser than pyrender, at 256×256 pixels on the same meshes?

pyrender is timed twice: with a renderer made anew for each mesh, as the report's code does,
and with one renderer reused, as ours does. Loading the meshes is left out.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from upath import UPath

from tactile_core.dataset.camera import project
from tactile_core.dataset.meshes import collect_meshes, load_mesh
from tactile_core.dataset.opengl import DEBIAN_PACKAGES, Silhouettes, working_platform
from tactile_core.dataset.rasteriser import rasterise
from tactile_core.settings import MeshSettings

RESOLUTION = 256


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shapenet", help="archives to take the meshes from, else generated ones")
    parser.add_argument("--models", type=int, default=20, help="meshes per class")
    arguments = parser.parse_args()
    platform = working_platform()
    if platform is None:
        print(f"silhouettes: nothing to compare with, install {DEBIAN_PACKAGES}")
        return
    meshes = collect(arguments.shapenet, arguments.models)
    reused = Silhouettes(platform, RESOLUTION)

    def recreated(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        silhouettes = Silhouettes(platform, RESOLUTION)
        mask = silhouettes.render(vertices, faces, 0)
        silhouettes.renderer.delete()
        return mask

    def rasterised(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        return rasterise(project(vertices, 0, RESOLUTION), faces, RESOLUTION)

    ways = {
        "rasteriser": rasterised,
        f"pyrender ({platform}), reused": lambda *mesh: reused.render(*mesh, 0),
        f"pyrender ({platform}), made anew": recreated,
    }
    seconds = {name: per_mesh(way, meshes) for name, way in ways.items()}
    faces = np.mean([len(faces) for _, faces in meshes])
    print(f"{len(meshes)} meshes, {faces:.0f} faces on average, {RESOLUTION}×{RESOLUTION} pixels")
    for name, time_taken in seconds.items():
        ratio = time_taken / seconds["rasteriser"]
        print(f"{name:30} {1000 * time_taken:8.2f} ms a mesh {ratio:8.1f} ×")


def collect(location: str | None, models: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """(V, 3) vertices and (F, 3) faces of `models` meshes of each class."""
    settings = MeshSettings(
        location=location,
        models_per_class=models,
        procedural_models={"mug": models, "bottle": models},
    )
    with tempfile.TemporaryDirectory() as folder:
        root, cache = UPath(folder) / "meshes", Path(folder) / "cache"
        manifest = collect_meshes(settings, root, cache)
        files = manifest.loc[manifest["status"] == "ok", "file"]
        loaded = [load_mesh(root, file) for file in files]
    return [(np.asarray(mesh.vertices), np.asarray(mesh.faces)) for mesh in loaded]


def per_mesh(
    way: Callable[[np.ndarray, np.ndarray], np.ndarray],
    meshes: list[tuple[np.ndarray, np.ndarray]],
) -> float:
    """Seconds per mesh, the best of three rounds."""
    way(*meshes[0])
    rounds = []
    for _ in range(3):
        start = time.perf_counter()
        for mesh in meshes:
            way(*mesh)
        rounds.append((time.perf_counter() - start) / len(meshes))
    return min(rounds)


if __name__ == "__main__":
    main()
