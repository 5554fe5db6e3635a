"""Hyperparameter search with Ray Tune: Bayesian optimisation with HyperBand (report, section V)."""

import random
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import ray
from pyarrow.fs import FSSpecHandler, PyFileSystem
from ray import tune
from ray.tune.schedulers import HyperBandForBOHB
from ray.tune.search.bohb import TuneBOHB
from upath import UPath

from tactile_core.cluster import running_ray
from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import TactileError
from tactile_core.finished import finished_table, keep_finished
from tactile_core.keys import work_key
from tactile_core.progress import SECONDS_BETWEEN_WORDS, to_go
from tactile_core.reconstruction.batches import TouchSource, outline_source
from tactile_core.reconstruction.trial import run_trial
from tactile_core.settings import SearchSettings
from tactile_core.spread import on_cluster


def search_unet(
    train: Shapes,
    eval_shapes: Shapes,
    settings: SearchSettings,
    *,
    touches: TouchSource | None = None,
    previous: pd.DataFrame | None = None,
    work: Path | UPath,
    token: Path,
    progress: Callable[[str], None] = lambda message: None,
) -> pd.DataFrame:
    """Run the trials and return one row each, best first: trial, learning_rate, batch_size,
    depth, channels, epochs, loss, jaccard (0–100, both on the eval split) and the search's key.
    `previous`, the table of an earlier search, is returned where it has the same key.

    `RAY_ADDRESS` names a running cluster; unset, a local Ray starts and is shut down, which asks
    for the secret in the file `token`. With `concurrent` 1 the same seed gives the same table.
    All nodes of a cluster must see `work`, a folder or a place in an object store: Ray keeps the
    trials' checkpoints there, and a trial whose node dies goes on elsewhere. `touches` replaces the
    uniform draw of outline touches that trials learn from. Raises `TactileError` where every trial
    failed.

    Ray cannot restore a BOHB search. So trials leave their epochs in `work`, keyed by what
    they tried: a search that was killed and starts again repeats the same suggestions and
    finds their epochs done.
    """
    touches = touches or outline_source(train)
    key = work_key(
        "reconstruction.search",
        settings=settings,
        seed=settings.seed,
        train=train.version,
        eval=eval_shapes.version,
        touches=touches.key,
    )
    if (made := finished_table(key, previous, work)) is not None:
        progress("U-Net search: kept, as nothing that it depends on has changed")
        return made
    progress("U-Net search: Ray starts, or answers")
    with running_ray(settings.concurrent, token), seeded(settings.seed):
        results = run_trials(train, eval_shapes, settings, touches, work.absolute(), progress)
    # A trial that failed keeps its last good report: it must not win the search by that.
    ended = [results[index] for index in range(len(results))]
    finished = [result.metrics or {} for result in ended if result.error is None]
    rows = [trial_row(metrics) for metrics in finished if "loss" in metrics]
    if not rows:
        reason = str(results.errors[0]).strip().splitlines()[-1] if results.errors else "no trial"
        raise TactileError(f"every trial of the U-Net search failed; the first says: {reason}")
    table = pd.DataFrame(rows).sort_values(["loss", "learning_rate"], ignore_index=True)
    table.insert(0, "trial", table.index + 1)
    progress(f"U-Net search: best of {len(table)} trials has eval Jaccard {table.jaccard[0]:.1f}")
    table = table.assign(key=key)
    keep_finished(table, work)
    return table


@contextmanager
def seeded(seed: int) -> Iterator[None]:
    """HpBandSter draws from the global generators: seed them for the block, then put them back."""
    before = random.getstate(), np.random.get_state()
    random.seed(seed)
    np.random.seed(seed)
    try:
        yield
    finally:
        random.setstate(before[0])
        np.random.set_state(before[1])


def run_trials(
    train: Shapes,
    eval_shapes: Shapes,
    settings: SearchSettings,
    touches: TouchSource,
    work: Path | UPath,
    progress: Callable[[str], None],
) -> tune.ResultGrid:
    """Let BOHB suggest and HyperBand pause trials until all have had their epochs."""
    trainable = tune.with_parameters(
        run_trial,
        train=train,
        eval_shapes=eval_shapes,
        settings=settings,
        touches=touches,
        work=work / "epochs",
    )
    tuner = tune.Tuner(
        tune.with_resources(trainable, resources_per_trial(settings.concurrent)),
        param_space=search_space(settings),
        tune_config=tune.TuneConfig(
            metric="loss",
            mode="min",
            num_samples=settings.trials,
            max_concurrent_trials=settings.concurrent,
            reuse_actors=True,  # a new process for each trial and resumption imports torch again
            search_alg=TuneBOHB(seed=settings.seed),
            scheduler=HyperBandForBOHB(
                time_attr="training_iteration",
                max_t=settings.epochs,
                reduction_factor=settings.reduction_factor,
            ),
        ),
        run_config=tune.RunConfig(
            name="ray",
            **storage(work),
            verbose=0,
            callbacks=[Reporter(settings, progress)],
            checkpoint_config=tune.CheckpointConfig(num_to_keep=1),
            # For a node that dies. Ray does not tell it from what makes a trial fail each time.
            failure_config=tune.FailureConfig(max_failures=int(on_cluster())),
        ),
    )
    return tuner.fit()


