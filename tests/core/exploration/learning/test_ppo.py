"""PPO's trainings: stages, rewards, and the model of Stable-Baselines3 (report, section VI.B)."""

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticCnnPolicy

from tactile_core.exploration.learning import ppo
from tactile_core.parquet import read_table
from tests.core.exploration.quick import QUICK


def test_total_miss_trains_both_of_its_stages(train, tmp_path):
    """The first until ten touches, the second for ten rays."""
    train("total_miss")
    curve = read_table(tmp_path / "policy" / "curve.parquet")
    assert curve["stage"].tolist() == [0, 0, 1, 1]
    assert curve["steps"].tolist() == [256, 512, 768, 1024]
    assert curve["touches"].tolist()[:2] == [10, 10]
    assert (curve["rays"][:2] > 10).all()
    assert curve["rays"].tolist()[2:] == [10, 10]


def test_pre_diff_miss_rewards_add_up_to_the_jaccard_index(train, tmp_path):
    """In every episode: nothing is taken away for a miss or a repeat."""
    train("pre_diff_miss")
    curve = read_table(tmp_path / "policy" / "curve.parquet")
    np.testing.assert_allclose(curve["reward"], curve["jaccard"], atol=1e-3)


def test_the_second_stage_meets_other_masks_than_the_first(train, monkeypatch):
    met = []

    class Watched(ppo.BatchedTactileEnv):
        def restart(self, which, *options):
            super().restart(which, *options)
            met.append((self.stage.ends, self.drawn[which].tolist()))

    monkeypatch.setattr(ppo, "BatchedTactileEnv", Watched)
    train("total_miss")
    first, second = (
        [mask for ends, drawn in met if ends == stage for mask in drawn][:11]
        for stage in ("touches", "rays")
    )
    assert len(first) == len(second) == 11
    assert first != second


def test_ppo_is_the_one_of_stable_baselines_with_the_settings_given(train, tmp_path):
    settings = QUICK.model_copy(update={"entropy": 0.05, "learning_rate": 2e-4})
    train("total", settings=settings)
    model = PPO.load(tmp_path / "policy" / "policy.zip")
    assert (model.ent_coef, model.learning_rate) == (0.05, 2e-4)
    assert (model.n_steps, model.n_envs, model.batch_size, model.n_epochs) == (64, 4, 64, 1)
    assert model.policy_class is ActorCriticCnnPolicy
    assert model.num_timesteps == 512
