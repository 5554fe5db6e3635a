"""A source that has gone for a while: waited out by runs that began by themselves."""

import threading

import dagster as dg
import pytest

from tactile_assets import outages
from tactile_assets.definitions import defs
from tactile_core.errors import OutOfReachError
from tactile_core.files import read_table
from tests.assets.running import Platform, until
from tests.core.dataset.mesh_files import MUG, V1, make_zip, obj


def collected(platform: Platform, site, **tags: str) -> dg.ExecuteInProcessResult:
    config = {"classes": {"mug": MUG}, "location": site.url}
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
    monkeypatch.setattr(outages, "FIRST_WAIT", 0.2)

    def come_back() -> None:
        until(lambda: [status for *_, status in site.log].count(404) >= 2)
        make_zip(site.folder / f"{MUG}.zip", {f"{MUG}/a/{V1}": obj()})

    thread = threading.Thread(target=come_back)
    thread.start()
    result = collected(platform, site, **{tag: "weekly"})
    thread.join()
    assert result.success
    assert read_table(platform.store.path("shapenet_meshes.parquet"))["model_id"].tolist() == ["a"]
    said = [event.message for event in platform.instance.all_logs(result.run_id)]
    assert any("does not exist (404)" in line and "6 attempts" in line for line in said)


def test_a_run_begun_by_hand_ends_at_once(platform, site):
    with pytest.raises(OutOfReachError, match="404"):
        collected(platform, site)
    assert len(site.log) == 1


def test_the_waits_add_up_to_an_hour():
    waits = [outages.FIRST_WAIT * 2**attempt for attempt in range(outages.ATTEMPTS)]
    assert sum(waits) >= 3600
