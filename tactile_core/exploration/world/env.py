"""The report's environment (section VI.A) for one robot, as Gymnasium has it.

`gymnasium.make` finds it by name, see `exploration.environments`.
"""

from typing import Any, Unpack

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded

from tactile_core.dataset.packed import Masks
from tactile_core.errors import TactileError
from tactile_core.exploration.world.episodes import Episodes, Options
from tactile_core.exploration.world.pictures import Window, picture, window_missing
from tactile_core.exploration.world.rewards import DIFF, Stage
from tactile_core.reconstruction.inference import Reconstructor

ONE = np.arange(1)


class TactileEnv(gym.Env[np.ndarray, np.ndarray]):
    """Feel out an unknown shape with ten rays.

    ## Action
    `MultiDiscrete([P, P])`: `alpha` and `beta`, two pixels of the circle of radius R/2−1
    around the middle, by index into `circle.report_circle` (P = 176 at R = 64, 720 at 256).
    The ray is the pixel line from alpha to beta; its touch is the first mask pixel on it.

    With `actions="angle and offset"`, `MultiDiscrete([36, 11])`: the direction that the ray comes
    from, and which of eleven parallel rays it is, see `rays.candidate_rays`.

    ## Observation
    `Box(0, 255, (2, R, R), uint8)`

    | channel | content | range |
    |---|---|---|
    | 0 | reconstruction: probability of the object × 255 | 0–255 |
    | 1 | touches held: 255 at each, else 0 | 0 or 255 |
    | "free space", where `channels` name it | 255 where a past ray has passed | 0 or 255 |
    | "ray number", where `channels` name it | 25 in every pixel for each ray cast | 0–255 |

    ## Reward
    `stage.reward` of the cast, see `rewards`: by default what the ray adds to the Jaccard
    index (0–100), and −10 in its place for a miss or a repeat.

    ## Start
    A mask drawn uniformly from `masks`, or the one that `reset(options={"mask": 3})` names, and no
    touch held.

    ## End
    Terminated after `count` rays (`stage.ends == "rays"`) or when `count` touches are held
    (`"touches"`). Truncated after `ray_limit` rays in the latter case.

    ## Info
    `mask`, the index of the mask, and `jaccard` (0–100); after a step `touch`, (row, column) or
    (−1, −1) for a miss, `missed` and `repeated`. `exploration` holds the arrays of
    `state.Explorations`, the true mask among them: for the policies of the tables, which see more
    than the observation. A policy that learns must not see it.

    ## Arguments
    masks : (M, R, R) of 0 and 1; reconstructor : the trained U-Net; stage : reward and end;
    count, ray_limit : see End; interface : action layout and further channels;
    render_mode : "rgb_array", or "human" where a window can be opened.
    `gymnasium.make` knows others, see `environments.make_env`.

    ## Version history
    v1: made by name alone, masks chosen in `reset`, action layouts and channels, `exploration` in
    info. v0: the report's environment.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 2}  # noqa: RUF012

    def __init__(
        self,
        masks: np.ndarray,
        reconstructor: Reconstructor,
        stage: Stage = DIFF,
        *,
        render_mode: str | None = None,
        **options: Unpack[Options],
    ) -> None:
        self.episodes = Episodes(1, masks, reconstructor, stage, **options)
        self.reconstructor = reconstructor
        self.interface = self.episodes.interface
        self.action_space = self.interface.action_space(self.episodes.resolution)
        self.observation_space = self.interface.observation_space(self.episodes.resolution)
        self.render_mode = checked_mode(render_mode)
        if window_missing():  # what this environment can do here, for those who try every mode
            self.metadata = {**self.metadata, "render_modes": ["rgb_array"]}
        self.window: Window | None = None
        self.begun = False
        self.last_ray: np.ndarray | None = None  # (2,) int

    @property
    def masks(self) -> Masks:
        """Those that episodes are drawn from, (M, R, R) bool."""
        return self.episodes.masks

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        drawn = self.episodes.draw(self.np_random, options)
        self.episodes.begin(ONE, np.array([drawn]))
        self.begun = True
        self.last_ray = None
        self._show()
        return self.episodes.observations()[0], only(self.episodes.info())

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        if not self.begun:
            raise ResetNeeded("no episode has begun: call reset() before step()")
        actions = np.asarray(action)[None]
        cast, rewards, terminated, truncated = self.episodes.step(actions)
        self.last_ray = self.interface.rays(actions, self.episodes.resolution)[0]
        self._show()
        return (
            self.episodes.observations()[0], float(rewards[0]), bool(terminated[0]),
            bool(truncated[0]), only(self.episodes.info(cast)),
        )  # fmt: skip

    def render(self) -> np.ndarray | None:
        """See `pictures.picture`, (R, R, 3) uint8; None where a window shows it or nothing does."""
        if not self.begun:
            raise ResetNeeded("there is nothing to show yet: call reset() before render()")
        if self.render_mode == "rgb_array":
            return picture(self.episodes.state, 0, self.last_ray)
        self._show()
        return None

    def _show(self) -> None:
        if self.render_mode == "human":
            self.window = self.window or Window()
            self.window.show(picture(self.episodes.state, 0, self.last_ray))

    def close(self) -> None:
        if self.window:
            self.window.close()
            self.window = None


def only(info: dict[str, Any]) -> dict[str, Any]:
    """The info of one episode out of arrays of one."""
    exploration = {name: array[0] for name, array in info["exploration"].items()}
    return {key: plain(value[0]) for key, value in info.items() if key != "exploration"} | {
        "exploration": exploration
    }


def plain(value: Any) -> Any:
    """NumPy's numbers as Python's, so that they read, compare and go into JSON as such."""
    return value.item() if isinstance(value, np.generic) else value


def checked_mode(render_mode: str | None) -> str | None:
    """Raises `TactileError` where there is no such mode, or no window to be had."""
    if render_mode not in (None, "rgb_array", "human"):
        raise TactileError(f"render_mode={render_mode!r} is unknown: there are rgb_array and human")
    if render_mode == "human" and (reason := window_missing()):
        raise TactileError(
            f'render_mode="human" needs a window ({reason}): take render_mode="rgb_array" and show '
            "or store what render() returns"
        )
    return render_mode
