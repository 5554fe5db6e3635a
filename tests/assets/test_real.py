"""The evaluations again, on real meshes: there where TACTILE_REAL names some, and nowhere else."""

from collections.abc import Iterator

import dagster as dg
import pandas as pd
import pytest

from tactile_assets import pages, publish, real
from tactile_assets.config import PROFILE
from tactile_assets.definitions import defs
from tactile_core.dataset.procedural.models import obj_bytes, procedural_models
from tactile_core.dataset.rendering.pictures import decode_masks, encode_mask
from tactile_core.errors import TactileError
from tactile_core.parquet import read_table
from tactile_core.reconstruction.trained import load_unet
from tactile_core.settings import MeshSettings
from tests.assets.running import Platform, run_for, shell
from tests.shared import copied

NAMES = ["real_shapes", "real_rollouts", "real_per_step_evaluation", "real_per_grasp_evaluation"]
EVALUATIONS = {"real_per_step": "per_step", "real_per_grasp": "per_grasp"}


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    """A folder with a mug and a bottle that no policy has met, and a broken mug."""
    folder = tmp_path_factory.mktemp("scans")
    models = procedural_models(MeshSettings(procedural_models={"mug": 1, "bottle": 1}, seed=7))
    for category, _, build in models:
        (folder / category).mkdir()
        (folder / category / f"scanned-{category}.obj").write_bytes(obj_bytes(build()))
    (folder / "mug" / "broken.obj").write_text("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n")
    return folder


@pytest.fixture(scope="module")
def evaluated(chain, scans, tmp_path_factory) -> Iterator[Platform]:
    """A home where the finished run's policies have been evaluated on the scans; not to be
    changed."""
    home = copied(chain.home, tmp_path_factory.mktemp("real") / "home")
    fields = {
        f"real_{evaluation}": run_for((evaluation,))["ops"][evaluation]
        for evaluation in ("rollouts", "per_step_evaluation", "per_grasp_evaluation")
    }
    with (
        dg.DagsterInstance.from_config(str(home / "dagster")) as instance,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("TACTILE_REAL", str(scans))
        platform = Platform(home, instance)
        dg.materialize(
            [*defs.assets, *real.ASSETS],
            selection=dg.AssetSelection.assets(*NAMES),
            instance=instance,
            resources={**defs.resources, "store": platform.store},
            run_config={
                "ops": {"real_shapes": {"config": {"location": str(scans)}}, **fields},
            },
        )
        yield platform


def listed(home, **variables: str) -> set[str]:
    done = shell("dagster asset list", home, **variables)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


def test_the_assets_exist_where_the_variable_names_meshes_and_change_no_other(scans, tmp_path):
    without = {key.path[-1] for key in defs.resolve_asset_graph().get_all_asset_keys()}
    assert not without & set(NAMES)
    assert listed(tmp_path, TACTILE_REAL=str(scans)) == without | set(NAMES)


def test_the_tables_are_those_of_the_test_split_on_real_samples_alone(evaluated):
    def table(name: str) -> pd.DataFrame:
        return read_table(evaluated.store.path(f"{name}.parquet"))

    shapes = table("real_shapes")
    assert list(shapes.columns) == list(table("rotated_splits").columns)
    assert set(shapes["model_id"]) == {"scanned-mug", "scanned-bottle"}
    for ours, theirs in EVALUATIONS.items():
        rows, main = table(f"{ours}_evaluation"), table(f"{theirs}_evaluation")
        assert list(rows.dtypes.items()) == list(main.dtypes.items())
        assert set(rows["sample_id"]) == set(shapes["sample_id"])
        assert set(rows["policy"]) == set(main["policy"])


def test_a_broken_mesh_is_counted_with_its_reason_and_stops_nothing(evaluated):
    event = evaluated.instance.get_latest_materialization_event(dg.AssetKey("real_shapes"))
    metadata = event.asset_materialization.metadata
    assert metadata["set_aside"].value == 1
    [aside] = metadata["meshes_set_aside"].records
    assert "broken" in aside.data["model_id"]


def test_figures_of_the_test_split_stay_beside_those_of_the_real_meshes(evaluated, chain):
    for figure in pages.PICTURES:
        kept = chain.store.path("figures", figure).read_bytes()
        assert evaluated.store.path("figures", figure).read_bytes() == kept
        assert evaluated.store.path("figures", f"real_{figure}").read_bytes() != kept


def test_the_real_rows_are_printed_where_the_variable_is_set(evaluated, scans):
    for variables, printed in (({}, False), ({"TACTILE_REAL": str(scans)}, True)):
        done = shell("python -m tactile_core results", evaluated.home, **variables)
        assert done.returncode == 0, done.stderr
        assert ("Per grasp, on real meshes" in done.stdout) == printed
        assert ("4 real ones" in done.stdout) == printed


def test_the_real_rows_are_published_with_the_variable_and_leave_with_it(
    evaluated, chain, scans, tmp_path, monkeypatch
):
    monkeypatch.setattr(publish, "RESULTS", tmp_path / "results")
    monkeypatch.setenv("TACTILE_HOME", str(evaluated.home))
    monkeypatch.setenv("DAGSTER_HOME", str(evaluated.home / "dagster"))
    monkeypatch.setenv("TACTILE_REAL", str(scans))
    monkeypatch.setattr(
        "tactile_assets.results.PROFILE", PROFILE.model_copy(update={"real": str(scans)})
    )
    publish.publish("some", note="On a warm day.")
    folder = tmp_path / "results" / "some"
    for name in EVALUATIONS:
        for part in ("", "_curve", "_summary"):
            assert len(pd.read_csv(folder / f"{name}{part}.csv")), name
    text = pages.page(folder)
    assert f"TACTILE_REAL={scans} dagster asset materialize --select '*' --config-json" in text
    assert "4 of real meshes, trained on generated ones. On a warm day." in text
    assert text.count("on real meshes**") == 2

    monkeypatch.delenv("TACTILE_REAL")
    monkeypatch.setattr("tactile_assets.results.PROFILE", PROFILE)
    publish.publish("some")
    assert not list(folder.glob("real_*"))
    assert "real meshes" not in pages.page(folder)


def test_shapes_of_another_resolution_than_the_unets_are_refused_in_one_line(evaluated):
    shapes = read_table(evaluated.store.path("real_shapes.parquet"))
    smaller = [encode_mask(mask[8:-8, 8:-8]) for mask in decode_masks(shapes["mask"])]
    with pytest.raises(TactileError, match=r"have resolution 48.*trained at 64"):
        real.shapes_for(load_unet(evaluated.store.path("unet")), shapes.assign(mask=smaller))
