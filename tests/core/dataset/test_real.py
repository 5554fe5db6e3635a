"""Real meshes become test samples by the same steps as those of the data set."""

import pandas as pd
import pytest
from upath import UPath

from tactile_core.dataset.real import render_real
from tactile_core.dataset.splits import COLUMNS
from tactile_core.settings import MaskSettings, MeshSettings, SplitSettings

BOX = "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"


@pytest.fixture
def folder(tmp_path):
    """One mug, and two bottles of which one is broken."""
    texts = {"mug/a.obj": BOX, "bottle/b.obj": BOX, "bottle/broken.obj": BOX.replace("2", "nan", 1)}
    for name, text in texts.items():
        path = tmp_path / "scans" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "scans"


def rendered(folder, home, **named) -> tuple[pd.DataFrame, pd.DataFrame]:
    return render_real(
        MeshSettings(location=str(folder)),
        MaskSettings(renderer="rasteriser"),
        SplitSettings(rotations=3),
        UPath(home / "meshes"),
        home / "cache",
        **named,
    )


def test_two_meshes_are_enough_and_all_of_them_are_for_testing(folder, tmp_path):
    samples, _ = rendered(folder, tmp_path)
    assert list(samples.columns) == COLUMNS
    assert set(samples["split"]) == {"test"}
    assert dict(samples["category"].value_counts()) == {"bottle": 3, "mug": 3}
    assert samples["sample_id"].is_unique and samples["mask"].nunique() > 3


def test_a_broken_mesh_is_set_aside_with_its_reason(folder, tmp_path):
    samples, aside = rendered(folder, tmp_path)
    assert list(aside["model_id"]) == ["broken"] and "broken" not in set(samples["model_id"])
    assert aside["status"].iloc[0]


def test_samples_that_have_not_changed_are_not_rendered_again(folder, tmp_path):
    said: list[str] = []
    samples, _ = rendered(folder, tmp_path)
    again, _ = rendered(folder, tmp_path, previous=samples, progress=said.append)
    assert again.equals(samples)
    assert "0 masks rendered, 6 unchanged" in said
