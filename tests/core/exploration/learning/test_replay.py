"""The states that a ray scorer learns from, kept small."""

import numpy as np

from tactile_core.checkpoints import load_checkpoint, save_checkpoint
from tactile_core.exploration.learning.replay import REPLAY_ARRAYS, Replay
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.policies.scorer import scorer_images
from tactile_core.exploration.world.rays import candidate_rays
from tactile_core.exploration.world.state import Explorations


def test_images_are_given_back_as_they_were_seen(shapes, either_reconstructor, tmp_path):
    explorations = Explorations(shapes["train"].masks, either_reconstructor)
    rng = np.random.default_rng(0)
    candidates = len(candidate_rays(64).reshape(-1, 2))
    replay, seen = Replay(64, candidates), []
    for _ in range(6):
        explorations.cast(find_reference("random").choose(explorations, rng))
        images = scorer_images(explorations)
        count = len(images)
        replay.add(images, explorations.rays, np.zeros((count, candidates)), np.zeros((count, 1)))
        seen.append(images)
    everything = np.concatenate(seen)
    assert everything[:, 2].any() and everything[:, 0].any()
    np.testing.assert_array_equal(replay.images(np.arange(len(everything))), everything)
    save_checkpoint(tmp_path / "replay.pt", "key", replay.state())
    again = Replay(64, candidates)
    again.load_state(load_checkpoint(tmp_path / "replay.pt", "key"))
    for name in REPLAY_ARRAYS:
        np.testing.assert_array_equal(getattr(again, name), getattr(replay, name))
