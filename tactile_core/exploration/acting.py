"""The policies of the tables in an environment, found by their names.

env = gymnasium.make("tactile_core:TactileExploration-v1")
recall = tactile_core.policy("recall", env)
observation, info = env.reset(seed=0)
observation, reward, terminated, truncated, info = env.step(recall.act(observation, info))
"""

from typing import Any

import numpy as np

from tactile_core.errors import TactileError
from tactile_core.exploration.at_hand import POLICIES, UNET, at_hand
from tactile_core.exploration.environments import as_reconstructor, default_unet
from tactile_core.exploration.policies.base import Policy, policy_rng
from tactile_core.exploration.policies.index import read_index
from tactile_core.exploration.policies.references import REFERENCES
from tactile_core.exploration.policies.store import describe, load_policies
from tactile_core.exploration.world.interface import Interface
from tactile_core.exploration.world.state import ARRAYS, Explorations
from tactile_core.reconstruction.inference import Reconstructor


class Actor:
    """A policy that names actions, in environments of one U-Net and one action layout.

    rng : what rays that are drawn are drawn with
    deterministic : whether a policy with a distribution of rays takes its likeliest
    """

    def __init__(
        self,
        policy: Policy,
        reconstructor: Reconstructor,
        interface: Interface,
        rng: np.random.Generator,
        deterministic: bool,
    ) -> None:
        self.policy = policy
        self.reconstructor = reconstructor
        self.interface = interface
        self.rng = rng
        self.deterministic = deterministic

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The next action, (2,) int, or (N, 2) for a vector environment.

        info : as `reset` or `step` returned it; policies of the tables see `exploration` in it,
            which is more than the observation

        Raises `TactileError` for a ray that the environment's actions cannot name.
        """
        state = {name: np.asarray(info["exploration"][name]) for name in ARRAYS}
        single = state["masks"].ndim == 2
        if single:
            state = {name: array[None] for name, array in state.items()}
        elif not np.all(info.get("_exploration", True)):
            raise TactileError("info tells of some explorations only: reset all environments")
        explorations = Explorations(state["masks"], self.reconstructor)
        explorations.set_state(state)
        rays = self.policy.choose(explorations, self.rng, self.deterministic)
        actions = self.interface.actions_of(rays, explorations.resolution)
        return actions[0] if single else actions


def policy(name: str, env: Any = None, *, seed: int = 0, deterministic: bool = False) -> Actor:
    """The policy of that name, as in the tables, ready to act in `env`.

    env : an environment or vector environment, wrapped or not; without one the policy acts in what
        `gymnasium.make` makes without arguments
    seed : of the rays that it draws

    Trained policies are those of the last run, its first seed; the environment must have the U-Net
    that they were trained with. Raises `TactileError` where there is no such policy.
    """
    if env is None:
        reconstructor, interface = as_reconstructor(default_unet()), Interface()
    else:
        reconstructor, interface = attribute(env, "reconstructor"), attribute(env, "interface")
    if seed < 0:
        raise TactileError(f"seed={seed}: a seed is not negative")
    found = find_policy(name, reconstructor)
    return Actor(found, reconstructor, interface, policy_rng(found, seed), deterministic)


def find_policy(name: str, reconstructor: Reconstructor) -> Policy:
    """The rule or, of the last run, the trained policy of that name: the first that was trained
    with this U-Net."""
    if name in REFERENCES:
        return REFERENCES[name]
    stored = {place: describe(place) for place in read_index(at_hand(UNET, POLICIES) / "policies")}
    called_so = [place for place, policy in stored.items() if name in policy.policies]
    if called_so:
        its_own = [place for place in called_so if stored[place].unet == reconstructor.version]
        place = (its_own or called_so)[0]  # what was trained with another says so when it is loaded
        policies = load_policies([place], reconstructor.version, reconstructor.resolution)
        return policies[stored[place].policies.index(name)]
    known = dict.fromkeys(
        [*REFERENCES, *(one for policy in stored.values() for one in policy.policies)]
    )
    raise TactileError(f"policy {name!r} is unknown: choose from {', '.join(known)}")


def attribute(env: Any, name: str) -> Any:
    """What an environment calls so; of several side by side, the first one's."""
    env = getattr(env, "unwrapped", env)  # a VecEnv of Stable-Baselines3 has none
    return getattr(env, name) if hasattr(env, name) else env.get_attr(name)[0]
