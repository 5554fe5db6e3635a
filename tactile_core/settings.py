"""Every setting of the platform, written once: one model per stage, and the profiles.

The Dagster layer mixes these models into its run config, so bounds and descriptions appear
in the UI. `active_profile` reads `TACTILE_PROFILE` (smoke, laptop, study or paper),
`TACTILE_SHAPENET` (where the meshes come from; unset: generated mugs and bottles) and
`TACTILE_REAL` (real meshes to evaluate on besides).
"""

import os
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from tactile_core.errors import TactileError

RESOLUTION = Field(
    64,
    ge=48,  # PPO's CnnPolicy needs 36 pixels at least
    le=512,
    multiple_of=16,
    description="Mask height and width R.",
)
SEED = Field(0, ge=0, description="Seed of every random choice in this stage.")

Renderer = Literal["auto", "pyrender", "rasteriser"]
RENDERER: Any = Field("auto", description="auto: pyrender where OpenGL works, else the rasteriser.")

NotNegative = Annotated[int, Field(ge=0)]
Positive = Annotated[int, Field(ge=1)]
Rate = Annotated[float, Field(gt=0)]
# A batch of one cannot be normalised at the U-Net's deepest level, where one pixel may be left.
BatchSize = Annotated[int, Field(ge=2)]
Depth = Annotated[int, Field(ge=1, le=6)]


class Settings(BaseModel):
    """Base of all settings: read-only, and a misspelt field is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def problems(error: ValidationError) -> str:
    """What is wrong with settings, on one line that names each field and the value it was given."""
    return "; ".join(
        f"{'.'.join(map(str, problem['loc']))} = {problem['input']!r}: {problem['msg']}"
        for problem in error.errors()
    )


class MeshSettings(Settings):
    """Where the 3D models come from (report, section IV)."""

    location: str | None = Field(
        None,
        description="Folder or http(s)/fsspec URL that holds <synset>.zip, <synset>/ or "
        "<class>/ for each class; empty: meshes are generated.",
    )
    classes: dict[str, str] = Field(
        {"mug": "03797390", "bottle": "02876657"},
        description="Class name → ShapeNet synset, or the URL of its archive.",
    )
    procedural_models: dict[str, int] = Field(
        {"mug": 214, "bottle": 498},
        description="How many meshes to generate per class, when no location is given.",
    )
    models_per_class: int | None = Field(
        None, ge=1, description="Keep at most so many meshes of each class; empty: all."
    )
    sha256: dict[str, str] = Field(
        {}, description="Class name → expected SHA-256 of its archive, where known."
    )
    seed: int = SEED


class MaskSettings(Settings):
    """How a mesh becomes a silhouette (report, section IV)."""

    resolution: int = RESOLUTION
    renderer: Renderer = RENDERER


class SplitSettings(Settings):
    """Train, eval and test models, and how often each mask is rotated (report, section IV)."""

    eval_share: float = Field(0.1, gt=0, lt=0.5, description="Share of models for eval.")
    test_share: float = Field(0.1, gt=0, lt=0.5, description="Share of models for test.")
    rotations: int = Field(5, ge=1, description="Random in-plane rotations of each mask.")
    renderer: Renderer = RENDERER
    seed: int = SEED


class TouchSettings(Settings):
    """Touch sets drawn from each outline (report, section IV)."""

    sets_per_mask: int = Field(5, ge=1, description="Touch sets drawn for each mask.")
    fewest: int = Field(1, ge=0, description="Fewest touches in a set.")
    most: int = Field(
        10, ge=1, description="Most touches in a set. Table II's: trainings draw 1 to 10."
    )
    seed: int = SEED


class SearchSettings(Settings):
    """BOHB search over the U-Net's hyperparameters (report, section V and Table I)."""

    trials: int = Field(12, ge=1, description="Hyperparameter settings tried.")
    epochs: int = Field(4, ge=1, description="Most epochs a trial may train.")
    samples_per_epoch: int | None = Field(
        None, ge=1, description="Masks seen per epoch; empty: all of the train split."
    )
    concurrent: int = Field(1, ge=1, description="Trials at a time; 1 repeats exactly.")
    reduction_factor: int = Field(4, ge=2, description="HyperBand's reduction factor.")
    learning_rate: list[Rate] = Field(
        [1e-4, 3e-3], min_length=2, max_length=2, description="Log-uniform range."
    )
    batch_sizes: list[BatchSize] = Field([16, 32, 64], min_length=1, description="Choices.")
    depths: list[Depth] = Field([3, 4], min_length=1, description="Choices.")
    channels: list[Positive] = Field([8, 16], min_length=1, description="Choices.")
    seed: int = SEED


class NetSettings(Settings):
    """A training of the reconstruction U-Net (report, section V).

    `learning_rate`, `batch_size`, `depth` and `channels` come from the best search trial
    unless they are given here.
    """

    learning_rate: Rate | None = Field(None, description="Empty: best trial's.")
    batch_size: BatchSize | None = Field(None, description="Empty: best trial's.")
    depth: Depth | None = Field(None, description="Levels. Empty: best trial's.")
    channels: Positive | None = Field(
        None, description="Channels of the first level. Empty: best trial's."
    )
    epochs: int = Field(40, ge=1, description="Most epochs.")
    patience: int = Field(
        8, ge=1, description="Stop after so many epochs without a better eval loss."
    )
    free_space: bool = Field(
        False,
        description="Show the U-Net where rays have passed, too; the report's sees touches only.",
    )
    seed: int = SEED


