"""Who computes, so that the page answers at once."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Workers:
    """A thread for all players' rays and one for all opponents': what OpenVINO compiled serves one
    thread, and nobody waits until a policy has thought."""

    players: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1))
    opponents: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1))


async def on(thread: ThreadPoolExecutor, work: Callable[..., T], *given: object) -> T:
    """What `work` returns, done by a thread after all that it was given before."""
    return await asyncio.get_running_loop().run_in_executor(thread, work, *given)
