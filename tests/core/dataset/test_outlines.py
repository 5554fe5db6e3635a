import numpy as np
import pandas as pd
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from skimage.draw import line

from tactile_core.dataset.outlines import outline, trace_outlines
from tactile_core.dataset.rendering.pictures import encode_mask
from tactile_core.dataset.shapes import as_points
from tactile_core.parquet import read_table, table_hash, write_table

masks = arrays(bool, st.tuples(st.just(12), st.just(12)), elements=st.booleans())


def picture(*rows):
    return np.array([[character == "#" for character in row] for row in rows])


def drawn(mask):
    image = np.zeros(mask.shape, dtype=int)
    image[tuple(outline(mask).T)] = 1
    return ["".join(".o"[pixel] for pixel in row) for row in image]


def flood(mask):
    """Brute force: walk the background from beyond the border, diagonal steps allowed."""
    height, width = mask.shape
    found, waiting, seen = set(), [(-1, -1)], {(-1, -1)}
    while waiting:
        row, column = waiting.pop()
        for r in range(row - 1, row + 2):
            for c in range(column - 1, column + 2):
                if not (-1 <= r <= height and -1 <= c <= width):
                    continue
                if 0 <= r < height and 0 <= c < width and mask[r, c]:
                    found.add((r, c))
                elif (r, c) not in seen:
                    seen.add((r, c))
                    waiting.append((r, c))
    return sorted(found)


@settings(deadline=None)
@given(masks)
def test_the_outline_is_what_a_walk_from_outside_bumps_into(mask):
    assert [tuple(point) for point in outline(mask)] == flood(mask)


@settings(deadline=None)
@given(masks, st.randoms(use_true_random=False))
def test_whatever_a_ray_meets_first_is_on_the_outline(mask, random):
    padded = np.pad(mask, 4)
    points = {tuple(point) for point in outline(padded)}
    size = len(padded)
    border = [(r, c) for r in range(size) for c in range(size) if {r, c} & {0, size - 1}]
    for _ in range(50):
        rows, columns = line(*random.choice(border), *random.choice(border))
        hits = np.flatnonzero(padded[rows, columns])
        if len(hits):
            assert (rows[hits[0]], columns[hits[0]]) in points


def test_concavities_belong_to_the_outline_and_holes_do_not():
    bay_and_hole = picture(
        "..........",
        ".########.",
        ".########.",
        ".##..####.",
        ".##..##.#.",
        ".##..####.",
        ".##..####.",
        "..........",
    )
    assert drawn(bay_and_hole) == [
        "..........",
        ".oooooooo.",
        ".ooooo..o.",
        ".oo..o..o.",
        ".oo..o..o.",
        ".oo..o..o.",
        ".oo..oooo.",
        "..........",
    ]


def test_a_diagonal_gap_lets_rays_into_a_hole():
    leaking = picture("#####", "#...#", "#...#", "#..#.", "####.")
    assert drawn(leaking)[1] == "o...o"


def test_points_come_in_row_major_order_as_int16():
    points = outline(picture("....", ".##.", ".##.", "...."))
    assert points.dtype == np.int16
    assert points.tolist() == [[1, 1], [1, 2], [2, 1], [2, 2]]
    assert outline(np.zeros((5, 5), dtype=bool)).shape == (0, 2)
    assert len(outline(np.ones((5, 5), dtype=bool))) == 16


def test_outlines_of_a_table_survive_storage(tmp_path):
    shapes = [np.pad(np.ones((size, 3), dtype=bool), 4) for size in (1, 2, 3)]
    shapes = [np.pad(shape, ((0, 16 - len(shape)), (0, 5))) for shape in shapes]
    samples = pd.DataFrame(
        {
            "sample_id": ["a-r0", "a-r1", "b-r0"],
            "model_id": ["a", "a", "b"],
            "category": "mug",
            "split": ["train", "train", "test"],
            "mask": [encode_mask(shape) for shape in shapes],
        },
        index=[7, 7, 3],
    )
    outlines = trace_outlines(samples)
    assert list(outlines) == [
        "sample_id", "model_id", "category", "split", "outline", "mask_hash", "key",
    ]  # fmt: skip
    write_table(outlines, tmp_path / "outlines.parquet")
    stored = read_table(tmp_path / "outlines.parquet")
    for shape, cell in zip(shapes, stored["outline"], strict=True):
        assert as_points(cell).dtype == np.int16
        assert (as_points(cell) == outline(shape)).all()
    assert table_hash(stored) == table_hash(outlines)
    by_pandas = pd.read_parquet(tmp_path / "outlines.parquet")["outline"]
    assert (as_points(by_pandas[2]) == outline(shapes[2])).all()


def test_only_masks_that_are_new_are_traced():
    masks = [np.pad(np.ones((size, size), bool), (4, 12 - size)) for size in (2, 3, 4, 5)]
    samples = pd.DataFrame(
        {
            "sample_id": ["a", "b", "c", "d"],
            "model_id": ["a", "b", "c", "d"],
            "category": "mug",
            "split": "train",
            "mask": list(map(encode_mask, masks)),
        }
    )
    whole = trace_outlines(samples)
    before = trace_outlines(samples.iloc[[2, 0]])
    before.at[1, "outline"] = np.zeros((1, 2), np.int16)  # as nobody would trace it again
    said: list[str] = []
    after = trace_outlines(samples, before, said.append)
    assert said[-1] == "2 outlines traced, 2 unchanged"
    assert len(after["outline"][0]) == 1
    assert table_hash(after.iloc[1:]) == table_hash(whole.iloc[1:])
    anew = trace_outlines(samples, before.assign(key="of other code"), said.append)
    assert said[-1] == "4 outlines traced, 0 unchanged"
    assert table_hash(anew) == table_hash(whole)
