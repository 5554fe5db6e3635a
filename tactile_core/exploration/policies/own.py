"""Policies of one's own among those of the tables: a function, or a model of Stable-Baselines3."""

import inspect
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from tactile_core.errors import TactileError
from tactile_core.exploration.world.interface import Interface
from tactile_core.exploration.world.state import ARRAYS, Explorations

HIDDEN = ("masks", "jaccard")  # what only the environment knows
FELT = [name for name in ARRAYS if name not in HIDDEN]
ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True)
class FunctionPolicy:
    """`function(observation, info)` names the next action of one exploration.

    observation : (2 + channels, R, R) uint8, as `TactileEnv` gives it
    info : `exploration` as in `TactileEnv`, but for the mask and the Jaccard index, which a robot
        does not know. All that it may go by is in these two: many explorations take turns
    returns : two whole numbers, as `interface` has actions

    An error in the function passes through with its own traceback.
    """

    name: str
    function: Callable[[np.ndarray, dict[str, Any]], Any] = field(repr=False)
    interface: Interface
    seed: int = 0
    draws: bool = False
    version: str = ""

    def choose(
        self, explorations: Explorations, rng: np.random.Generator, deterministic: bool = True
    ) -> np.ndarray:
        observations = self.interface.observe(explorations)
        state = explorations.get_state()
        actions = [
            self.act(observation, {"exploration": {name: state[name][index] for name in FELT}})
            for index, observation in enumerate(observations)
        ]
        return self.interface.rays(np.stack(actions), explorations.resolution)

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The function's action, (2,) int; raises `TactileError` where it is none."""
        answer = self.function(observation, info)
        try:
            action = np.asarray(answer)
            answer = action.tolist()
        except ValueError:  # lists of several lengths, one in the other
            action = np.empty(0)
        if action.shape != (2,) or action.dtype.kind not in "iu":
            raise TactileError(
                f"{self.name} returned {answer!r:.100}: an action is two whole numbers, "
                f"{self.interface.actions}"
            )
        return action


@dataclass(frozen=True)
class SB3Policy:
    """A model that an algorithm of Stable-Baselines3 trained, by what it predicts."""

    name: str
    model: BaseAlgorithm = field(repr=False)
    interface: Interface
    seed: int = 0
    draws: bool = True
    version: str = ""

    def choose(
        self, explorations: Explorations, rng: np.random.Generator, deterministic: bool
    ) -> np.ndarray:
        # Models draw from PyTorch's own generator, and may keep their distribution in the net: one
        # at a time, or what one draws would hang on what another thread does.
        with ONE_AT_A_TIME, torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(rng.integers(2**32)))
            actions, _ = self.model.predict(
                self.interface.observe(explorations), deterministic=deterministic
            )
        return self.interface.rays(actions, explorations.resolution)


def needs_more(model: BaseAlgorithm) -> str | None:
    """What a model goes by besides the observation, as two of sb3-contrib do; None: nothing."""
    if "action_masks" in inspect.signature(model.predict).parameters:
        return "masks of its actions"
    if hasattr(model.policy, "lstm_actor"):
        return "its memory of the episode"
    return None


def own_policy(
    name: str, choice: Any, interface: Interface, resolution: int
) -> FunctionPolicy | SB3Policy:
    """A function or a model of Stable-Baselines3 as a policy of that name.

    Raises `TactileError` for anything else, for a model that was trained on other observations or
    actions than `interface` has at this resolution, and for one that goes by more than these.
    """
    if isinstance(choice, BaseAlgorithm):
        if more := needs_more(choice):
            raise TactileError(
                f"{name} chooses by {more}, which policies of the tables are not given: write a "
                "function that calls it"
            )
        theirs = choice.observation_space, choice.action_space
        ours = interface.observation_space(resolution), interface.action_space(resolution)
        for what, their, our in zip(("observations", "actions"), theirs, ours, strict=True):
            if their != our:
                raise TactileError(
                    f"{name} was trained on {what} {their}, and these are {our}: give the actions "
                    "and channels of its environment"
                )
        return SB3Policy(name, choice, interface)
    if callable(choice):
        return FunctionPolicy(name, choice, interface)
    raise TactileError(
        f"{name} is a {type(choice).__name__}: give a function of observation and info, or a model "
        "of Stable-Baselines3"
    )
