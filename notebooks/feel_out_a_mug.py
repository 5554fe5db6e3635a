# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Feel out a mug
#
# With `tactile_core` alone: no Dagster, no assets. A mug is generated that nothing was trained
# on; a policy casts ten rays at it and sees no more of it than where they touch.

# %%
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import tactile_core
from tactile_core.dataset.things import generated_thing

mug = generated_thing("mug", resolution=64, seed=17)
print(mug.said)
Image.fromarray(mug.mask).resize((256, 256))

# %% [markdown]
# ## By hand
#
# A ray goes from `alpha` to `beta`, two pixels of the circle, by their index. `cast_rays` says
# where it first meets the mug, as (row, column), or (−1, −1) for a miss.

# %%
from tactile_core.exploration.world.rays import cast_rays

rays = np.array([[0, 88], [0, 30]])
cast_rays(np.stack([mug.mask, mug.mask]), rays)

# %% [markdown]
# ## In the environment
#
# It is one of Gymnasium's. `masks=` puts our mug into it, and the U-Net is the one at hand.

# %%
import gymnasium

env = gymnasium.make(
    "tactile_core:TactileExploration-v1", masks=mug.mask[None], render_mode="rgb_array"
)
observation, info = env.reset(seed=0)
observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
met = "nothing" if info["missed"] else info["touch"]
print(f"A random ray met {met}; Jaccard index {info['jaccard']:.1f}")

# %% [markdown]
# ## By a policy of the tables
#
# `coverage` is a fixed rule: it goes on to the part of the predicted outline that is farthest
# from all touches. After every ray we keep the picture.


# %%
def feel_out(name):
    """The Jaccard index and the picture after each of ten rays of a policy."""
    policy = tactile_core.policy(name, env)
    observation, info = env.reset(seed=0)
    jaccard, pictures = [], []
    for _ in range(10):
        observation, _, _, _, info = env.step(policy.act(observation, info))
        jaccard.append(info["jaccard"])
        pictures.append(env.render())
    return jaccard, pictures


jaccard, pictures = feel_out("coverage")
Image.fromarray(np.hstack([pictures[ray] for ray in (0, 2, 4, 9)])).resize((1024, 256), 0)

# %% [markdown]
# ## Who is best?
#
# `random` casts any ray; the `oracle` knows the mug and shows what could be had.

# %%
figure, axes = plt.subplots(figsize=(7, 3.5))
for name in ("random", "even", "coverage", "oracle"):
    axes.plot(range(1, 11), feel_out(name)[0], "o-", label=name)
axes.set(xlabel="rays cast", ylabel="Jaccard index")
axes.legend()
