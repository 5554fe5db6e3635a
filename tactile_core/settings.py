"""Every setting of the platform, written once: one model per stage.

The Dagster layer mixes these models into its run config, so bounds and descriptions appear
in the UI. `profiles` has sets of them.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from tactile_core.addresses import checked, redacted

RESOLUTION = Field(
    64,
    ge=48,  # PPO's CnnPolicy needs 36 pixels at least
    le=512,
    multiple_of=16,
    description="Mask height and width R.",
)
LARGEST_SEED = 2**32 - 1  # of NumPy's global generator, which BOHB and Stable-Baselines3 seed
SEED = Field(0, ge=0, le=LARGEST_SEED, description="Seed of every random choice in this stage.")

SHAPENET_CLASSES = {"mug": "03797390", "bottle": "02876657"}

Renderer = Literal["auto", "pyrender", "rasteriser"]
RENDERER: Any = Field("auto", description="auto: pyrender where OpenGL works, else the rasteriser.")

# Where a U-Net's training touches come from: the sets of tactile_samples, as in the report; fresh
# draws from each outline; or half of those and half as rays make them.
Touches = Literal["stored", "outline", "rays"]

MOST_HELD_OUT = 0.8  # of all models, for eval and test

Choice = Literal["likeliest", "drawn"]
CHOICES: tuple[str, ...] = get_args(Choice)
Address = Annotated[str, AfterValidator(checked)]
Seed = Annotated[int, Field(ge=0, le=LARGEST_SEED)]
Rate = Annotated[float, Field(gt=0, le=1)]
# A batch of one cannot be normalised at the U-Net's deepest level, where one pixel may be left.
BatchSize = Annotated[int, Field(ge=2, le=65_536)]
Depth = Annotated[int, Field(ge=1, le=6)]
Channels = Annotated[int, Field(ge=1, le=1024)]
Meshes = Annotated[int, Field(ge=0, le=1_000_000)]


class Settings(BaseModel):
    """Base of all settings: read-only; a misspelt field and what is no number are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def problems(error: ValidationError) -> str:
    """What is wrong with settings, on one line that names each field and the value it was given."""
    said = "; ".join(
        ("{}{}: " if problem["loc"] else "").format(  # nowhere: of several fields, which it names
            ".".join(map(str, problem["loc"])), given(problem)
        )
        + problem["msg"].removeprefix("Value error, ")
        for problem in error.errors()
    )
    return redacted(said)


def given(problem: Mapping[str, Any]) -> str:
    """The value that was given; nothing where none was, as pydantic then gives all the others."""
    return "" if problem["type"] == "missing" else f" = {redacted(repr(problem['input'])):.200}"


def once_each(name: str, values: Sequence[Any]) -> None:
    """Raises `ValueError` where a list of choices names one of them twice."""
    twice = [value for number, value in enumerate(values) if value in values[:number]]
    if twice:
        raise ValueError(f"{name} names {twice[0]!r} twice")


class MeshSettings(Settings):
    """Where the 3D models come from (report, section IV)."""

    location: Address | None = Field(
        None,
        description="Folder or http(s)/fsspec URL that holds <synset>.zip, <synset>/ or "
        "<class>/ for each class; empty: meshes are generated. $NAME: the address in that "
        "variable, where it holds a password or signature.",
    )
    classes: dict[str, Address] | None = Field(
        None,
        min_length=1,
        description="Class name → ShapeNet synset, or the URL of its archive (or $NAME, likewise). "
        "Unset: mug and bottle or, where the location holds neither synset, its own folders.",
    )
    procedural_models: dict[str, Meshes] = Field(
        {"mug": 214, "bottle": 498},
        description="How many meshes to generate per class, when no location is given.",
    )
    models_per_class: int | None = Field(
        None, ge=1, le=10**9, description="Keep at most so many meshes of each class; empty: all."
    )
    sha256: dict[str, str] = Field(
        {}, description="Class name → expected SHA-256 of its archive, where known."
    )
    seed: int = SEED

    @property
    def named_classes(self) -> dict[str, str]:
        """`classes`, or the report's two."""
        return SHAPENET_CLASSES if self.classes is None else self.classes

    @model_validator(mode="after")
    def _hold_together(self) -> Self:
        once_each("classes", list(self.named_classes.values()))
        for name in self.sha256:
            if name not in self.named_classes:
                raise ValueError(f"sha256 names {name!r}, which is no class of `classes`")
        return self


class MaskSettings(Settings):
    """How a mesh becomes a silhouette (report, section IV)."""

    resolution: int = RESOLUTION
    renderer: Renderer = RENDERER


