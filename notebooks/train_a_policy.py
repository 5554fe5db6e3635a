# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Train a policy of your own
#
# In ten minutes on two cores: PPO of Stable-Baselines3 in the batched environment, with a reward
# of our own, and then beside the fixed rules on shapes that it was not trained on.

# %%
import os

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
from stable_baselines3 import PPO

import tactile_core
from tactile_core.exploration.environments import as_reconstructor, default_masks, default_unet
from tactile_core.exploration.world.rewards import Stage
from tactile_core.exploration.world.vec_env import BatchedTactileEnv

RAYS = int(os.environ.get("NOTEBOOK_RAYS", 49_152))  # to train on; tests take fewer

# %% [markdown]
# ## A reward
#
# It gets what a ray did in each of N explorations and returns N numbers. This one pays for what
# the ray added to the Jaccard index, and takes five points off where it touched nothing new.


# %%
def bold(cast):
    gained = cast.jaccard - cast.jaccard_before
    return np.where(cast.missed | cast.repeated, -5.0, gained)


# %% [markdown]
# ## Training
#
# 32 explorations share one pass of the U-Net a step. Rewards count the Jaccard index from 0 to
# 100, so they are scaled down for PPO; a discount of 0.5 makes it care for the next touch first.

# %%
unet = as_reconstructor(default_unet())
stage = Stage(lambda cast: 0.01 * bold(cast))
envs = BatchedTactileEnv(32, default_masks("train"), unet, stage)
model = PPO("CnnPolicy", envs, n_steps=16, batch_size=256, n_epochs=4, gamma=0.5,
            ent_coef=0.01, learning_rate=1e-3, seed=0)  # fmt: skip
model.learn(RAYS)

# %% [markdown]
# ## Beside the rules
#
# On shapes of other models, the test split: each policy ten rays on one rotation of every third.

# %%
unseen = default_masks("test")[::15]  # a model has five rotations, one after the other
env = gymnasium.make("tactile_core:TactileExploration-v1", masks=unseen, unet=unet)


def mean_curve(act, shapes=24):
    """The mean Jaccard index after each of ten rays on the first shapes."""
    curves = []
    for shape in range(min(shapes, len(unseen))):
        observation, info = env.reset(seed=shape, options={"mask": shape})
        curve = []
        for _ in range(10):
            observation, _, _, _, info = env.step(act(observation, info))
            curve.append(info["jaccard"])
        curves.append(curve)
    return np.mean(curves, axis=0)


curves = {"ours": mean_curve(lambda observation, info: model.predict(observation)[0])}
for name in ("random", "even", "coverage"):
    curves[name] = mean_curve(tactile_core.policy(name, env).act)

figure, axes = plt.subplots(figsize=(7, 3.5))
for name, curve in curves.items():
    axes.plot(range(1, 11), curve, "o-", label=f"{name}, {curve[-1]:.0f} after ten")
axes.set(xlabel="rays cast", ylabel="mean Jaccard index")
axes.legend()

# %% [markdown]
# ## And into the tables
#
# `tactile evaluate` puts a function or a model of Stable-Baselines3 beside all policies of a run,
# with an interval and on the same samples; an entry of `APPROACHES` makes the reward an approach
# of its own.
