"""A picture of a shape becomes the mask that a camera would see, or one sentence says why not."""

import io
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw

from tactile_core.dataset.drawings import FORMATS, mask_of_picture
from tactile_core.errors import TactileError

R = 64


def mug(side: int = 400, ink="black", paper="white", mode: str = "RGB") -> Image.Image:
    """A body with a handle, a hole in the handle, off the middle of the picture."""
    picture = Image.new(mode, (side, side), paper)
    draw, unit = ImageDraw.Draw(picture), side / 400
    draw.rectangle([60 * unit, 120 * unit, 180 * unit, 300 * unit], fill=ink)
    draw.ellipse(
        [130 * unit, 150 * unit, 250 * unit, 260 * unit], outline=ink, width=int(25 * unit)
    )
    return picture


def saved(picture: Image.Image, kind: str = "PNG", **options) -> bytes:
    file = io.BytesIO()
    picture.save(file, kind, **options)
    return file.getvalue()


MUG = mask_of_picture(saved(mug()), R).mask
CLEAR = (0, 0, 0, 0)
CUT_OUT = mug(ink="black", paper=CLEAR, mode="RGBA")
INK = np.asarray(mug().convert("L")) < 128
DEEP = Image.fromarray(np.asarray(mug().convert("L")).astype(np.uint16) * 257)
NOISE = np.random.default_rng(0).normal(0, 15, (400, 400))
NOISY = np.asarray(mug(ink=(60, 60, 60), paper=(200, 200, 200)).convert("L")) + NOISE


