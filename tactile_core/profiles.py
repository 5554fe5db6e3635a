"""The profiles: a set of all settings for each kind of machine and aim.

`active_profile` reads `TACTILE_PROFILE` (smoke, laptop, study, report or paper),
`TACTILE_SHAPENET` (where the meshes come from; unset: generated mugs and bottles) and
`TACTILE_REAL` (real meshes to evaluate on besides).
"""

import os
from collections.abc import Mapping

from pydantic import Field

from tactile_core.addresses import setting_of
from tactile_core.errors import TactileError
from tactile_core.home import remembered_profile
from tactile_core.settings import (
    Address,
    EvaluationSettings,
    MaskSettings,
    MeshSettings,
    ObserverSettings,
    PolicySettings,
    PracticeSettings,
    RolloutSettings,
    SearchSettings,
    Settings,
    SplitSettings,
    TouchSettings,
    UNetSettings,
)


class Profile(Settings):
    """The settings of all stages for one kind of machine."""

    name: str
    real: Address | None = Field(
        None, description="Folder or URL of real meshes to evaluate on besides, as `location`."
    )
    meshes: MeshSettings = MeshSettings()
    masks: MaskSettings = MaskSettings()
    splits: SplitSettings = SplitSettings()
    touches: TouchSettings = TouchSettings()
    search: SearchSettings = SearchSettings()
    practice: PracticeSettings | None = Field(
        None, description="What `practice_rays` is made with; without it there is no such asset."
    )
    unet: UNetSettings = UNetSettings()
    policies: PolicySettings = PolicySettings()
    rollouts: RolloutSettings = RolloutSettings()
    observer: ObserverSettings | None = Field(
        None,
        description="What `attainable_rollouts` is made with; without it, and where the meshes "
        "are not generated, there is no such asset.",
    )
    per_step: EvaluationSettings = EvaluationSettings(choice="likeliest")
    per_grasp: EvaluationSettings = EvaluationSettings()

    @property
    def attainable(self) -> bool:
        """Whether ideal observers are asked: where as many shapes as they like can be generated."""
        return self.observer is not None and self.meshes.location is None


# Four short epochs favour nets that learn fast and end poor: none of those is offered.
LAPTOP_SEARCH = SearchSettings(
    samples_per_epoch=1024,
    learning_rate=[1e-3, 4e-3],
    batch_sizes=[32, 48],
    depths=[3, 4],
    channels=[12, 16],
)

# PPO's entropy coefficient where a tenth of the report's rays are cast: with the report's 0.01
# `pre_diff_miss` learns to hit by luck.
SHORT_ENTROPY = 0.001

PROFILES = {
    "smoke": Profile(
        name="smoke",
        meshes=MeshSettings(procedural_models={"mug": 12, "bottle": 18}),
        splits=SplitSettings(rotations=2),
        touches=TouchSettings(sets_per_mask=2),
        search=SearchSettings(
            trials=2,
            epochs=2,
            batch_sizes=[8],
            depths=[3],
            channels=[8],
            learning_rate=[1e-3, 3e-3],
        ),
        unet=UNetSettings(epochs=12),
        policies=PolicySettings(
            steps_per_stage=512, environments=16, gain_iterations=20, gain_tries=4
        ),
        rollouts=RolloutSettings(choices=["drawn"], ray_limit=60),
        per_step=EvaluationSettings(resamples=200),
        per_grasp=EvaluationSettings(resamples=200),
    ),
    "laptop": Profile(
        name="laptop",
        search=LAPTOP_SEARCH,
        policies=PolicySettings(entropy=SHORT_ENTROPY),
        # After a tenth of the report's training a policy has a good distribution of rays, but
        # its single most likely ray hardly depends on what was felt.
        rollouts=RolloutSettings(choices=["drawn"]),
        per_step=EvaluationSettings(),
    ),
    # The laptop's data and nets, with all that was found to help, and three seeds of U-Net and
    # policies.
    "study": Profile(
        name="study",
        search=LAPTOP_SEARCH,
        practice=PracticeSettings(epochs=30, patience=20, free_space=True),
        unet=UNetSettings(
            epochs=60, patience=20, free_space=True, known_shapes=True, further_seeds=[1, 2]
        ),
        policies=PolicySettings(seeds=[0, 1, 2], entropy=SHORT_ENTROPY),
        rollouts=RolloutSettings(choices=["drawn"]),
        observer=ObserverSettings(),
        per_step=EvaluationSettings(),
    ),
    # Every value the report's own wherever two cores can bear it; docs/report.md has the rest.
    "report": Profile(
        name="report",
        masks=MaskSettings(resolution=256),
        search=SearchSettings(
            trials=10,
            epochs=3,
            samples_per_epoch=512,
            touches="stored",
            learning_rate=[1e-4, 1e-2],
            batch_sizes=[4, 8, 16],
            depths=[4, 5, 6],
            channels=[8, 12],
        ),
        unet=UNetSettings(epochs=40, patience=8, touches="stored"),
        policies=PolicySettings(
            steps_per_stage=500_000,
            environments=40,
            rays_per_rollout=50,
            batch_size=50,
            epochs=10,
            learning_rate=3e-5,
            reward_scale=1.0,
        ),
    ),
    "paper": Profile(
        name="paper",
        masks=MaskSettings(resolution=256),
        search=SearchSettings(
            trials=100,
            epochs=10,
            touches="stored",
            learning_rate=[1e-7, 1e-2],
            batch_sizes=[4, 8, 16],
            depths=[3, 4, 5, 6],
            channels=[16, 32, 64, 128, 256],
        ),
        unet=UNetSettings(epochs=200, patience=20, touches="stored"),
        policies=PolicySettings(seeds=[0, 1, 2], steps_per_stage=500_000),
    ),
}


def active_profile(environ: Mapping[str, str] = os.environ) -> Profile:
    """The profile that `TACTILE_PROFILE` names, or that the last run in the home had, or the
    laptop's, with `TACTILE_SHAPENET` and `TACTILE_REAL` applied.

    An address with a password or query stays in its variable: the setting is its name, `$NAME`.
    """
    name = environ.get("TACTILE_PROFILE") or remembered_profile(environ) or "laptop"
    if name not in PROFILES:
        raise TactileError(
            f"TACTILE_PROFILE={name!r} is unknown: choose one of {', '.join(PROFILES)}"
        )
    profile = PROFILES[name]
    location = setting_of("TACTILE_SHAPENET", environ)
    meshes = profile.meshes.model_copy(update={"location": location})
    real = setting_of("TACTILE_REAL", environ)
    return profile.model_copy(update={"meshes": meshes, "real": real})
