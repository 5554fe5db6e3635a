"""The environment for training with Stable-Baselines3: many episodes in one batch, one U-Net pass
a step. `vector_env` has the same for Gymnasium."""

from collections.abc import Iterable, Sequence
from typing import Any, Unpack

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils.seeding import np_random
from stable_baselines3.common.vec_env import VecEnv

from tactile_core.dataset.packed import Masks
from tactile_core.exploration.world.episodes import Episodes, Options
from tactile_core.exploration.world.rewards import Stage
from tactile_core.exploration.world.state import Explorations
from tactile_core.reconstruction.inference import Reconstructor


class BatchedTactileEnv(VecEnv):
    """Many environments like `TactileEnv`, step for step, as one Stable-Baselines3 VecEnv.

    `reward_scale` multiplies the rewards that the learner sees; the returns in an episode's
    info stay in Jaccard points. Environment i draws its masks from a generator of its own,
    seeded with `seed + i` as Stable-Baselines3 seeds single environments; the state can be
    read and set, so that a training resumes exactly.
    """

    def __init__(
        self,
        environments: int,
        masks: Masks,
        reconstructor: Reconstructor,
        stage: Stage,
        *,
        reward_scale: float = 1.0,
        seed: int = 0,
        **options: Unpack[Options],
    ) -> None:
        self.episodes = Episodes(environments, masks, reconstructor, stage, **options)
        self.reconstructor = reconstructor
        self.interface = self.episodes.interface
        self.reward_scale = reward_scale
        self.generators = [np_random(seed + index)[0] for index in range(environments)]
        self.returns = np.zeros(environments, np.float32)
        self.begun = False
        self.render_mode = None
        interface, resolution = self.episodes.interface, self.episodes.resolution
        super().__init__(
            environments,
            interface.observation_space(resolution),
            interface.action_space(resolution),
        )

    @property
    def stage(self) -> Stage:
        return self.episodes.stage

    @property
    def state(self) -> Explorations:
        """The explorations under way."""
        return self.episodes.state

    @property
    def drawn(self) -> np.ndarray:
        """The mask of each episode, (N,) int."""
        return self.episodes.drawn

    def reset(self) -> np.ndarray:
        for index, seed in enumerate(self._seeds):
            if seed is not None:
                self.generators[index] = np_random(seed)[0]
        options = [*self._options]  # of `set_options`: those of `TactileEnv`, for each environment
        self._reset_seeds()
        self._reset_options()
        self.restart(np.arange(self.num_envs), options)
        return self.episodes.observations()

    def restart(self, which: np.ndarray, options: Sequence[dict[str, Any]] | None = None) -> None:
        """New episodes in the environments at indices `which`, on newly drawn masks or those of
        `options`."""
        self.begun = True
        chosen = options or [{}] * self.num_envs
        drawn = [self.episodes.draw(self.generators[index], chosen[index]) for index in which]
        self.episodes.begin(which, np.array(drawn, int))
        self.returns[which] = 0

    def step_async(self, actions: np.ndarray) -> None:
        self.actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        if not self.begun:
            raise ResetNeeded("no episodes have begun: call reset() before step()")
        _, rewards, terminated, truncated = self.episodes.step(self.actions)
        done = terminated | truncated
        self.returns += rewards
        observations = self.episodes.observations()
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        ended = np.flatnonzero(done)
        for index in ended:
            infos[index] = {
                "terminal_observation": observations[index].copy(),
                "TimeLimit.truncated": bool(truncated[index]),
                "episode": {"r": float(self.returns[index]), "l": int(self.state.rays[index])},
                "jaccard": float(self.state.jaccard[index]),
                "held": int(self.state.held[index]),
            }
        if len(ended):
            self.restart(ended)
            observations[ended] = self.episodes.observations(ended)
        return observations, rewards * np.float32(self.reward_scale), done, infos

    def get_state(self) -> dict[str, Any]:
        """Everything that the coming episodes depend on, as plain arrays."""
        return {
            "generators": [generator.bit_generator.state for generator in self.generators],
            "drawn": self.drawn.copy(),
            "returns": self.returns.copy(),
            "explorations": self.state.get_state(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from what `get_state` returned."""
        self.begun = True
        for generator, saved in zip(self.generators, state["generators"], strict=True):
            generator.bit_generator.state = saved
        self.drawn[:] = state["drawn"]
        self.returns[:] = state["returns"]
        self.state.set_state(state["explorations"])

    def close(self) -> None:
        """Nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self, attr_name)] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        result = getattr(self, method_name)(*args, **kwargs)
        return [result] * len(self._chosen(indices))

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        return [False] * len(self._chosen(indices))

    def _chosen(self, indices: int | Iterable[int] | None) -> Sequence[int]:
        return list(self._get_indices(indices))
