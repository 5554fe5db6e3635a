"""Training one policy and storing it: its weights, its curve and its settings."""

import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import safetensors.torch
import torch
from upath import UPath

from tactile_core.dataset.shapes import Shapes
from tactile_core.errors import TactileError
from tactile_core.exploration.learning.approaches import find_approach
from tactile_core.exploration.learning.gain_learner import train_scorer
from tactile_core.exploration.learning.ppo import train_ppo
from tactile_core.exploration.policies.store import PPO_FILE, SCORER_FILE
from tactile_core.files import content_hash, write_table, written_whole
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.known_shapes import PACKED_SHAPES, pack
from tactile_core.reconstruction.trained import TrainedUNet
from tactile_core.settings import PolicySettings
from tactile_core.threads import one_thread


def train_policy(
    approach: str,
    seed: int,
    train: Shapes,
    unet: TrainedUNet,
    settings: PolicySettings,
    *,
    directory: UPath,
    work: Path,
    progress: Callable[[str], None] = lambda message: None,
) -> str:
    """Train `approach` with `seed` on the train shapes and store it in `directory`.

    Returns a hash of the policy's weights. `directory` receives policy.zip (an SB3 PPO) or
    policy.safetensors (a ray scorer, and the shapes that `recall` knows), curve.parquet and, last,
    settings.json; `work` holds TensorBoard curves and the checkpoint of a training under way.
    Raises `TactileError` for an unknown approach.
    """
    recipe = find_approach(approach)
    own = settings.model_dump(exclude={"approaches", "seeds"})
    key = content_hash(approach, seed, own, unet.version(), train.masks.tobytes())
    remembered = pack(train.masks)
    train, reconstructor = shapes_to_learn_from(train, unet)
    if recipe.learner == "gains":
        with one_thread():
            net, curve = train_scorer(
                f"{approach} seed {seed}", seed, train, reconstructor, settings,
                key=key, work=work, progress=progress,
            )  # fmt: skip
        weights = net.state_dict() | {PACKED_SHAPES: torch.from_numpy(remembered)}
        stored, name = safetensors.torch.save(weights), SCORER_FILE
    else:
        with one_thread():
            model, curve = train_ppo(
                recipe, seed, train, reconstructor, settings, key=key, work=work, progress=progress
            )
        weights = model.policy.state_dict()
        zipped = io.BytesIO()
        model.save(zipped)
        stored, name = zipped.getvalue(), PPO_FILE
    version = content_hash(*(value.cpu().numpy().tobytes() for value in weights.values()))
    description = {
        "approach": approach, "learner": recipe.learner, "seed": seed, "settings": own,
        "unet": unet.version(), "resolution": unet.resolution, "version": version,
    }  # fmt: skip
    with written_whole(directory / name) as file:
        file.write(stored)
    write_table(curve, directory / "curve.parquet")
    with written_whole(directory / "settings.json") as file:
        file.write(json.dumps(description, indent=2).encode())
    (work / "checkpoint.pt").unlink(missing_ok=True)
    return version


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
    return some, Reconstructor(unet.forgetting(some.masks))
