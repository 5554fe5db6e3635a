"""What an episode looks like: a picture of it, and a window where one can be opened."""

import functools
import os
import sys

import numpy as np
from skimage.draw import line

from tactile_core.exploration.world.rays import ray_ends
from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.jaccard import THRESHOLD


def picture(explorations: Explorations, index: int, ray: np.ndarray | None) -> np.ndarray:
    """One exploration, (R, R, 3) uint8: the mask in grey, the thresholded prediction in pink, the
    last ray (2,) in white up to its touch, touches in yellow."""
    mask = explorations.masks[index]
    image = np.where(mask, 120, 30)[..., None].repeat(3, axis=-1).astype(np.uint8)
    predicted = explorations.predictions[index] > THRESHOLD
    image[predicted] = image[predicted] // 2 + np.array([127, 40, 90], np.uint8)
    if ray is not None:
        rows, columns = line(*map(int, ray_ends(ray[None], explorations.resolution)[0]))
        met = np.flatnonzero(mask[rows, columns])
        reached = slice(met[0] + 1) if len(met) else slice(None)
        image[rows[reached], columns[reached]] = 255
    image[explorations.touches[index] == 1] = (255, 230, 0)
    return image


@functools.cache
def window_missing() -> str:
    """Why matplotlib cannot open a window here; "" where it can."""
    if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ):
        return "there is no display"
    import matplotlib.pyplot as plt
    from matplotlib.backends import BackendFilter, backend_registry

    backend = plt.get_backend().lower()
    if backend in map(str.lower, backend_registry.list_builtin(BackendFilter.INTERACTIVE)):
        return ""
    return f"matplotlib's backend {backend} has none; install tkinter or PyQt"


class Window:
    """A matplotlib window that shows one picture after another."""

    def __init__(self) -> None:
        import matplotlib.pyplot as plt

        self.figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
        axes.set_axis_off()
        self.image = axes.imshow(np.zeros((1, 1, 3), np.uint8))
        plt.show(block=False)

    def show(self, image: np.ndarray) -> None:
        """Show (R, R, 3) uint8 in place of what was shown."""
        self.image.set(data=image, extent=(-0.5, image.shape[1] - 0.5, image.shape[0] - 0.5, -0.5))
        self.figure.canvas.draw_idle()
        self.figure.canvas.flush_events()

    def close(self) -> None:
        import matplotlib.pyplot as plt

        plt.close(self.figure)
