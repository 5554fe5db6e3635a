"""Work that Ray tasks take over, where `RAY_ADDRESS` names a cluster.

What a task needs is sent to it, and what it makes comes back as a value: nodes share no disk but
the store. A task whose node dies begins anew on another one.
"""

import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

from tactile_core.errors import TactileError
from tactile_core.freed_memory import keep_freed_memory
from tactile_core.progress import SECONDS_BETWEEN_WORDS

Made = TypeVar("Made")
Progress = Callable[[str], None]

RETRIES = 3  # of a task that was lost with its node or its process
SECONDS_BETWEEN_LOOKS = 0.5


class Needs(NamedTuple):
    """What a task asks of its node.

    cpus : processors; None: half of those of the largest node, as on one machine
    gpu : whether it takes a whole GPU, where the cluster has one
    tasks_per_process : after so many a process is replaced; 0: never
    """

    cpus: int | None = 1
    gpu: bool = False
    tasks_per_process: int = 0


ONE_PROCESSOR = Needs()
TRAINING = Needs(gpu=True)  # of a policy: in one thread, see `learning.train`
LARGE_TRAINING = Needs(cpus=None, gpu=True)


def on_cluster() -> bool:
    """Whether `RAY_ADDRESS` names a Ray cluster."""
    return bool(os.environ.get("RAY_ADDRESS"))


def handed_over(
    make: Callable[..., Made],
    /,
    *given: Any,
    needs: Needs,
    progress: Progress,
    **named: Any,
) -> Made:
    """What `make(*given, progress=progress, **named)` returns: called here or, where there is a
    cluster, as one task there, whose words reach `progress`, too.

    The process that does it keeps the memory that it frees, see `freed_memory`."""
    part = (make, given, named)
    if not on_cluster():
        return called(part, progress)
    [(_, made)] = spread(called, [part], needs=needs, progress=progress, name=make.__name__)
    return made


def called(
    part: tuple[Callable[..., Made], tuple[Any, ...], dict[str, Any]], progress: Progress
) -> Made:
    make, given, named = part
    keep_freed_memory()
    return make(*given, progress=progress, **named)


def spread(
    make: Callable[..., Made],
    parts: Sequence[Any],
    *given: Any,
    needs: Needs = ONE_PROCESSOR,
    progress: Progress,
    name: str | None = None,
) -> Iterator[tuple[int, Made]]:
    """The number of each of `parts` with what `make(part, *given, progress=…)` returns, as they
    come. `given` is sent to each node once.

    name : of the processes, as `ps` shows them; None: that of `make`

    What `make` raises is raised here; a task that is lost `RETRIES` times more raises
    `TactileError`.
    """
    import ray

    from tactile_core.cluster import joined
    from tactile_core.nodes import versions

    name = name or make.__name__
    with joined():
        words = messages()
        shared = ray.put((make, versions(), given, words))
        remote: Any = ray.remote  # its types know no names
        task = remote(name=name, **options(needs))(taken_over)
        numbers = {task.remote(part, shared): number for number, part in enumerate(parts)}
        waiting = list(numbers)
        nodes: Counter[str] = Counter()
        heard = time.monotonic()
        while waiting:
            done, waiting = ray.wait(waiting, timeout=SECONDS_BETWEEN_LOOKS)
            news = words.get_nowait_batch(words.qsize())
            if not news and time.monotonic() - heard >= SECONDS_BETWEEN_WORDS:
                news = [f"{name}: {len(waiting)} of {len(parts)} tasks are with the Ray cluster"]
            if news:
                heard = time.monotonic()
            for message in news:
                progress(message)
            for one in done:
                node, made = result_of(one)
                nodes[node] += 1
                yield numbers.pop(one), made
    by = ", ".join(f"{count} on {node}" for node, count in sorted(nodes.items()))
    progress(f"{name}: done by the Ray cluster, {by}")


def in_order(made: Iterator[tuple[int, Made]]) -> Iterator[Made]:
    """What `spread` gives, each after the one before it."""
    early: dict[int, Made] = {}
    following = 0
    for number, one in made:
        early[number] = one
        while following in early:
            yield early.pop(following)
            following += 1


def taken_over(part: Any, shared: tuple[Any, ...]) -> tuple[str, Any]:
    """What is made of `part` in a process of a node, and which node that is."""
    import ray

    from tactile_core.nodes import refuse_others, versions
    from tactile_core.processes import end_with_raylet

    make, expected, given, words = shared
    address = ray.util.get_node_ip_address()
    refuse_others(address, versions(), expected)
    end_with_raylet()
    os.environ.pop("RAY_ADDRESS", None)  # what it calls is not spread again
    node = f"{address} ({ray.get_runtime_context().get_node_id()[:8]})"
    return node, make(part, *given, progress=words.put)


def options(needs: Needs) -> dict[str, Any]:
    """What a task `needs`, in Ray's words, on the cluster that is connected."""
    from tactile_core.nodes import working_nodes

    nodes = [node["Resources"] for node in working_nodes()]
    cpus = needs.cpus or (int(max(node["CPU"] for node in nodes)) + 1) // 2
    there = any(node.get("GPU", 0) >= 1 for node in nodes)
    return {
        "num_cpus": cpus,
        "num_gpus": int(needs.gpu and there),
        "max_retries": RETRIES,
        "max_calls": needs.tasks_per_process,
    }


def messages() -> Any:
    """A queue that lives as long as this process's own node, whatever becomes of the others."""
    import ray
    from ray.util.queue import Queue
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    here = ray.get_runtime_context().get_node_id()
    beside = NodeAffinitySchedulingStrategy(here, soft=False)
    return Queue(actor_options={"num_cpus": 0, "scheduling_strategy": beside})


def result_of(task: Any) -> Any:
    """What a task returned, or raised."""
    import ray
    from ray.exceptions import RayError, RayTaskError

    try:
        return ray.get(task)
    except RayTaskError as error:
        raise (error.cause if isinstance(error.cause, Exception) else error) from None
    except RayError as error:
        reason = str(error).strip().splitlines()[0][:300]
        raise TactileError(
            f"a task of the Ray cluster was lost {RETRIES + 1} times, with its node or for want of "
            f"memory ({reason}): mend that, then run again"
        ) from error
