"""Sources of meshes: one that has gone for a while, and one that has changed."""

import threading

import dagster as dg
import pytest

from tactile_assets import sources
from tactile_assets.definitions import defs
from tactile_core.errors import OutOfReachError
from tactile_core.parquet import read_table
from tactile_core.settings import MeshSettings
from tests.assets.running import Platform, until
from tests.core.dataset.mesh_files import MUG, V1, V2, make_folder, make_zip, obj


def collected(platform: Platform, location: str, **tags: str) -> dg.ExecuteInProcessResult:
    config = {"classes": {"mug": MUG}, "location": location}
    return dg.materialize(
        [*defs.assets],
        selection=["shapenet_meshes"],
        instance=platform.instance,
        resources={**defs.resources, "store": platform.store},
        run_config={"ops": {"shapenet_meshes": {"config": config}}},
        tags=tags,
    )


@pytest.mark.parametrize("tag", ["dagster/schedule_name", "dagster/sensor_name"])
def test_a_scheduled_run_goes_on_when_the_source_is_back(platform, site, monkeypatch, tag):
    monkeypatch.setattr(sources, "FIRST_WAIT", 0.2)

    def come_back() -> None:
        until(lambda: [status for *_, status in site.log].count(404) >= 2)
        make_zip(site.folder / f"{MUG}.zip", {f"{MUG}/a/{V1}": obj()})

    thread = threading.Thread(target=come_back)
    thread.start()
    result = collected(platform, site.url, **{tag: "weekly"})
    thread.join()
    assert result.success
    assert read_table(platform.store.path("shapenet_meshes.parquet"))["model_id"].tolist() == ["a"]
    said = [event.message for event in platform.instance.all_logs(result.run_id)]
    assert any("does not exist (404)" in line and "6 attempts" in line for line in said)


def test_a_run_begun_by_hand_ends_at_once(platform, site):
    with pytest.raises(OutOfReachError, match="404"):
        collected(platform, site.url)
    assert [method for method, *_ in site.log] == ["HEAD", "GET"]


def test_the_waits_add_up_to_an_hour():
    waits = [sources.FIRST_WAIT * 2**attempt for attempt in range(sources.ATTEMPTS)]
    assert sum(waits) >= 3600


def test_only_a_source_that_has_changed_is_a_reason_to_run_again(platform, tmp_path):
    folder = make_folder(tmp_path / "source", {f"{MUG}/a/{V2}": obj()})
    settings = MeshSettings(classes={"mug": MUG}, location=str(folder))
    collected(platform, str(folder))
    assert sources.news_of(platform.instance, "shapenet_meshes", settings) == ""
    make_folder(folder, {f"{MUG}/b/{V2}": obj(2)})
    news = sources.news_of(platform.instance, "shapenet_meshes", settings)
    assert news == f"What shapenet_meshes read from {folder} has changed."


def test_a_server_that_tells_no_versions_is_always_asked_again(platform, make_store, tmp_path):
    archive = make_zip(tmp_path / "a.zip", {f"{MUG}/a/{V1}": obj()})
    server = make_store(etag=None, body=archive.read_bytes())
    collected(platform, server.url.removesuffix(f"/{MUG}.zip"))
    settings = MeshSettings(classes={"mug": server.url})
    assert "is not watched" in sources.news_of(platform.instance, "shapenet_meshes", settings)