class SplitSettings(Settings):
    """Train, eval and test models, and how often each mask is rotated (report, section IV)."""

    eval_share: float = Field(0.1, gt=0, lt=0.5, description="Share of models for eval.")
    test_share: float = Field(0.1, gt=0, lt=0.5, description="Share of models for test.")
    rotations: int = Field(5, ge=1, le=1000, description="Random in-plane rotations of each mask.")
    warps: int = Field(
        0,
        ge=0,
        le=1000,
        description="Copies of each train model, stretched and bent at random, beside these.",
    )
    renderer: Renderer = RENDERER
    seed: int = SEED

    @model_validator(mode="after")
    def _leave_some_for_train(self) -> Self:
        if self.eval_share + self.test_share > MOST_HELD_OUT:
            raise ValueError(
                f"eval_share ({self.eval_share}) and test_share ({self.test_share}) leave too "
                f"little for train: together they may be {MOST_HELD_OUT}"
            )
        return self


class TouchSettings(Settings):
    """Touch sets drawn from each outline (report, section IV)."""

    sets_per_mask: int = Field(5, ge=1, le=10_000, description="Touch sets drawn for each mask.")
    fewest: int = Field(1, ge=0, le=10_000, description="Fewest touches in a set; at most `most`.")
    most: int = Field(
        10,
        ge=1,
        le=10_000,
        description="Most touches in a set. Table II's: trainings draw 1 to 10.",
    )
    seed: int = SEED

    @model_validator(mode="after")
    def _fewest_before_most(self) -> Self:
        if self.fewest > self.most:
            raise ValueError(f"fewest ({self.fewest}) exceeds most ({self.most})")
        return self


class SearchSettings(Settings):
    """BOHB search over the U-Net's hyperparameters (report, section V and Table I)."""

    trials: int = Field(12, ge=1, le=100_000, description="Hyperparameter settings tried.")
    epochs: int = Field(4, ge=1, le=100_000, description="Most epochs a trial may train.")
    samples_per_epoch: int | None = Field(
        None, ge=1, le=10**9, description="Masks seen per epoch; empty: all of the train split."
    )
    concurrent: int = Field(1, ge=1, le=1024, description="Trials at a time; 1 repeats exactly.")
    touches: Touches = Field(
        "outline",
        description="What trials learn from: stored sets, fresh draws from outlines, or rays too.",
    )
    reduction_factor: int = Field(4, ge=2, le=100, description="HyperBand's reduction factor.")
    learning_rate: list[Rate] = Field(
        [1e-4, 3e-3], min_length=2, max_length=2, description="Log-uniform range, lower end first."
    )
    batch_sizes: list[BatchSize] = Field([16, 32, 64], min_length=1, description="Choices.")
    depths: list[Depth] = Field([3, 4], min_length=1, description="Choices.")
    channels: list[Channels] = Field([8, 16], min_length=1, description="Choices.")
    seed: int = SEED

    @model_validator(mode="after")
    def _something_to_search(self) -> Self:
        low, high = self.learning_rate
        if low >= high:
            raise ValueError(
                f"learning_rate: its lower end ({low}) is not below the upper ({high})"
            )
        once_each("batch_sizes", self.batch_sizes)
        once_each("depths", self.depths)
        once_each("channels", self.channels)
        return self


class NetSettings(Settings):
    """A training of the reconstruction U-Net (report, section V).

    `learning_rate`, `batch_size`, `depth` and `channels` come from the best search trial
    unless they are given here.
    """

    learning_rate: Rate | None = Field(None, description="Empty: best trial's.")
    batch_size: BatchSize | None = Field(None, description="Empty: best trial's.")
    depth: Depth | None = Field(None, description="Levels. Empty: best trial's.")
    channels: Channels | None = Field(
        None, description="Channels of the first level. Empty: best trial's."
    )
    epochs: int = Field(40, ge=1, le=100_000, description="Most epochs.")
    patience: int = Field(
        8, ge=1, le=100_000, description="Stop after so many epochs without a better eval loss."
    )
    free_space: bool = Field(
        False,
        description="Show the U-Net where rays have passed, too; the report's sees touches only.",
    )
    touches: Touches = Field(
        "rays",
        description="What it learns from: stored sets, fresh draws from outlines, or rays too.",
    )
    seed: int = SEED

    @model_validator(mode="after")
    def _free_space_is_of_rays(self) -> Self:
        if self.free_space and self.touches != "rays":
            raise ValueError(
                f"free_space: touches {self.touches!r} show no ray that passed; it needs 'rays'"
            )
        return self


class UNetSettings(NetSettings):
    """The final training of the reconstruction U-Net (report, section V)."""

    known_shapes: bool = Field(
        False,
        description="Show the U-Net the mean of the train shapes that agree with what was felt, "
        "too.",
    )
    further_seeds: list[Seed] = Field(
        [],
        description="One more U-Net for each. Policies of a seed then go with the U-Net of that "
        "seed, and rules with each; with none, all go with the one.",
    )

    @model_validator(mode="after")
    def _each_seed_once(self) -> Self:
        once_each("seed and further_seeds", [self.seed, *self.further_seeds])
        return self