class UNetSettings(NetSettings):
    """The final training of the reconstruction U-Net (report, section V)."""

    known_shapes: bool = Field(
        False,
        description="Show the U-Net the mean of the train shapes that agree with what was felt, "
        "too.",
    )


class GainSettings(Settings):
    """How a ray scorer learns what rays gain."""

    gain_iterations: int = Field(400, ge=1, description="Iterations of learning gains.")
    gain_states: int = Field(64, ge=1, description="Explorations stepped per iteration.")
    gain_tries: int = Field(8, ge=1, description="Touches tried out in each exploration.")
    gain_updates: int = Field(2, ge=1, description="Gradient steps per iteration.")
    gain_learning_rate: float = Field(2e-3, gt=0, description="Peak rate of learning gains.")


class PracticeSettings(NetSettings, GainSettings):
    """A first U-Net and a ray scorer on it, whose rays the final U-Net learns from as well."""


class PolicySettings(GainSettings):
    """PPO training of the policies (report, section VI.B), and the learning of gains."""

    approaches: list[str] = Field(
        [], description="Training approaches, by name; empty: every one there is."
    )
    seeds: list[NotNegative] = Field([0], min_length=1, description="One training for each seed.")
    steps_per_stage: int = Field(49_152, ge=1, description="Rays cast per training stage.")
    environments: int = Field(32, ge=1, description="Environments stepped as one batch.")
    rays_per_rollout: int = Field(
        16, ge=1, description="Rays in each environment between two PPO updates."
    )
    batch_size: int = Field(256, ge=2, description="PPO minibatch size.")
    epochs: int = Field(4, ge=1, description="PPO epochs per update.")
    learning_rate: float = Field(1e-3, gt=0, description="PPO learning rate.")
    reward_scale: float = Field(
        0.01, gt=0, description="Factor on rewards (Jaccard 0–100) before PPO sees them."
    )
    entropy: float = Field(0.01, ge=0, description="PPO entropy coefficient.")


class EvaluationSettings(Settings):
    """Roll-outs over the test split (report, section VII)."""

    references: list[str] = Field(
        ["random", "even", "coverage", "uncertainty", "oracle"],
        description="Reference policies to stand beside the trained ones.",
    )
    deterministic: bool = Field(
        True, description="Trained policies take their most likely ray; else they draw one."
    )
    count: int = Field(10, ge=1, description="Rays (per step) or touches (per grasp).")
    ray_limit: int = Field(100, ge=1, description="Most rays per rollout (per grasp).")
    resamples: int = Field(2000, ge=10, description="Bootstrap resamples for 95 % intervals.")
    seed: int = SEED


class Profile(Settings):
    """The settings of all stages for one kind of machine."""

    name: str
    real: str | None = Field(
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
    per_step: EvaluationSettings = EvaluationSettings()
    per_grasp: EvaluationSettings = EvaluationSettings(deterministic=False)


# Four short epochs favour nets that learn fast and end poor: none of those is offered.
LAPTOP_SEARCH = SearchSettings(
    samples_per_epoch=1024,
    learning_rate=[1e-3, 4e-3],
    batch_sizes=[32, 48],
    depths=[3, 4],
    channels=[12, 16],
)

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
        per_step=EvaluationSettings(resamples=200, deterministic=False),
        per_grasp=EvaluationSettings(resamples=200, deterministic=False, ray_limit=60),
    ),
    "laptop": Profile(
        name="laptop",
        search=LAPTOP_SEARCH,
        # After a tenth of the report's training a policy has a good distribution of rays, but
        # its single most likely ray hardly depends on what was felt.
        per_step=EvaluationSettings(deterministic=False),
    ),
    # The laptop's data and nets, with all that was found to help, and three seeds of each policy.
    "study": Profile(
        name="study",
        search=LAPTOP_SEARCH,
        practice=PracticeSettings(epochs=30, patience=20, free_space=True),
        unet=UNetSettings(epochs=60, patience=20, free_space=True, known_shapes=True),
        policies=PolicySettings(seeds=[0, 1, 2]),
        per_step=EvaluationSettings(deterministic=False),
    ),
    "paper": Profile(
        name="paper",
        masks=MaskSettings(resolution=256),
        search=SearchSettings(
            trials=100,
            epochs=10,
            learning_rate=[1e-7, 1e-2],
            batch_sizes=[4, 8, 16],
            depths=[3, 4, 5, 6],
            channels=[16, 32, 64, 128, 256],
        ),
        unet=UNetSettings(epochs=200, patience=20),
        policies=PolicySettings(seeds=[0, 1, 2], steps_per_stage=500_000),
    ),
}


def active_profile(environ: Mapping[str, str] = os.environ) -> Profile:
    """The profile that `TACTILE_PROFILE` names (default laptop), with `TACTILE_SHAPENET` and
    `TACTILE_REAL` applied."""
    name = environ.get("TACTILE_PROFILE") or "laptop"
    if name not in PROFILES:
        raise TactileError(
            f"TACTILE_PROFILE={name!r} is unknown: choose one of {', '.join(PROFILES)}"
        )
    profile = PROFILES[name]
    location = environ.get("TACTILE_SHAPENET") or None
    meshes = profile.meshes.model_copy(update={"location": location})
    return profile.model_copy(
        update={"meshes": meshes, "real": environ.get("TACTILE_REAL") or None}
    )
