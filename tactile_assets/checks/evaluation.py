"""Checks of what the policies come to."""

import dagster as dg
import pandas as pd

from tactile_assets.checks.telling import UNLESS_SMOKE
from tactile_assets.metadata import number, numbers


@dg.asset_check(asset="per_step_evaluation")
def trained_policies_beat_random(per_step_evaluation: pd.DataFrame) -> dg.AssetCheckResult:
    """After the last ray every trained policy has a higher mean Jaccard index than `random`, which
    went with the same U-Net."""
    from tactile_core.exploration.policies.references import REFERENCES

    table = per_step_evaluation
    last = table[table["step"] == table["step"].max()]
    means = last.groupby(["policy", "seed"], as_index=False)["jaccard"].mean()
    random = means[means["policy"] == "random"].set_index("seed")["jaccard"]
    if random.empty:
        return dg.AssetCheckResult(passed=True, description="random was not evaluated")
    trained = means[~means["policy"].isin(REFERENCES)]
    # All policies go with the only U-Net, else each with that of its seed.
    bars = trained["seed"].map(random) if len(random) > 1 else random.iloc[0]
    worse = trained[~(trained["jaccard"] > bars)]
    bar = float(random.mean())
    return dg.AssetCheckResult(
        passed=worse.empty,
        severity=UNLESS_SMOKE,
        description=f"{len(worse)} of {len(trained)} policies do not beat random ({bar:.1f})",
        metadata={
            "policies_below_random": len(worse),
            "jaccard_of_random": number(bar),
            **numbers("jaccard", trained.groupby("policy")["jaccard"].mean()),
        },
    )


@dg.asset_check(asset="per_grasp_evaluation")
def touches_raise_the_jaccard_index(per_grasp_evaluation: pd.DataFrame) -> dg.AssetCheckResult:
    """With all touches held, every policy has a higher mean Jaccard index than with the first."""
    table = per_grasp_evaluation.dropna(subset="jaccard")
    by_grasp = table.groupby(["policy", "grasp"])["jaccard"].mean().unstack()
    raised = by_grasp.iloc[:, -1] - by_grasp.iloc[:, 0]
    lower = raised.index[~(raised > 0)]
    return dg.AssetCheckResult(
        passed=lower.empty,
        severity=UNLESS_SMOKE,
        description=f"{len(lower)} of {len(raised)} policies reconstruct no better at the end",
        metadata={"policies_no_better": len(lower), **numbers("raised_by", raised)},
    )
