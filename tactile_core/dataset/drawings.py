"""A black-and-white picture as a mask: what the camera would see if the shape were cut out of card.

The shape is what the picture's border is not: opaque where that is transparent, else dark on light
or light on dark, told apart by Otsu's threshold. It is centred, and scaled until its bounding box
has the diagonal of a mesh's: half the width of the image, so that it stays in the middle half.
"""

import io
import warnings
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError
from scipy import ndimage
from skimage.filters import threshold_otsu

from tactile_core.addresses import one_line
from tactile_core.errors import TactileError

SUFFIXES = (".png", ".jpg", ".jpeg", ".gif", ".bmp", ".webp", ".tif", ".tiff", ".pbm", ".pgm")
FORMATS = ("PNG", "JPEG", "GIF", "BMP", "WEBP", "TIFF", "PPM")
MOST_BYTES = 32 << 20
MOST_PIXELS = 40_000_000
LONGEST_SIDE = 2048  # larger pictures are made so small first
FEWEST_GREYS = 32  # between light and dark; less is paper, or what JPEG makes of one colour
SPECK = 0.01  # a piece of so small a share of the largest one is dust
HALF = 128  # of 255
MIXED = (0.2, 0.8)  # shares of a border that is dark which tell nothing of the background


class Drawing(NamedTuple):
    """mask : (R, R) bool; said : what was done to the picture, a sentence without its full stop"""

    mask: np.ndarray
    said: str


