"""The report's findings (section VII), one by one: what it says, what a run came to, and whether
that is the same.

Every row says by what it is judged. Where a run lacks a policy, rows that need it are left out.
"""

from collections.abc import Iterator
from typing import NamedTuple

import pandas as pd

from tactile_core.dataset.shapes import Shapes
from tactile_core.evaluation.seen_in_pictures import (
    HALF_CIRCLE,
    in_common,
    other_half,
    told_by_radius,
)
from tactile_core.evaluation.statistics import REPORTS
from tactile_core.evaluation.tables import REPORT_TABLE_II, PolicyResults, around
from tactile_core.exploration.world.rays import RAYS
from tactile_core.reconstruction.inference import Reconstructor

NEAR = 3.0  # points of the Jaccard index
# Of a ratio of rays, whether all rollouts above it, and below it, got their touches.
BOUNDS = {(True, True): "", (False, True): "≥ ", (True, False): "≤ ", (False, False): "≈ "}


class Finding(NamedTuple):
    """same : what the report found is found here as well, as `judged` says"""

    finding: str
    report: str
    ours: str
    judged: str
    same: bool


def findings(
    reconstruction: pd.DataFrame,
    per_step: PolicyResults,
    per_grasp: PolicyResults,
    rollouts: pd.DataFrame,
    test: Shapes,
    reconstructor: Reconstructor,
) -> pd.DataFrame:
    """The findings as strings, in the report's order.

    reconstruction : as `evaluate_reconstruction` gives it; rollouts : those that `per_step` is of
    """
    steps = per_step.summary.set_index("policy")
    grasps = per_grasp.summary.set_index("policy")
    curve = per_step.curve.pivot_table("mean", "policy", "step")
    # What it says of ten rays and ten touches cannot be said of fewer, or more.
    ten = {int(per_step.curve["step"].max()), int(per_grasp.curve["grasp"].max())} == {RAYS}
    rows = [
        *of_reconstruction(reconstruction),
        *of_first_guess(test, reconstructor),
        *(of_steps(steps, curve) if ten else []),
        *of_rays(rollouts, test.resolution),
        *(of_grasps(steps, grasps) if ten else []),
    ]
    table = pd.DataFrame(rows)
    return table.assign(same=table["same"].map({True: "yes", False: "no"}))


def of_reconstruction(reconstruction: pd.DataFrame) -> Iterator[Finding]:
    """Table II."""
    mixed = reconstruction[reconstruction["touches"].isna()]
    jaccard = mixed.groupby("split")["jaccard"].mean()
    theirs = {split: jaccard for split, (_, jaccard) in REPORT_TABLE_II.items()}
    yield Finding(
        "The reconstruction of test shapes from 1 to 10 touches (Table II)",
        f"{theirs['test']:.1f}", f"{jaccard['test']:.1f}", "at least as good",
        jaccard["test"] >= theirs["test"],
    )  # fmt: skip
    yield Finding(
        "It is nearly the same on test as on eval",
        f"{theirs['test'] - theirs['eval']:+.1f}", f"{jaccard['test'] - jaccard['eval']:+.1f}",
        f"less than {NEAR:.0f} apart", abs(jaccard["test"] - jaccard["eval"]) < NEAR,
    )  # fmt: skip


def of_first_guess(test: Shapes, reconstructor: Reconstructor) -> Iterator[Finding]:
    """What the U-Net predicts of what it has not felt."""
    share = told_by_radius(reconstructor.untouched)
    yield Finding(
        "What is predicted without a touch is bounded by a circle about the middle",
        "seen in pictures", f"{share:.0%}",
        "over 90 % of its variance is told by the distance from the middle", share > 0.9,
    )  # fmt: skip
    before, after = other_half(test, reconstructor)
    yield Finding(
        "The U-Net uses the symmetry of shapes: touches on one side tell of the other",
        "seen in pictures", f"{before:.1f} → {after:.1f}",
        "the half without a touch is better after ten touches on the other", after > before,
    )  # fmt: skip


