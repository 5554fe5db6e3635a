"""A net that gives every candidate ray a value: what it is expected to add to the Jaccard index.

The report's policy has two independent heads for alpha and beta and cannot say "any angle,
through the middle". Here the reconstruction, the touches and the free space are sampled along
each of `candidate_rays`, so a value depends on what that ray would meet, from wherever it
comes: turning the shape turns the values.
"""

import functools

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from tactile_core.exploration.policies.base import weights_version
from tactile_core.exploration.world.circle import frozen, middle
from tactile_core.exploration.world.rays import RAYS, candidate_rays, ray_ends
from tactile_core.exploration.world.state import Explorations, to_grey
from tactile_core.reconstruction.inference import bfloat16_pays

CHANNELS = 3  # reconstruction, touches, free space
SAMPLES = 40
ANGLES, OFFSETS = 36, 11
BATCH = 128


class RayScorer(nn.Module):
    """Images (N, 3, R, R) uint8 and rays cast (N,) → values (N, angles · offsets)."""

    def __init__(self, width: int = 48, blocks: int = 3) -> None:
        super().__init__()
        self.read = nn.Conv2d(CHANNELS * SAMPLES + 1, width, 1)
        self.blocks = nn.ModuleList(RayBlock(width) for _ in range(blocks))
        self.value = nn.Conv2d(width, 1, 1)

    def forward(self, images: Tensor, rays: Tensor) -> Tensor:
        samples = along_rays(images)  # (N, C·L, angles, offsets)
        # It goes on past the rays of an episode: where nothing else changes, after a miss that told
        # nothing new, the next ray is another one all the same.
        step = (rays / RAYS)[:, None, None, None].expand(-1, 1, ANGLES, OFFSETS)
        x = functional.relu(self.read(torch.cat([samples, step], dim=1)))
        for block in self.blocks:
            x = block(x)
        return self.value(x).flatten(1)


def score(net: RayScorer, images: np.ndarray, rays: np.ndarray) -> Tensor:
    """Values (N, candidates), with gradients, of images (N, 3, R, R) uint8 and rays cast (N,)."""
    device = net.value.weight.device
    with torch.autocast(device.type, torch.bfloat16, enabled=bfloat16_pays(device.type)):
        values = net(torch.from_numpy(images).to(device), torch.from_numpy(rays).to(device))
    return values.float()


