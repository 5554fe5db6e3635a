"""Whether the nodes of a Ray cluster have this very package: else what they make would differ."""

import functools
import importlib.metadata
import sys
from typing import Any

import ray
from ray.exceptions import RayError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from tactile_core.errors import TactileError
from tactile_core.files import content_hash
from tactile_core.keys import FOLDER, LIBRARIES, installed_version

NAME = "tactile-exploration"
LOOK_SECONDS = 20  # a process has to start on each node, and to import this package

Versions = dict[str, str]


@functools.cache
def versions() -> Versions:
    """What results depend on, by name: this package, Python, and the libraries that compute."""
    files = sorted(FOLDER.rglob("*.py"))
    code = content_hash(
        *(
            part
            for file in files
            for part in (file.relative_to(FOLDER).as_posix(), file.read_bytes())
        )
    )
    return {
        NAME: f"{importlib.metadata.version(NAME)} (code {code[:8]})",
        "Python": ".".join(map(str, sys.version_info[:2])),
        **{library: installed_version(library) for library in LIBRARIES},
    }


def check_nodes() -> None:
    """Raises `TactileError` where a node that works has other versions than this process, which is
    connected. Nodes that take longer than `LOOK_SECONDS` to tell do so with their first task."""
    nodes = {node["NodeID"]: node["NodeManagerAddress"] for node in working_nodes()}
    if not nodes:
        raise TactileError("no node of the Ray cluster has processors: start one that has")
    looks = {look_at(node): address for node, address in nodes.items()}
    told, _ = ray.wait(list(looks), num_returns=len(looks), timeout=LOOK_SECONDS)
    for look in told:
        try:
            theirs = ray.get(look)
        except RayError:  # it has just died
            continue
        refuse_others(looks[look], theirs, versions())


def working_nodes() -> list[dict[str, Any]]:
    """The nodes of the cluster that is connected that are alive and have processors."""
    return [node for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU")]


def look_at(node: str) -> ray.ObjectRef:
    """Begin to ask a node for its `versions`, or in a string why it has none to tell."""

    # A function inside another travels as code: it runs where this package is not installed.
    def look() -> Versions | str:
        try:
            from tactile_core.nodes import versions
        except ImportError as error:
            return str(error)
        return versions()

    here = NodeAffinitySchedulingStrategy(node, soft=False)
    return ray.remote(look).options(num_cpus=0, scheduling_strategy=here).remote()


def refuse_others(address: str, theirs: Versions | str, mine: Versions) -> None:
    """Raises `TactileError` unless the node at `address` told the same versions as `mine`."""
    if isinstance(theirs, str):
        problem = f"lacks this package, or part of it ({theirs})"
    else:
        others = [name for name in mine if theirs.get(name) != mine[name]]
        if not others:
            return
        name = others[0]
        problem = f"has {name} {theirs.get(name) or 'not at all'}, and this process {mine[name]}"
    raise TactileError(
        f"node {address} of the Ray cluster {problem}: install there what is installed here, from "
        "the same commit and with the same constraints.txt, or stop that node"
    )