class GainSettings(Settings):
    """How a ray scorer learns what rays gain."""

    gain_iterations: int = Field(400, ge=1, le=10**9, description="Iterations of learning gains.")
    gain_states: int = Field(64, ge=1, le=4096, description="Explorations stepped per iteration.")
    gain_tries: int = Field(8, ge=1, le=396, description="Touches tried out in each exploration.")
    gain_updates: int = Field(2, ge=1, le=1000, description="Gradient steps per iteration.")
    gain_learning_rate: Rate = Field(2e-3, description="Peak rate of learning gains.")


class PracticeSettings(NetSettings, GainSettings):
    """A first U-Net and a ray scorer on it, whose rays the final U-Net learns from as well."""


class PolicySettings(GainSettings):
    """PPO training of the policies (report, section VI.B), and the learning of gains."""

    approaches: list[str] = Field(
        [], description="Training approaches, by name; empty: every one there is."
    )
    seeds: list[Seed] = Field([0], min_length=1, description="One training for each seed.")
    steps_per_stage: int = Field(
        49_152, ge=1, le=10**9, description="Rays cast per training stage, in whole rollouts."
    )
    environments: int = Field(32, ge=1, le=4096, description="Environments stepped as one batch.")
    rays_per_rollout: int = Field(
        16, ge=1, le=65_536, description="Rays in each environment between two PPO updates."
    )
    batch_size: BatchSize = Field(
        256, description="PPO minibatch size; divides environments × rays_per_rollout."
    )
    epochs: int = Field(4, ge=1, le=1000, description="PPO epochs per update.")
    learning_rate: Rate = Field(1e-3, description="PPO learning rate.")
    reward_scale: float = Field(
        0.01, gt=0, le=1000, description="Factor on rewards (Jaccard 0–100) before PPO sees them."
    )
    entropy: float = Field(0.01, ge=0, le=1000, description="PPO entropy coefficient.")
    discount: float = Field(
        0.5,
        ge=0,
        le=1,
        description="PPO's discount, which the report does not name; at SB3's own, 0.99, "
        "pre_diff_miss learns nothing.",
    )

    @model_validator(mode="after")
    def _whole_batches(self) -> Self:
        rays = self.environments * self.rays_per_rollout
        if rays % self.batch_size:
            raise ValueError(
                f"batch_size ({self.batch_size}) does not divide the {rays} rays of a rollout "
                f"(environments {self.environments} × rays_per_rollout {self.rays_per_rollout})"
            )
        once_each("approaches", self.approaches)
        once_each("seeds", self.seeds)
        return self


class PruneSettings(Settings):
    """What of earlier runs is old enough to go."""

    days: float = Field(30, ge=0, description="Keep what is younger.")
    runs: int = Field(20, ge=0, description="Keep so many of the last runs, however old.")
    dry_run: bool = Field(False, description="Only say what would go.")


class RolloutSettings(Settings):
    """Rays of every policy over the test split (report, section VII)."""

    references: list[str] | None = Field(
        None,
        description="Reference policies to stand beside the trained ones, by name; unset: every "
        "one there is.",
    )
    choices: list[str] = Field(
        list(CHOICES),
        min_length=1,
        description="Which rays are cast by policies that have a distribution of rays: their "
        "likeliest, ones drawn from it, or both in turn.",
    )
    count: int = Field(10, ge=1, le=1000, description="Rays to cast and touches to hold.")
    ray_limit: int = Field(
        100, ge=1, le=10_000, description="Most rays per rollout; `count` at least."
    )
    seed: int = SEED

    @model_validator(mode="after")
    def _enough_rays(self) -> Self:
        if self.count > self.ray_limit:
            raise ValueError(
                f"count ({self.count}) exceeds ray_limit ({self.ray_limit}): so many touches need "
                "as many rays at least"
            )
        once_each("references", self.references or [])
        once_each("choices", self.choices)
        for choice in self.choices:
            if choice not in CHOICES:
                raise ValueError(f"choice {choice!r} is unknown: choose from {', '.join(CHOICES)}")
        return self


class ObserverSettings(Settings):
    """The ideal observers: what can be attained without knowing the shape."""

    believed: dict[str, Meshes] = Field(
        {"mug": 600, "bottle": 1400},
        description="How many meshes of each class to generate for what they believe in.",
    )
    samples: int = Field(
        60, ge=1, le=10**6, description="Test samples to try them on, each of another model."
    )
    seed: Seed = Field(1, description="Of the meshes and rays; not that of `shapenet_meshes`.")


class EvaluationSettings(Settings):
    """What an evaluation reads from the rollouts (report, section VII)."""

    choice: Choice = Field(
        "drawn", description="Which of `choices` of the rollouts counts where there are both."
    )
    count: int = Field(10, ge=1, le=1000, description="Rays (per step) or touches (per grasp).")
    resamples: int = Field(
        2000, ge=10, le=1_000_000, description="Bootstrap resamples for 95 % intervals."
    )
    seed: int = SEED
