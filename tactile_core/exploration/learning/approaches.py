"""Training approaches: the report's four (section VI.B), and where to add your own.

An approach is one entry of `APPROACHES`. PPO trains each stage for `steps_per_stage` rays,
going on from the policy of the stage before.
"""

from tactile_core.errors import TactileError
from tactile_core.exploration.learning.approach import Approach
from tactile_core.exploration.world.rewards import DIFF, TOTAL, Stage, diff, total

APPROACHES: dict[str, Approach] = {
    approach.name: approach
    for approach in (
        Approach(
            "diff",
            "Rewards what a ray adds to the Jaccard index; −10 for a miss or repeat.",
            (DIFF,),
        ),
        Approach(
            "total",
            "Rewards the Jaccard index after each ray; −10 for a miss or repeat.",
            (TOTAL,),
        ),
        Approach(
            "total_miss",
            "Rewards the Jaccard index without penalty until ten touches are held, then "
            "trains as long again as total.",
            (Stage(total, ends="touches"), TOTAL),
        ),
        Approach(
            "pre_diff_miss",
            "Rewards what a ray adds to the Jaccard index without penalty, until ten touches "
            "are held.",
            (Stage(diff, ends="touches"),),
        ),
        Approach(
            "gain",
            "Beyond the report: gives every candidate ray a value, learnt from what its touch "
            "adds to the Jaccard index on train shapes. `recall` comes with it: it tries the best "
            "of these rays on train shapes that agree with what was felt.",
            learner="gains",
        ),
        Approach(
            "sequence",
            "Beyond the report: ten rays, the same for every shape, that are best on average on "
            "train shapes. It tells what adapting to a shape is worth.",
            learner="sequence",
        ),
    )
}


def find_approach(name: str) -> Approach:
    """The approach of that name; raises `TactileError` naming the known ones."""
    if name not in APPROACHES:
        raise TactileError(
            f"approach {name!r} is unknown: choose from {', '.join(APPROACHES)}, or add an entry "
            "to APPROACHES in tactile_core/exploration/learning/approaches.py"
        )
    return APPROACHES[name]