@torch.inference_mode()
def ray_values(net: RayScorer, images: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """The same as an array, (N, candidates) float32, some states at a time."""
    parts = [
        score(net, images[start : start + BATCH], rays[start : start + BATCH]).cpu().numpy()
        for start in range(0, len(images), BATCH)
    ]
    return np.concatenate(parts)


def best_ray(net: RayScorer, explorations: Explorations) -> np.ndarray:
    """The candidate ray of highest value for each exploration, (N, 2) int."""
    values = ray_values(net, scorer_images(explorations), explorations.rays)
    return candidate_rays(explorations.resolution).reshape(-1, 2)[values.argmax(axis=1)]


def best_rays_apart(net: RayScorer, explorations: Explorations, count: int) -> np.ndarray:
    """The `count` rays of highest value of every other candidate, best first, (N, count, 2) int:
    see `best_apart`."""
    values = ray_values(net, scorer_images(explorations), explorations.rays)
    return candidate_rays(explorations.resolution).reshape(-1, 2)[best_apart(values, count)]


def best_apart(values: np.ndarray, count: int) -> np.ndarray:
    """Which `count` of every other candidate have the highest values (N, C), best first, (N, count)
    int. The very best of all may be none of them, but one beside it is.

    Neighbouring candidates meet nearly the same, so only every other one takes part, in angle and
    offset as on a chessboard.
    """
    angle, offset = np.divmod(np.arange(ANGLES * OFFSETS), OFFSETS)
    apart = np.flatnonzero((angle + offset) % 2 == 0)
    return apart[np.argsort(-values[:, apart], axis=1, kind="stable")[:, :count]]


class ScorerPolicy:
    """A ray scorer: casts the candidate ray of highest value, whether deterministic or not."""

    draws = False

    def __init__(self, name: str, seed: int, net: RayScorer) -> None:
        self.name = name
        self.seed = seed
        self.net = net

    @functools.cached_property
    def version(self) -> str:
        return weights_version(self.net.state_dict())

    def choose(
        self, explorations: Explorations, rng: np.random.Generator, deterministic: bool
    ) -> np.ndarray:
        return best_ray(self.net, explorations)


class RayBlock(nn.Module):
    """Residual 3×3 convolution over neighbouring rays, circular in angle, with their mean."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.near = nn.Conv2d(width, width, 3, padding=(0, 1))
        self.all = nn.Linear(width, width)

    def forward(self, x: Tensor) -> Tensor:
        wrapped = torch.cat([x[:, :, -1:], x, x[:, :, :1]], dim=2)
        overall = self.all(x.mean(dim=(2, 3)))[:, :, None, None]
        return x + functional.relu(self.near(wrapped) + overall)


def along_rays(images: Tensor) -> Tensor:
    """Images (N, C, R, R) uint8 sampled along each candidate ray, (N, C·L, angles, offsets).

    L samples lie evenly on the half of the ray that is nearest the middle of the image.
    """
    count, channels, resolution, _ = images.shape
    where = torch.tensor(sample_pixels(resolution), device=images.device)
    samples = images.reshape(count * channels, -1).index_select(1, where)  # (N·C, rays·L)
    samples = samples.reshape(count, channels, ANGLES, OFFSETS, SAMPLES)
    samples = samples.permute(0, 1, 4, 2, 3)  # (N, C, L, angles, offsets)
    return samples.flatten(1, 2).float() / 255  # (N, C·L, angles, offsets)


@functools.cache
def sample_pixels(resolution: int) -> np.ndarray:
    """Flat pixel index of each sample of each candidate ray, (rays · L,) int64."""
    ends = ray_ends(candidate_rays(resolution, ANGLES, OFFSETS).reshape(-1, 2), resolution)
    ends = ends.astype(float) - middle(resolution)
    start, direction = ends[:, :2], ends[:, 2:] - ends[:, :2]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    nearest = -(start * direction).sum(axis=1)  # along the ray, to its point nearest the middle
    reach = np.linspace(-resolution / 4, resolution / 4, SAMPLES)
    along = (nearest[:, None] + reach)[..., None]
    points = np.rint(start[:, None] + along * direction[:, None]).astype(int) + middle(resolution)
    return frozen((points[..., 0] * resolution + points[..., 1]).ravel())


def scorer_images(explorations: Explorations) -> np.ndarray:
    """What the scorer sees of N explorations, (N, 3, R, R) uint8, 0–255.

    Touches are grown, so that no ray's samples step over them.
    """
    reach = touch_reach(explorations.resolution)
    return np.stack(
        [
            to_grey(explorations.predictions),
            grown(explorations.touches, reach) * np.uint8(255),
            explorations.free * np.uint8(255),
        ],
        axis=1,
    )


def touch_reach(resolution: int) -> int:
    """Half the way between two samples of a ray, in pixels: 1 up to resolution 156."""
    return -(-resolution // (4 * (SAMPLES - 1)))


def grown(images: np.ndarray, reach: int) -> np.ndarray:
    """Each 1 of (N, R, R) uint8 spread over the square of pixels at most `reach` away."""
    for _ in range(reach):
        wide = images.copy()
        wide[:, 1:] |= images[:, :-1]
        wide[:, :-1] |= images[:, 1:]
        images = wide.copy()
        images[:, :, 1:] |= wide[:, :, :-1]
        images[:, :, :-1] |= wide[:, :, 1:]
    return images
