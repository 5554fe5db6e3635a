"""Whether anything is learnt at all, on small problems that can be told by heart.

Each is made so that what ignores what was felt cannot do it. Margins are wide: at the seeds 0 to 4
the scores lie well beyond them; the tests take one.
"""

import numpy as np
import pytest
from stable_baselines3 import PPO

from tactile_core.dataset.outlines import outline
from tactile_core.dataset.packed import pack_masks
from tactile_core.dataset.shapes import Shapes
from tactile_core.exploration.learning.approach import Approach
from tactile_core.exploration.learning.gain_learner import train_scorer
from tactile_core.exploration.learning.ppo import new_model, train_ppo
from tactile_core.exploration.policies.ppo import PPOPolicy
from tactile_core.exploration.policies.references import find_reference
from tactile_core.exploration.policies.scorer import ScorerPolicy
from tactile_core.exploration.world.rewards import Stage
from tactile_core.exploration.world.state import Explorations
from tactile_core.exploration.world.vec_env import BatchedTactileEnv
from tactile_core.reconstruction.batches import draw_touch_sets
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.jaccard import jaccard_index
from tactile_core.reconstruction.scores import mean_shape_jaccard
from tactile_core.reconstruction.training import train_unet
from tactile_core.settings import GainSettings, PolicySettings, UNetSettings
from tests.shared import once

R = 48
SEED = 0
NET = UNetSettings(learning_rate=1e-2, batch_size=8, depth=3, channels=4, epochs=25, patience=25)
LEFT, RIGHT = 14, 33  # outer columns of the two walls


def shapes_of(masks: np.ndarray) -> Shapes:
    names = np.array([f"shape {number}" for number in range(len(masks))])
    return Shapes(
        packed=pack_masks(masks),
        outlines=[outline(mask) for mask in masks],
        sample_ids=names,
        model_ids=names,
        categories=names,
        geometries=names,
    )


def walls() -> Shapes:
    """A wall on the left, and one on the right."""
    masks = np.zeros((2, R, R), bool)
    masks[0, 13:35, LEFT : LEFT + 5] = True
    masks[1, 13:35, RIGHT - 4 : RIGHT + 1] = True
    return shapes_of(masks)


def bars(count: int, seed: int) -> Shapes:
    """Bars of any direction, somewhat off the middle: their mean is a blurred disc."""
    rng = np.random.default_rng(seed)
    rows, columns = np.indices((R, R)) - (R - 1) / 2
    masks = []
    for angle, shift in zip(np.pi * rng.random(count), 6 * rng.random(count) - 3, strict=True):
        along = np.cos(angle) * rows + np.sin(angle) * columns
        across = np.cos(angle) * columns - np.sin(angle) * rows - shift
        masks.append((np.abs(along) < 10) & (np.abs(across) < 2.5))
    return shapes_of(np.array(masks))


def outer(cast) -> np.ndarray:
    """1 for a touch of a wall's outer side, else 0: no ray has both walls' outer sides."""
    return np.isin(cast.touches[:, 1], [LEFT, RIGHT]).astype(np.float32)


@pytest.fixture(scope="module")
def train() -> Shapes:
    return bars(96, seed=0)


@pytest.fixture(scope="module")
def unet(train, tmp_path_factory):
    """A U-Net for bars."""
    work = tmp_path_factory.mktemp("unet")
    return once(
        tmp_path_factory, "unet_of_bars", lambda: train_unet(train, bars(16, 1), NET, work=work)
    )


def test_a_unet_reconstructs_better_than_the_mean_shape_does(train, unet):
    test = bars(64, seed=2)
    touches = draw_touch_sets(test, np.random.default_rng(0), fewest=8, most=8)
    images = np.zeros(test.masks.shape, np.int8)
    for image, points in zip(images, touches, strict=True):
        image[tuple(points.T)] = 1
    jaccard = jaccard_index(Reconstructor(unet).predict(images), test.masks).mean()
    assert jaccard > mean_shape_jaccard(train, test) + 20


def test_gain_chooses_better_rays_than_random(train, unet, tmp_path):
    reconstructor = Reconstructor(unet)
    settings = GainSettings(gain_iterations=25, gain_states=16, gain_tries=4)
    net, _ = train_scorer(
        "gain", SEED, train, reconstructor, settings, key="", work=tmp_path, progress=print
    )
    means = []
    for policy in (ScorerPolicy("gain", SEED, net), find_reference("random")):
        explorations = Explorations(bars(64, seed=2).masks, reconstructor)
        rng = np.random.default_rng(SEED)
        for _ in range(6):
            explorations.cast(policy.choose(explorations, rng, deterministic=True))
        means.append(explorations.jaccard.mean())
    assert means[0] > means[1] + 10


def test_ppo_learns_to_go_by_what_was_felt(tmp_path_factory, tmp_path):
    """Which side of a wall is the outer one is known once it was touched, and not before."""
    pair = walls()
    many = pair.select(np.arange(32) % 2)
    net = once(
        tmp_path_factory, "unet_of_walls", lambda: train_unet(many, many, NET, work=tmp_path)
    )
    reconstructor = Reconstructor(net, precision="float32")
    settings = PolicySettings(
        steps_per_stage=11_200, environments=32, rays_per_rollout=10, batch_size=160, epochs=8,
        learning_rate=3e-3, reward_scale=1, entropy=0,
    )  # fmt: skip
    approach = Approach("outer", "", (Stage(outer),))
    env = BatchedTactileEnv(32, pair.masks, reconstructor, approach.stages[0])
    untrained = new_model(env, settings, SEED)
    ours, usual = (made.policy.optimizer.defaults for made in (untrained, PPO("CnnPolicy", env)))
    assert ours == usual | {"fused": True, "lr": settings.learning_rate}
    trained, curve = train_ppo(
        approach, SEED, pair, reconstructor, settings, key="", work=tmp_path, progress=print
    )

    def found(model) -> float:
        """How often rays after the first end at an outer side."""
        explorations = Explorations(np.repeat(pair.masks, 64, axis=0), reconstructor)
        policy, rng = PPOPolicy("outer", SEED, model.policy), np.random.default_rng(0)
        casts = [
            explorations.cast(policy.choose(explorations, rng, deterministic=False))
            for _ in range(10)
        ]
        return float(np.mean([outer(cast) for cast in casts[1:]]))

    assert found(untrained) < 0.3
    assert found(trained) > 0.6  # what never looks has one half at most
    assert curve["reward"].iloc[-1] > 2 * curve["reward"].iloc[0]