def test_a_shape_is_centred_in_the_middle_half_and_keeps_its_proportions_and_its_hole():
    rows, columns = np.nonzero(MUG)
    height, width = np.ptp(rows) + 1, np.ptp(columns) + 1
    assert np.hypot(height, width) == pytest.approx(R / 2, abs=1)
    assert width / height == pytest.approx(190 / 180, abs=0.05)
    assert abs(rows.min() + rows.max() - (R - 1)) <= 1
    assert abs(columns.min() + columns.max() - (R - 1)) <= 1
    row = MUG[(rows.min() + rows.max()) // 2, columns.min() : columns.max() + 1]
    assert row[0] and not row.all() and row[-1]  # body, hole, handle


@pytest.mark.parametrize(
    "data",
    [
        *(saved(mug(), kind) for kind in FORMATS if kind != "GIF"),
        saved(mug().quantize(2), "GIF"),
        saved(mug(), "JPEG", quality=20),
        saved(mug().convert("CMYK"), "JPEG"),
        saved(mug().convert("1")),
        saved(mug().convert("L")),
        saved(mug(ink="white", paper="black")),
        saved(mug(ink=(200, 30, 30), paper=(255, 255, 230))),
        saved(mug(ink="black", paper=CLEAR, mode="RGBA")),
        saved(mug(ink="white", paper=CLEAR, mode="RGBA")),
        saved(mug(ink="black", paper=CLEAR, mode="RGBA").convert("LA")),
        saved(CUT_OUT.crop(CUT_OUT.getbbox())),
        saved(mug(ink="white", paper=CLEAR, mode="RGBA").crop(CUT_OUT.getbbox())),
        saved(Image.fromarray(INK.astype(np.uint8))),
        saved(Image.fromarray(INK.astype(np.uint8) * 7)),
        saved(DEEP),
        saved(mug(4000)),
        saved(Image.fromarray(NOISY.clip(0, 255).astype(np.uint8))),
    ],
    ids=str,
)
def test_the_same_shape_is_found_in_every_kind_of_picture(data):
    found = mask_of_picture(data, R).mask
    assert (found & MUG).sum() / (found | MUG).sum() > 0.97


def test_it_says_what_was_done():
    speckled = mug(ink="white", paper="black")
    speckled.putpixel((1, 1), (255, 255, 255))
    mask, said = mask_of_picture(saved(speckled), R)
    np.testing.assert_array_equal(mask, MUG)
    assert said == (
        "a picture of 400 × 400 pixels, what is light taken for the shape (lighter than grey 0 of "
        "255), 1 speck left out, centred and scaled to 22 × 23 of the 64 × 64 pixels"
    )


def test_a_picture_that_a_phone_took_on_its_side_is_turned_upright():
    turned = mug().transpose(Image.Transpose.ROTATE_90)
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned a quarter clockwise
    upright = mask_of_picture(saved(turned, "JPEG", exif=exif), R).mask
    assert (upright & MUG).sum() / (upright | MUG).sum() > 0.97


def test_what_a_thin_closed_line_encloses_is_filled_and_open_lines_are_refused():
    paper = Image.new("L", (800, 800), 255)
    ImageDraw.Draw(paper).ellipse([100, 200, 500, 600], outline=0, width=3)
    mask, said = mask_of_picture(saved(paper), R)
    assert "what its thin lines enclose filled" in said
    assert mask.sum() == pytest.approx(np.pi / 4 * (R / 2) ** 2 / 2, rel=0.05)
    paper = Image.new("L", (800, 800), 255)
    ImageDraw.Draw(paper).arc([100, 200, 500, 600], 0, 200, fill=0, width=3)
    with pytest.raises(TactileError, match="lines too thin to be felt"):
        mask_of_picture(saved(paper), R)


@pytest.mark.parametrize("side", [3, 12, 64, 999])
@pytest.mark.parametrize("resolution", [48, 64, 256])
def test_pictures_of_any_size_fill_the_same_part_of_a_mask(side, resolution):
    picture = Image.new("1", (side, side), 1)
    third = side // 3
    ImageDraw.Draw(picture).rectangle([third, third, 2 * third - 1, 2 * third - 1], fill=0)
    mask = mask_of_picture(saved(picture), resolution).mask
    assert mask.shape == (resolution, resolution)
    assert np.sqrt(mask.sum()) == pytest.approx(resolution / 2 / np.sqrt(2), abs=1)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "is empty"),
        (b"hello", "is no picture of a kind that is read: PNG, JPEG"),
        (saved(mug())[:300], "cannot be read as a picture"),
        (saved(Image.new("L", (50, 50), 0)), "is black all over"),
        (saved(Image.new("1", (1, 1), 1)), "is white all over"),
        (saved(Image.fromarray((128 + NOISE / 5).astype(np.uint8)), "JPEG"), "is grey all over"),
        (saved(Image.new("RGBA", (50, 50), CLEAR)), "is transparent all over"),
        (saved(Image.new("1", (10_000, 10_000))), "more pixels than the 40 million read"),
        (b"\0" * (33 << 20), "has 33 MiB, more than the 32 read"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_shows_no_shape_is_refused_in_one_sentence(data, said):
    with pytest.raises(TactileError, match=said) as refused:
        mask_of_picture(data, R)
    assert "\n" not in str(refused.value)


def test_a_shape_that_reaches_its_picture_s_border_is_not_taken_inside_out():
    """Dark on white, and cut to its bounding box: its handle's hole would be what is felt."""
    mug = np.zeros((40, 40), bool)
    mug[:, :28] = True
    mug[8:32, 28:] = True
    mug[14:26, 28:34] = False
    with pytest.raises(TactileError, match="leave a margin around the shape"):
        mask_of_picture(saved(Image.fromarray(~mug)), R)
    framed = mask_of_picture(saved(Image.fromarray(np.pad(~mug, 5, constant_values=True))), R)
    assert "what is dark taken" in framed.said


@settings(deadline=None, max_examples=60)
@given(data=st.data(), kind=st.sampled_from(FORMATS[:-1]))
def test_a_damaged_picture_is_read_or_refused_and_nothing_else(data, kind):
    good = bytearray(saved(mug(60).convert("P"), kind) if kind == "GIF" else saved(mug(60), kind))
    places = st.lists(st.integers(0, len(good) - 1), max_size=6, unique=True)
    for place in data.draw(places):
        good[place] = data.draw(st.integers(0, 255))
    cuts = [0, *sorted(data.draw(st.lists(st.integers(0, len(good)), max_size=2))), len(good)]
    pieces = [good[start:end] for start, end in pairwise(cuts)]
    data_given = b"".join(pieces[:: data.draw(st.integers(1, 2))])
    try:
        mask = mask_of_picture(data_given, R).mask
    except TactileError:
        return
    assert mask.any() and not mask[: R // 4 - 1].any() and not mask[:, : R // 4 - 1].any()
