"""Opens a training as the asset `unet` does, up to its first batch; measured by `speed_size`."""

import numpy as np
from upath import UPath

from tactile_core.dataset.shapes import load_shapes
from tactile_core.exploration.practice.ray_touches import touch_source
from tactile_core.files import read_table
from tactile_core.home import find_artifacts
from tactile_core.reconstruction.batches import training_batches

if __name__ == "__main__":
    splits, outlines, samples = (
        read_table(UPath(find_artifacts()) / f"{name}.parquet")
        for name in ("rotated_splits", "outlines", "tactile_samples")
    )
    train, eval_shapes = (load_shapes(splits, outlines, split) for split in ("train", "eval"))
    touches = touch_source("stored", train, samples, seed=0)
    versions = train.version, eval_shapes.version, touches.key
    rng = np.random.default_rng(0)
    indices, felt, masks = next(training_batches(train, 32, rng, touches.draw))
    print(*versions, len(train), felt.shape, masks.mean())
