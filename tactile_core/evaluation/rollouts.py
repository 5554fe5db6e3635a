"""Every ray of every policy on every shape to test on: what both evaluations read (section VII)."""

import threading
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import replace
from pathlib import Path

import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import TactileError
from tactile_core.evaluation.casting import Casting, cast_one
from tactile_core.evaluation.far_casting import cast_on_cluster
from tactile_core.exploration.policies.base import Policy
from tactile_core.exploration.policies.references import REFERENCES, find_reference
from tactile_core.keys import CORE, work_key
from tactile_core.machine import processors
from tactile_core.progress import SECONDS_BETWEEN_WORDS, teller
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.settings import RolloutSettings
from tactile_core.spread import on_cluster
from tactile_core.threads import one_thread

Progress = Callable[[str], None]

RULE = "rule"  # the choice of a policy that has no distribution of rays


def cast_rollouts(
    policies: Sequence[Policy],
    test: Shapes,
    unet: TrainedUNet,
    settings: RolloutSettings,
    previous: pd.DataFrame | None = None,
    progress: Progress = lambda message: None,
    workers: int | None = None,
    work: Path | None = None,
    seed_of_references: int = 0,
) -> pd.DataFrame:
    """Rays of each policy on every test sample until `settings.count` rays are cast and as many
    touches held, or `settings.ray_limit` rays are cast.

    previous : the rollouts of an earlier run; those whose key is the same are kept
    workers : policies at a time; None: as many as there are CPUs, and one on a GPU; on a Ray
        cluster as many as fit there
    work : keeps what is cast, so that a run that was killed goes on there
    seed_of_references : what stands in the column seed for rules, and what they draw from

    Rows: policy, seed, choice ("likeliest", "drawn", or "rule" where there is no distribution to
    choose from), sample_id, model_id, category, ray (from 1), alpha and beta (see `circle_pixels`),
    row and column of the touch (−1 for a miss), missed, repeated, touches held, jaccard (0–100),
    and key: of all that the row depends on.
    """
    everyone = with_references(policies, settings, seed_of_references)
    reconstructor = Reconstructor(unet)
    progress(f"rollouts: the U-Net runs through {reconstructor.runs}")
    tables: dict[str, pd.DataFrame] = {}
    if previous is not None and "key" in previous:
        tables = {str(key): rows for key, rows in previous.groupby("key", sort=False)}
    castings = [
        Casting(policy, choice, rollout_key(policy, choice, test, reconstructor, settings))
        for policy in everyone
        for choice in (settings.choices if policy.draws else [RULE])
    ]
    missing = [casting for casting in castings if casting.key not in tables]
    if len(missing) < len(castings):
        progress(
            f"rollouts: {len(castings) - len(missing)} of {len(castings)} are kept as they are"
        )
    if workers is None:
        workers = processors() if reconstructor.device.type == "cpu" else 1
    if on_cluster():
        tables |= cast_on_cluster(missing, test, unet, settings, reconstructor, progress, work)
    else:
        with one_thread():
            tables |= cast_missing(missing, test, unet, settings, progress, workers, work)
    return pd.concat([tables[casting.key] for casting in castings], ignore_index=True)


def cast_missing(
    castings: list[Casting],
    test: Shapes,
    unet: TrainedUNet,
    settings: RolloutSettings,
    progress: Progress,
    workers: int,
    work: Path | None,
) -> dict[str, pd.DataFrame]:
    """The rollouts of each of `castings` by its key; it says how far they are."""
    own = threading.local()

    def cast(casting: Casting) -> pd.DataFrame:
        if not hasattr(own, "reconstructor"):  # what OpenVINO compiled serves one thread
            own.reconstructor = Reconstructor(unet)
        return cast_one(casting, test, own.reconstructor, settings, work)

    tables: dict[str, pd.DataFrame] = {}
    tell = teller(progress, len(castings))
    with ThreadPoolExecutor(workers) as pool:
        under_way = {pool.submit(cast, casting): casting for casting in castings}
        try:
            while under_way:
                over, _ = wait(under_way, SECONDS_BETWEEN_WORDS, FIRST_COMPLETED)
                for future in over:
                    casting = under_way.pop(future)
                    tables[casting.key] = future.result()
                    progress(summary(casting, tables[casting.key], settings))
                done = sum(casting.done for casting in castings)
                words = f"rollouts: {done / len(castings):.0%} of {len(castings)}, one for each"
                if under_way:
                    tell(done, f"{words} policy and choice")
        finally:
            for casting in castings:
                casting.stop.set()
            pool.shutdown(cancel_futures=True)
    return tables


def rollout_key(
    policy: Policy,
    choice: str,
    test: Shapes,
    reconstructor: Reconstructor,
    settings: RolloutSettings,
) -> str:
    """The key of all that the rollouts of a policy by a choice depend on."""
    return work_key(
        *code_behind(policy),
        settings=settings.model_dump(include={"count", "ray_limit"}),
        seed=settings.seed,
        policy=f"{policy.name}-{policy.seed}-{policy.version}",
        choice=choice,
        unet=reconstructor.version,
        runs=reconstructor.runs,
        shapes=test.version,
    )


def code_behind(policy: Policy) -> list[str]:
    """The modules of the core that cast a policy's rays, that of its own class among them."""
    modules = ["evaluation.rollouts", "exploration.policies.store"]
    package, _, own = type(policy).__module__.partition(".")
    return [*modules, own] if package == CORE else modules


def summary(casting: Casting, table: pd.DataFrame, settings: RolloutSettings) -> str:
    """What the rollouts of one policy came to, in a line."""
    after = table.loc[table["ray"] == settings.count, "jaccard"].mean()
    rays = len(table) / table["sample_id"].nunique()
    held = table.groupby("sample_id")["touches"].max().ge(settings.count).mean()
    return (
        f"rollouts: {casting.name} reaches Jaccard {after:.1f} after {settings.count} rays, and "
        f"{settings.count} touches on {held:.0%} of the shapes; {rays:.1f} rays each"
    )


def with_references(
    policies: Sequence[Policy], settings: RolloutSettings, seed: int = 0
) -> list[Policy]:
    """The reference policies that `settings` name, or all there are, then the trained ones.

    Raises `TactileError` where two have one name and seed: no table could tell them apart.
    """
    names = REFERENCES if settings.references is None else settings.references
    every = [*(replace(find_reference(name), seed=seed) for name in names), *policies]
    twice = [who for who, n in Counter((one.name, one.seed) for one in every).items() if n > 1]
    if twice:
        name, seed = twice[0]
        raise TactileError(f"two policies are called {name!r} with seed {seed}: rename an approach")
    return every
