"""`tactile feel`: anything is felt out with the weights that the package ships."""

import json

import pytest
from click.testing import CliRunner, Result
from PIL import Image, ImageDraw

from tactile_core.commands import main
from tactile_core.dataset.procedural.models import obj_bytes, procedural_models
from tactile_core.dataset.things import find_thing
from tactile_core.exploration.pretrained import FOLDER
from tactile_core.parquet import read_table
from tactile_core.settings import MeshSettings

LONG = "a" * 300  # longer than file systems take


@pytest.fixture
def feel(tmp_path, monkeypatch):
    """Runs the command in an empty folder, with an empty home."""
    monkeypatch.setenv("TACTILE_HOME", str(tmp_path / "home"))
    monkeypatch.delenv("TACTILE_STORE", raising=False)
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> Result:
        return CliRunner().invoke(main, ["feel", *arguments], catch_exceptions=False)

    return run


def test_a_generated_mug_is_felt_out_by_recall_ray_by_ray(feel, tmp_path):
    done = feel("mug")
    assert done.exit_code == 0, done.stderr
    first, second, _, heading, *rows, _, last = done.stdout.splitlines()
    assert first == f"mug: {find_thing('mug', 64).said}."
    assert second.startswith("recall feels it out with the weights that the package ships (profile")
    assert heading.split() == ["ray", "touch", "Jaccard"]
    assert [row.split()[0] for row in rows] == [str(number) for number in range(1, 11)]
    assert last.endswith("run.gif shows it.")
    with Image.open(tmp_path / "run.gif") as animation:
        assert animation.n_frames > 20


def test_the_json_says_what_the_table_says_and_is_the_same_each_time(feel, tmp_path):
    """The rays end on the true outline, and the picture shows them."""
    arguments = ["bottle", "--seed", "4", "--rays", "3", "--policy", "even", "--json"]
    one, other = (feel(*arguments, "--out", name) for name in ("a.gif", "b.gif"))
    told = json.loads(one.stdout)
    assert told == {**json.loads(other.stdout), "picture": "a.gif"}
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()
    assert (told["thing"], told["policy"], told["weights"]) == ("bottle", "even", str(FOLDER))
    assert told["trained_on"] is False
    mask = find_thing("bottle", told["resolution"], seed=4).mask
    for number, ray in enumerate(told["rays"], start=1):
        assert ray["ray"] == number and 0 <= ray["jaccard"] <= 100
        assert mask[tuple(ray["touch"])] and not mask[tuple(ray["from"])]
    rows = [line.split() for line in feel(*arguments[:-1]).stdout.splitlines()[4:7]]
    assert [row[3] for row in rows] == [f"{ray['jaccard']:.1f}" for ray in told["rays"]]


@pytest.mark.parametrize("out", ["folder.gif", "file/run.gif"])
def test_where_the_picture_cannot_go_no_ray_is_cast(feel, tmp_path, out):
    (tmp_path / "folder.gif").mkdir()
    (tmp_path / "file").write_bytes(b"")
    done = feel("mug", "--policy", "even", "--out", out)
    assert done.exit_code == 1 and done.stderr.startswith(f"Error: --out {out}: a folder has that")
    assert done.stdout == ""


def test_a_drawing_is_felt_out_and_misses_are_called_so(feel, tmp_path):
    picture = Image.new("L", (300, 200), 255)
    ImageDraw.Draw(picture).rectangle([20, 20, 60, 160], fill=0)
    picture.save(tmp_path / "my drawing.png")
    done = feel("my drawing.png", "--policy", "random", "--rays", "12")
    assert done.exit_code == 0
    assert "my drawing.png: a picture of 300 × 200 pixels, what is dark" in done.stdout
    assert "missed" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["cup"], "cup is not there: give a mesh"),
        (["mug", "--policy", "best"], "policy 'best' is unknown: choose from random, even"),
        ([LONG], f"{LONG} cannot be looked at: File name too long"),
        (
            ["mug", "--out", f"{LONG}.gif"],
            f"--out {LONG}.gif cannot be written (File name",
        ),
        (["mug", "--out", "run.mp4"], "--out run.mp4: an animation is a GIF, call it *.gif"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(feel, tmp_path, arguments, said):
    done = feel(*arguments)
    assert done.exit_code == 1 and done.stderr.startswith(f"Error: {said}")
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.glob("*.gif"))


def test_it_tells_where_the_unet_was_trained_on_the_very_object(feel, tmp_path):
    meshes = MeshSettings(procedural_models={"mug": 12, "bottle": 0})
    seen = set(read_table(FOLDER / "unet" / "trained_on.parquet")["model_id"])
    build = next(build for _, model, build in procedural_models(meshes) if model in seen)
    (tmp_path / "seen.obj").write_bytes(obj_bytes(build()))
    done = feel("seen.obj", "--policy", "even", "--rays", "1")
    assert "The U-Net was trained on this very object" in done.stdout
