"""The report's two evaluations (section VII) as readings of the rollouts: per step, per grasp."""

import numpy as np
import pandas as pd

from tactile_core.errors import TactileError
from tactile_core.settings import EvaluationSettings

WHO = ["policy", "seed", "sample_id", "model_id", "category"]


def per_step_reading(rollouts: pd.DataFrame, settings: EvaluationSettings) -> pd.DataFrame:
    """The first `settings.count` rays of each policy on every sample (Figure 4).

    Rows: policy, seed, sample_id, model_id, category, step (from 1), jaccard (0–100),
    touches held, missed, repeated.
    """
    chosen = by_choice(rollouts, settings)
    steps = chosen[chosen["ray"] <= settings.count].rename(columns={"ray": "step"})
    columns = [*WHO, "step", "jaccard", "touches", "missed", "repeated"]
    return steps[columns].reset_index(drop=True)


def per_grasp_reading(rollouts: pd.DataFrame, settings: EvaluationSettings) -> pd.DataFrame:
    """Rays of each policy until `settings.count` touches are held (Figure 5).

    Rows: policy, seed, sample_id, model_id, category, grasp (from 1), jaccard (0–100; null
    where the limit of rays did not bring so many touches) and rays cast until then.
    """
    chosen = by_choice(rollouts, settings)
    rollout = chosen.groupby(["policy", "seed"], sort=False)
    every = [grasps_of(rows, settings.count) for _, rows in rollout]
    return pd.concat(every, ignore_index=True)


def grasps_of(rows: pd.DataFrame, count: int) -> pd.DataFrame:
    """The rows of one policy, grasp by grasp, each in the order of the samples."""
    samples = rows.drop_duplicates("sample_id")[WHO]
    gained = rows[~rows["missed"] & ~rows["repeated"]].set_index(["touches", "sample_id"])
    cast = rows.groupby("sample_id")["ray"].max().reindex(samples["sample_id"]).to_numpy()
    tables = []
    for grasp in range(1, count + 1):
        index = pd.MultiIndex.from_product([[grasp], samples["sample_id"]])
        found = gained.reindex(index)
        table = samples.assign(grasp=grasp, jaccard=found["jaccard"].to_numpy())
        rays = found["ray"].to_numpy()
        tables.append(table.assign(rays=np.where(np.isnan(rays), cast, rays).astype(int)))
    return pd.concat(tables)


def by_choice(rollouts: pd.DataFrame, settings: EvaluationSettings) -> pd.DataFrame:
    """The rollouts by rules and, of policies that draw their rays, those by `settings.choice`.

    Raises `TactileError` where they were not cast so, or not so long.
    """
    drawn = rollouts["choice"] != "rule"
    chosen = rollouts[~drawn | (rollouts["choice"] == settings.choice)]
    who = ["policy", "seed"]
    missing = set(map(tuple, rollouts[who].values)) - set(map(tuple, chosen[who].values))
    if missing:
        raise TactileError(
            f"rollouts hold no {settings.choice!r} rays of {min(missing)[0]!r}: add this choice to "
            "`choices` of rollouts, or read another one"
        )
    last = chosen.groupby([*who, "sample_id"]).agg(ray=("ray", "max"), touches=("touches", "max"))
    limit = last["ray"].max()
    ended = (last["touches"] < settings.count) & (last["ray"] < limit)
    if ended.any() or limit < settings.count:
        raise TactileError(
            f"rollouts end before {settings.count} rays or touches: raise `count` of rollouts, or "
            "read fewer"
        )
    return chosen
