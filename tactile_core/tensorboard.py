"""Where the curves of a training lie for TensorBoard."""

import shutil
import tempfile
from pathlib import Path

from upath import UPath


def curves_folder(work: Path | UPath, *, resumed: bool) -> Path:
    """The folder of a training's curves, without those of earlier trainings, which would overlay.

    resumed : whether the training goes on, and its curves with it

    TensorBoard writes to disks. Where `work` lies in an object store the curves are of this machine
    alone, among its temporary files.
    """
    folder = Path(work) if isinstance(work, Path) else Path(tempfile.mkdtemp())
    folder /= "tensorboard"
    if not resumed:
        shutil.rmtree(folder, ignore_errors=True)
    return folder
