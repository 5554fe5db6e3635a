"""The environment many times over, as Gymnasium's `VectorEnv`: one U-Net pass a step."""

from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from tactile_core.errors import TactileError
from tactile_core.exploration.world.episodes import Episodes, Options
from tactile_core.exploration.world.pictures import picture
from tactile_core.exploration.world.rewards import DIFF, Stage
from tactile_core.reconstruction.inference import Reconstructor


class TactileVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """`num_envs` environments like `TactileEnv`, in the form of Gymnasium's `SyncVectorEnv`.

    An episode that ends begins anew in the same step: its last observation and info are in
    `final_obs` and `final_info`. So every step is a ray of every episode; with a step apart for
    the reset, one pass of the U-Net in eleven would be for nothing. Stable-Baselines3 does so too.

    Environment i draws its masks from a generator of its own, seeded with `seed + i`.
    `max_episode_steps` truncates as Gymnasium's `TimeLimit` does; −1: never. Gymnasium's wrappers
    of vector observations want a reset in a step of its own: `vectorization_mode="sync"` has it.
    """

    metadata = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 2,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int,
        masks: np.ndarray,
        reconstructor: Reconstructor,
        stage: Stage = DIFF,
        *,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
        **options: Unpack[Options],
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise TactileError(f"render_mode={render_mode!r}: many at once have rgb_array only")
        self.episodes = Episodes(num_envs, masks, reconstructor, stage, **options)
        self.num_envs = num_envs
        self.reconstructor = reconstructor
        self.interface = self.episodes.interface
        self.render_mode = render_mode
        self.max_episode_steps = None if max_episode_steps == -1 else max_episode_steps
        if self.max_episode_steps is not None and self.max_episode_steps < 1:
            raise TactileError(f"max_episode_steps={max_episode_steps}: at least 1, or -1 for none")
        resolution = self.episodes.resolution
        self.single_observation_space = self.interface.observation_space(resolution)
        self.single_action_space = self.interface.action_space(resolution)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.generators: list[np.random.Generator] = []
        self.seeds: list[int] = []
        self.last_rays: np.ndarray | None = None  # (N, 2) int
        self.fresh = np.ones(num_envs, bool)  # whose episode has had no ray

    @property  # type: ignore[misc]  # read only, as that of SyncVectorEnv
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """What each environment draws its masks with; as `SyncVectorEnv`."""
        return tuple(self.generators)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """`options` are those of `TactileEnv`, for every environment, and Gymnasium's
        `reset_mask`, (N,) bool: which of them begin anew."""
        which, options = self._which(options)
        if not self.generators and len(which) < self.num_envs:
            raise ResetNeeded("no episodes have begun: the first reset() is of all, no reset_mask")
        self._seed(seed, which)
        drawn = [self.episodes.draw(self.generators[index], options) for index in which]
        self.episodes.begin(which, np.array(drawn))
        self.fresh[which] = True
        chosen = np.zeros(self.num_envs, bool)
        chosen[which] = True
        return self.episodes.observations(), batched(self.episodes.info(), chosen)

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        if not self.generators:
            raise ResetNeeded("no episodes have begun: call reset() before step()")
        cast, rewards, terminated, truncated = self.episodes.step(actions)
        if self.max_episode_steps is not None:
            truncated |= self.episodes.state.rays >= self.max_episode_steps
        self.last_rays = self.interface.rays(actions, self.episodes.resolution)
        self.fresh[:] = False
        observations, done = self.episodes.observations(), terminated | truncated
        info = self.episodes.info(cast)
        infos = batched(info, ~done)
        if done.any():
            final_obs = np.full(self.num_envs, None, object)
            for index in np.flatnonzero(done):
                final_obs[index] = observations[index].copy()
            self._restart(np.flatnonzero(done))
            observations[done] = self.episodes.observations(np.flatnonzero(done))
            infos |= batched(self.episodes.info(), np.ones(self.num_envs, bool))
            infos |= {"final_obs": final_obs, "_final_obs": done.copy()}
            infos |= {"final_info": batched(info, done), "_final_info": done.copy()}
        return observations, rewards.astype(float), terminated, truncated, infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture of each, see `pictures.picture`; None where no mode is set."""
        if not self.generators:
            raise ResetNeeded("there is nothing to show yet: call reset() before render()")
        if self.render_mode is None:
            return None
        return tuple(
            picture(
                self.episodes.state, index,
                None if self.fresh[index] or self.last_rays is None else self.last_rays[index],
            )
            for index in range(self.num_envs)
        )  # fmt: skip

    def _which(self, options: dict[str, Any] | None) -> tuple[np.ndarray, dict[str, Any] | None]:
        """The environments that `reset_mask` chooses, else all, and the options without it."""
        if options is None or "reset_mask" not in options:
            return np.arange(self.num_envs), options
        chosen = np.asarray(options["reset_mask"])
        if chosen.shape != (self.num_envs,) or chosen.dtype != bool or not chosen.any():
            raise TactileError(f"reset_mask is ({self.num_envs},) bool, one of them True")
        return np.flatnonzero(chosen), {k: v for k, v in options.items() if k != "reset_mask"}

    def _seed(self, seed: int | Sequence[int | None] | None, which: np.ndarray) -> None:
        """New generators where a seed is given, and for all at the first reset."""
        if isinstance(seed, np.ndarray):
            seed = seed.tolist()
        if not isinstance(seed, Sequence):
            seed = [None if seed is None else seed + index for index in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise TactileError(f"{len(seed)} seeds for {self.num_envs} environments: give as many")
        first = not self.generators
        if first:
            self.generators = [np.random.default_rng()] * self.num_envs
            self.seeds = [0] * self.num_envs
        for index in which:
            if first or seed[index] is not None:
                self.generators[index], self.seeds[index] = np_random(seed[index])
        self._np_random_seed = tuple(self.seeds)  # type: ignore[assignment]  # as SyncVectorEnv

    def _restart(self, which: np.ndarray) -> None:
        drawn = [self.episodes.draw(self.generators[index]) for index in which]
        self.episodes.begin(which, np.array(drawn))
        self.fresh[which] = True


def batched(info: dict[str, Any], which: np.ndarray) -> dict[str, Any]:
    """Info as Gymnasium's vector environments give it: for each key an array of N, zero where
    `which` (N,) bool is not, and `which` under the same key with an underscore before it."""
    if not which.any():
        return {}
    infos: dict[str, Any] = {}
    for key, value in info.items():
        if isinstance(value, dict):
            infos[key] = batched(value, which)
        else:
            infos[key] = np.where(which.reshape(-1, *[1] * (value.ndim - 1)), value, 0)
            infos[key] = infos[key].astype(value.dtype)
        infos[f"_{key}"] = which.copy()
    return infos
