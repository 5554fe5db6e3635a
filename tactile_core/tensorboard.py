"""Where the curves of a training lie for TensorBoard."""

import shutil
from pathlib import Path


def curves_folder(work: Path, *, resumed: bool) -> Path:
    """The folder of a training's curves, without those of earlier trainings, which would overlay.

    resumed : whether the training goes on, and its curves with it
    """
    folder = work / "tensorboard"
    if not resumed:
        shutil.rmtree(folder, ignore_errors=True)
    return folder