def storage(work: Path | UPath) -> dict[str, Any]:
    """Where Ray keeps the trials, in Tune's words."""
    if isinstance(work, Path):
        return {"storage_path": str(work)}
    files = PyFileSystem(FSSpecHandler(work.fs))
    return {"storage_path": work.path, "storage_filesystem": files}


def search_space(settings: SearchSettings) -> dict[str, Any]:
    """Report, Table I: the four hyperparameters. BOHB ignores quantised ranges, so choices."""
    return {
        "learning_rate": tune.loguniform(*settings.learning_rate),
        "batch_size": tune.choice(settings.batch_sizes),
        "depth": tune.choice(settings.depths),
        "channels": tune.choice(settings.channels),
    }


def resources_per_trial(concurrent: int) -> dict[str, float]:
    """An equal share of the cluster's processors and, where it has some, its GPUs.

    A trial runs on one node, so it gets no more than the largest has, and whole GPUs above one.
    """
    nodes = [node["Resources"] for node in ray.nodes() if node["Alive"]]
    shares = {}
    for name in ("CPU", "GPU"):
        there = [node.get(name, 0.0) for node in nodes]
        share = min(sum(there) / concurrent, max(there))
        shares[name.lower()] = float(int(share)) if share > 1 else share
    return {"cpu": max(1.0, shares["cpu"])} | ({"gpu": shares["gpu"]} if shares["gpu"] else {})


def trial_row(metrics: dict[str, Any]) -> dict[str, Any]:
    """The last report of a trial as a row of the table."""
    config = metrics["config"]
    return {
        "learning_rate": float(config["learning_rate"]),
        "batch_size": int(config["batch_size"]),
        "depth": int(config["depth"]),
        "channels": int(config["channels"]),
        "epochs": int(metrics["training_iteration"]),
        "loss": float(metrics["loss"]),
        "jaccard": float(metrics["jaccard"]),
    }


class Reporter(tune.Callback):
    """Tells `progress` of each epoch of each trial, of trials that failed, and how far it is."""

    def __init__(self, settings: SearchSettings, progress: Callable[[str], None]) -> None:
        self.settings = settings
        self.progress = progress
        self.numbers: dict[str, int] = {}
        self.began = self.said = time.monotonic()

    def __getstate__(self) -> dict[str, Any]:
        """Tune pickles its callbacks with the experiment; `progress` may hold a logger."""
        return {**self.__dict__, "progress": print}

    def on_trial_result(
        self, iteration: int, trials: list[Any], trial: Any, result: dict[str, Any], **info: Any
    ) -> None:
        row = trial_row(result)
        self.said = time.monotonic()
        number = self.numbers.setdefault(trial.trial_id, len(self.numbers) + 1)
        self.progress(
            f"U-Net search: trial {number}/{self.settings.trials} epoch {row['epochs']}: eval loss "
            f"{row['loss']:.4f}, Jaccard {row['jaccard']:.1f} (rate {row['learning_rate']:.1e}, "
            f"batch {row['batch_size']}, depth {row['depth']}, channels {row['channels']})"
        )

    def on_step_end(self, iteration: int, trials: list[Any], **info: Any) -> None:
        """Called all the time, where an epoch may take long."""
        now = time.monotonic()
        if now - self.said < SECONDS_BETWEEN_WORDS:
            return
        self.said = now
        done, total = sum(trial.is_finished() for trial in trials), self.settings.trials
        running = sum(trial.status == "RUNNING" for trial in trials)
        rest = to_go(now - self.began, done, total)
        self.progress(f"U-Net search: {done} of {total} trials done, {running} run{rest}")

    def on_trial_error(self, iteration: int, trials: list[Any], trial: Any, **info: Any) -> None:
        self.progress(f"U-Net search: trial {trial.trial_id} failed and is left out")
