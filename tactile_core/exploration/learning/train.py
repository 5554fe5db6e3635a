"""Training one policy and storing it; a finished training is kept as long as its key holds."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from upath import UPath

from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.exploration.learning.approach import Approach
from tactile_core.exploration.learning.gain_learner import train_scorer
from tactile_core.exploration.learning.ppo import train_ppo
from tactile_core.exploration.learning.sequence import best_sequence
from tactile_core.exploration.policies.base import weights_version
from tactile_core.exploration.policies.ppo import net_weights
from tactile_core.exploration.policies.store import (
    CURVE,
    FOR_SB3,
    RAYS_OF_SEQUENCE,
    StoredPolicy,
    describe,
    read_weights,
    save_policy,
    trained_on,
)
from tactile_core.files import written_whole
from tactile_core.keys import work_key
from tactile_core.parquet import read_table, table_hash
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.known_shapes import PACKED_SHAPES, pack
from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.settings import GainSettings, PolicySettings
from tactile_core.threads import one_thread

NOT_OF_THE_TRAINING = {"approaches", "seeds"}  # which policies there are, not what each is
OF_GAINS = set(GainSettings.model_fields)


def train_policy(
    approach: Approach,
    seed: int,
    train: Shapes,
    unet: TrainedUNet,
    settings: PolicySettings,
    *,
    directory: UPath,
    work: Path | UPath,
    progress: Callable[[str], None] = lambda message: None,
) -> str:
    """Train `approach` with `seed` on the train shapes and store it in `directory`.

    Returns a hash of the policy's weights. `directory` receives what `policies.store` describes;
    one that holds the finished training of the same key is left as it is. `work` holds TensorBoard
    curves and the checkpoint of a training under way.
    """
    title = f"{approach.name} seed {seed}"
    key = training_key(approach, seed, train, unet, settings)
    if (kept := finished(directory, key)) is not None:
        progress(f"{title}: kept, as nothing that it depends on has changed")
        return kept
    some, reconstructor = shapes_to_learn_from(train, unet)
    with one_thread():
        if approach.learner == "gains":
            net, curve = train_scorer(
                title, seed, some, reconstructor, settings, key=key, work=work, progress=progress
            )
            tensors = net.state_dict() | {PACKED_SHAPES: torch.from_numpy(pack(train.packed))}
        elif approach.learner == "sequence":
            rays, curve = best_sequence(title, seed, some, reconstructor, progress)
            tensors = {RAYS_OF_SEQUENCE: torch.from_numpy(rays)}
        else:
            model, curve = train_ppo(
                approach, seed, some, reconstructor, settings,
                key=key, work=work, progress=progress,
            )  # fmt: skip
            tensors = net_weights(model.policy)
            zipped = io.BytesIO()
            model.save(zipped)
            with written_whole(directory / FOR_SB3) as file:
                file.write(zipped.getvalue())
    tensors = {name: value.cpu().contiguous() for name, value in tensors.items()}
    description = StoredPolicy(
        approach=approach.name,
        learner=approach.learner,
        seed=seed,
        settings=settings,
        resolution=unet.resolution,
        unet=unet.version(),
        key=key,
        version=weights_version(tensors),
        trained_on=table_hash(train.models()),
    )
    save_policy(directory, description, tensors, curve, train.models())
    (work / "checkpoint.pt").unlink(missing_ok=True)
    return description.version


def training_key(
    approach: Approach, seed: int, train: Shapes, unet: TrainedUNet, settings: PolicySettings
) -> str:
    """The key of all that a training depends on; PPO's settings do not concern a ray scorer, nor
    a ray scorer's PPO."""
    concerned = {
        "ppo": set(PolicySettings.model_fields) - OF_GAINS - NOT_OF_THE_TRAINING,
        "gains": OF_GAINS,
        "sequence": set[str](),
    }[approach.learner]
    return work_key(
        "exploration.learning.train",
        settings=settings.model_dump(include=concerned),
        seed=seed,
        approach=approach.version,
        unet=unet.version(),
        train=train.version,
    )


def finished(directory: UPath, key: str) -> str | None:
    """The version of the policy in `directory`, if it was trained under this key and is whole."""
    try:
        description = describe(directory)
        read_weights(directory, description)
        trained_on([directory])
        read_table(directory / CURVE, "policies")
    except OutOfReachError:  # it may be there: mend the store before anything is trained anew
        raise
    except TactileError:
        return None
    return description.version if description.key == key else None


def shapes_to_learn_from(train: Shapes, unet: TrainedUNet) -> tuple[Shapes, Reconstructor]:
    """The shapes to train a policy on, and what reconstructs them for it.

    A U-Net that knows these shapes leaves nothing to find out about them. Such a one forgets every
    second model, and the policy is trained on those. Raises `TactileError` where it knows one only.
    """
    if unet.known is None:
        return train, Reconstructor(unet)
    ids, models = np.unique(train.model_ids, return_inverse=True)
    if len(ids) < 2:
        raise TactileError(
            f"{ids[0]} is the only train model, and the U-Net knows its shapes: add meshes, or "
            "materialise unet without known_shapes"
        )
    some = train.select(np.flatnonzero(models % 2))
    return some, Reconstructor(unet.forgetting(some.packed))
