"""Which of the stored policies a run trained last: `index.json` beside their directories.

Trainings store their own directories. Those of approaches that are no longer trained stay there,
and out of the evaluations.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

from upath import UPath

from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.exploration.policies.store import describe
from tactile_core.files import kept_bytes, written_whole

INDEX = "index.json"


def write_index(folder: UPath, versions: Mapping[str, str]) -> None:
    """versions : of the policies in `folder`, by the names of their directories."""
    with written_whole(folder / INDEX) as file:
        file.write(json.dumps(dict(versions), indent=2).encode())


def read_index(folder: UPath) -> list[UPath]:
    """The directories of the policies that a run left in `folder`.

    Raises `TactileError` where there are none, or one is of another training.
    """
    versions = read_versions(folder)
    for name, version in versions.items():
        description = describe(folder / name)
        if (description.name, description.version) != (name, version):
            raise TactileError(
                f"{folder / name} is of another training than {INDEX} says: materialise policies "
                "again"
            )
    return [folder / name for name in versions]


def read_versions(folder: UPath) -> dict[str, str]:
    """What `write_index` wrote; raises `TactileError` where nothing did, or it is damaged."""
    try:
        data = kept_bytes(folder / INDEX)
        versions = json.loads(data, object_pairs_hook=each_once)
    except OutOfReachError:
        raise
    except (OSError, ValueError) as error:
        raise TactileError(f"{folder} holds no trained policies: materialise policies") from error
    if not isinstance(versions, dict) or not all(map(is_entry, versions.items())):
        raise TactileError(f"{folder}/{INDEX} is damaged: materialise policies again")
    return versions


def each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object; raises `ValueError` where it names something twice, as a changed bit may."""
    if len(dict(pairs)) < len(pairs):
        raise ValueError("it names something twice")
    return dict(pairs)


def is_entry(entry: tuple[str, Any]) -> bool:
    """Whether a policy's name and version are plain words, and none that leads elsewhere."""
    return all(isinstance(word, str) and re.fullmatch(r"[\w-]+", word) for word in entry)