def of_steps(steps: pd.DataFrame, curve: pd.DataFrame) -> Iterator[Finding]:
    """Figure 4: after each of ten rays."""
    if "random" not in steps.index:
        return
    random = steps.loc["random"]
    yield Finding(
        "`random` after ten rays (Figure 4)", "≈ 60", told(random, "last"), near(60),
        abs(random["last"] - 60) <= NEAR,
    )  # fmt: skip
    there = [name for name in REPORTS if name in steps.index]
    for name in there:
        policy = steps.loc[name]
        yield Finding(
            f"`{name}` after ten rays", "≈ 80", told(policy, "last"), near(80),
            abs(policy["last"] - 80) <= NEAR,
        )  # fmt: skip
        yield Finding(
            f"`{name}` is above `random` after ten rays", "by about 20",
            f"by {policy['last'] - random['last']:.1f}", "intervals apart",
            policy["last_low"] > random["last_high"],
        )  # fmt: skip
    if len(there) == len(REPORTS):
        rise = (curve[3] - curve[1]).loc[list(there)]
        others = rise.drop("pre_diff_miss")
        yield Finding(
            "`pre_diff_miss`, without a penalty, rises more slowly in the first rays",
            "seen in Figure 4",
            f"{rise['pre_diff_miss']:+.1f} beside {others.min():+.1f} to {others.max():+.1f}",
            "less than each of the others from ray 1 to ray 3",
            rise["pre_diff_miss"] < others.min(),
        )


def of_rays(rollouts: pd.DataFrame, resolution: int) -> Iterator[Finding]:
    """Where rays come from (Figures 2 and 3)."""
    common = in_common(rollouts, resolution)
    for name in (name for name in REPORTS if name in common):
        yield Finding(
            f"`{name}` casts its rays from one side",
            "seen in pictures", f"{common[name]:.2f}",
            f"starts have more in common than if spread over half of the circle "
            f"({HALF_CIRCLE:.2f}; 1: one direction)",
            common[name] > HALF_CIRCLE,
        )  # fmt: skip


def of_grasps(steps: pd.DataFrame, grasps: pd.DataFrame) -> Iterator[Finding]:
    """Figure 5: at each of ten touches."""
    if "random" not in grasps.index:
        return
    random = grasps.loc["random"]
    yield Finding(
        "`random` at ten touches (Figure 5)", "≈ 90", told(random, "last"), near(90),
        abs(random["last"] - 90) <= NEAR,
    )  # fmt: skip
    for name in (name for name in REPORTS if name in grasps.index):
        policy = grasps.loc[name]
        yield Finding(
            f"`random` is above `{name}` at ten touches", "by about 10",
            f"by {random['last'] - policy['last']:.1f}", "intervals apart",
            random["last_low"] > policy["last_high"],
        )  # fmt: skip
        change = policy["last"] - steps.loc[name, "last"]
        if name == "pre_diff_miss":
            yield Finding(
                f"`{name}` is better at ten touches than after ten rays", "slightly",
                f"{change:+.1f}", "better", change > 0,
            )  # fmt: skip
        else:
            yield Finding(
                f"`{name}` is nearly the same at ten touches as after ten rays", "nearly",
                f"{change:+.1f}", f"less than {NEAR:.0f} apart", abs(change) < NEAR,
            )  # fmt: skip
        ratio = random["rays"] / policy["rays"]
        bound = BOUNDS[bool(random["reached"] == 1), bool(policy["reached"] == 1)]
        yield Finding(
            f"`random` needs more than three times the rays of `{name}`", "> 3",
            f"{bound}{ratio:.1f}", "mean number of rays until ten touches",
            ratio > 3 and policy["reached"] == 1,
        )  # fmt: skip


def told(policy: pd.Series, name: str) -> str:
    """A quantity of a summary with its interval."""
    return around(policy[name], policy[f"{name}_low"], policy[f"{name}_high"])


def near(value: int) -> str:
    return f"within {NEAR:.0f} of {value}"
