"""The weights that the package ships, so that it is of use before anything was trained.

`tactile_core/pretrained` holds what one run stored, byte for byte and laid out as in its artifacts:
whatever reads a run's U-Net, policies and splits reads these, with all their checks. Beside them
lies `provenance.json`. `evaluation.shipping` makes them.
"""

import functools
import hashlib
from pathlib import Path
from typing import Any

from upath import UPath

from tactile_core.checksums import unsealed_json
from tactile_core.errors import TactileError
from tactile_core.settings import Settings

FOLDER = Path(__file__).resolve().parents[1] / "pretrained"
PROVENANCE = "provenance.json"


class Provenance(Settings):
    """Where the weights come from.

    made : the run that trained them: its command, commit, profile, machine and date
    jaccard : policy → Jaccard index (0–100) after each of ten rays, mean over one sample of each
        test model
    sha256 : of every other file, by its path
    """

    made: dict[str, Any]
    jaccard: dict[str, list[float]]
    sha256: dict[str, str]


@functools.cache
def pretrained(folder: Path = FOLDER) -> UPath:
    """Where the shipped weights lie, every file of them being as it was made.

    Raises `TactileError` where one is missing or altered.
    """
    for name, expected in provenance(folder).sha256.items():
        try:
            found = hashlib.sha256((folder / name).read_bytes()).hexdigest()
        except OSError as error:
            raise broken(folder, f"{name} cannot be read ({error.strerror})") from error
        if found != expected:
            raise broken(folder, f"{name} was altered, as its checksum tells")
    return UPath(folder)


def provenance(folder: Path = FOLDER) -> Provenance:
    """What is known of the shipped weights; raises `TactileError` where there are none."""
    try:
        return unsealed_json((folder / PROVENANCE).read_bytes(), Provenance)
    except (OSError, ValueError) as error:
        raise broken(folder, f"{PROVENANCE} is missing or damaged") from error


def broken(folder: Path, reason: str) -> TactileError:
    return TactileError(
        f"the weights in {folder} are not those of the package ({reason}): install "
        "tactile-exploration again"
    )