def mask_of_picture(data: bytes, resolution: int) -> Drawing:
    """The shape in a picture's bytes, centred and scaled in a mask (R, R).

    Raises `TactileError` with the reason, but without a name, where it is no picture that can be
    read, is larger than `MOST_BYTES` or `MOST_PIXELS`, or shows nothing; no other exception.
    """
    picture, (width, height) = read_picture(data)
    shape, how = shape_in(picture)
    said = [f"a picture of {width} × {height} pixels, {how}"]
    shape, specks = without_specks(shape)
    if specks:
        said.append(f"{specks} speck{'s' * (specks > 1)} left out")
    rows, columns = (np.flatnonzero(shape.any(axis=axis)) for axis in (1, 0))
    shape = shape[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    scale = resolution / 2 / np.hypot(*shape.shape)
    if is_line_drawing(shape, scale):
        shape = ndimage.binary_fill_holes(shape)
        said.append("what its thin lines enclose filled")
    small = scaled(shape, scale)
    if not small.any():
        raise TactileError(
            "shows nothing but lines too thin to be felt: draw a filled shape, or a closed outline"
        )
    height, width = small.shape
    mask = np.zeros((resolution, resolution), dtype=bool)
    top, left = (resolution - height) // 2, (resolution - width) // 2
    mask[top : top + height, left : left + width] = small
    said.append(
        f"centred and scaled to {height} × {width} of the {resolution} × {resolution} pixels"
    )
    return Drawing(mask, ", ".join(said))


def read_picture(data: bytes) -> tuple[Image.Image, tuple[int, int]]:
    """The first frame of a picture as RGBA, upright and not too large, and its own (width, height).

    Raises `TactileError` where it cannot be had.
    """
    if not data:
        raise TactileError("is empty")
    if len(data) > MOST_BYTES:
        raise TactileError(f"has {len(data) >> 20} MiB, more than the {MOST_BYTES >> 20} read")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of sizes, which are looked at here, and of odd tags
            picture = Image.open(io.BytesIO(data), formats=FORMATS)
            if picture.width * picture.height > MOST_PIXELS:
                raise Image.DecompressionBombError
            upright = ImageOps.exif_transpose(picture)
            colours = as_rgba(upright)
        colours.thumbnail((LONGEST_SIDE, LONGEST_SIDE))
        return colours, upright.size
    except Image.DecompressionBombError as error:
        raise TactileError(
            f"has more pixels than the {MOST_PIXELS // 1_000_000} million read: make it smaller"
        ) from error
    except UnidentifiedImageError as error:
        raise TactileError(f"is no picture of a kind that is read: {', '.join(FORMATS)}") from error
    except Exception as error:  # broken pictures fail in more ways than anyone lists
        raise TactileError(f"cannot be read as a picture ({one_line(error)})") from error


def as_rgba(picture: Image.Image) -> Image.Image:
    """A picture of any mode; greys beyond eight bits are spread over what it holds."""
    if picture.mode.startswith(("I", "F")):
        values = np.nan_to_num(np.asarray(picture, dtype=np.float64), posinf=0, neginf=0)
        spread = 255 * (values - values.min()) / max(np.ptp(values), 1)
        picture = Image.fromarray(spread.round().astype(np.uint8))
    return picture.convert("RGBA" if picture.has_transparency_data else "RGB").convert("RGBA")


def shape_in(picture: Image.Image) -> tuple[np.ndarray, str]:
    """Which pixels of a picture (RGBA) are the shape, (H, W) bool, and how that was told, in words.

    Raises `TactileError` where there is nothing that could be told from anything, or the picture's
    border is as well shape as background.
    """
    opaque = np.asarray(picture.getchannel("A")) >= HALF
    if not opaque.any():
        raise TactileError("is transparent all over: there is no shape in it")
    # Cut-outs are often trimmed to their shape, which then touches all four sides.
    if at_border(opaque).mean() < 1 - SPECK:
        return opaque, "what is opaque taken for the shape"
    white = Image.new("RGBA", picture.size, "white")
    grey = np.asarray(Image.alpha_composite(white, picture).convert("L"))
    low, high = int(grey.min()), int(grey.max())
    if high - low < FEWEST_GREYS and not is_segmentation(grey):
        colour = "black" if high < 64 else "white" if low > 191 else "grey"
        raise TactileError(f"is {colour} all over: there is no shape in it")
    threshold = int(threshold_otsu(grey))
    dark = grey <= threshold
    at_edges = float(at_border(dark).mean())
    if MIXED[0] < at_edges < MIXED[1]:
        raise TactileError(
            f"is dark along {at_edges:.0%} of its border, which tells no shape from what is around "
            "it: leave a margin around the shape"
        )
    if at_edges < 0.5:
        return dark, f"what is dark taken for the shape (grey {threshold} of 255, or darker)"
    return ~dark, f"what is light taken for the shape (lighter than grey {threshold} of 255)"


def is_segmentation(grey: np.ndarray) -> bool:
    """Whether a picture (H, W) uint8 holds two numbers, as 0 and 1, and neither by accident."""
    _, counts = np.unique(grey, return_counts=True)
    return len(counts) == 2 and bool(counts.min() > SPECK * grey.size)


def at_border(picture: np.ndarray) -> np.ndarray:
    """The pixels at the four sides of a picture (H, W)."""
    return np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])


def without_specks(shape: np.ndarray) -> tuple[np.ndarray, int]:
    """A shape (H, W) bool without its tiny pieces, and how many those were.

    One stray pixel in a corner would decide how large all the rest is.
    """
    pieces, count = ndimage.label(shape, structure=np.ones((3, 3)))
    sizes = np.bincount(pieces.ravel())[1:]
    kept = sizes >= max(SPECK * sizes.max(), 1)
    return np.append(False, kept)[pieces], int(count - kept.sum())


def is_line_drawing(shape: np.ndarray, scale: float) -> bool:
    """Whether a shape (H, W) bool is nowhere as thick as two pixels once it is scaled."""
    depth = ndimage.distance_transform_cdt(np.pad(shape, 1), metric="chessboard")
    return bool(2 * depth.max() * scale < 2)


def scaled(shape: np.ndarray, scale: float) -> np.ndarray:
    """A shape (H, W) bool at another size: a pixel belongs to it where half of it does."""
    height, width = (max(1, round(scale * side)) for side in shape.shape)
    picture = Image.fromarray(shape.astype(np.uint8) * 255)
    return np.asarray(picture.resize((width, height), Image.Resampling.BOX)) >= HALF
