import json
import re
import shutil

import dagster as dg
import numpy as np
import pandas as pd
import pytest
from PIL import Image

from tactile_assets.pages import how_it_was_made, page, readme_part
from tactile_assets.provenance import how_made
from tactile_assets.publish import (
    BEGIN,
    END,
    README,
    RESULTS,
    command,
    draw_curves,
    main,
    publish,
    shown_run,
    with_results,
    written_anew,
)
from tactile_core.errors import TactileError
from tactile_core.evaluation.tables import NO_INTERVAL
from tactile_core.parquet import read_table, write_table
from tests.assets.running import Platform
from tests.shared import copied

PUBLISHED = [file.parent for file in sorted(RESULTS.glob("*/run.json"))]


def test_the_readmes_results_are_those_of_the_published_run():
    published = readme_part(shown_run())
    assert with_results(README.read_text(), published) == README.read_text(), "run: tactile publish"


def test_the_readme_begins_with_the_published_numbers():
    last = pd.read_csv(shown_run() / "per_step.csv").set_index("policy")["ray 10"]
    reached = last.str.split().str[0].astype(float)
    of_the_report = ["diff", "total", "total_miss", "pre_diff_miss"]
    told = [reached["recall"], reached["random"], reached[["even", "coverage"]].max(),
            reached[of_the_report].max()]  # fmt: skip
    sentence = README.read_text().split("**")[1]
    assert [float(number) for number in re.findall(r"\d+\.\d", sentence)] == told


@pytest.mark.parametrize("run", PUBLISHED, ids=lambda run: run.name)
def test_every_published_run_has_a_page_with_its_tables_and_pictures(run):
    written = (run / "README.md").read_text()
    assert written == page(run), "run: tactile publish"
    rows = pd.read_csv(run / "per_step.csv")
    assert written.count("| coverage |") >= 2
    assert all(f"| {policy} |" in written for policy in rows["policy"])
    assert set(re.findall(r"\]\((.*)\)", written)) == {
        file.name for file in run.iterdir() if file.suffix in (".png", ".gif")
    }


@pytest.mark.parametrize("run", PUBLISHED, ids=lambda run: run.name)
def test_published_figures_are_drawn_from_the_published_curves(run, tmp_path):
    drawn = shutil.copytree(run, tmp_path / run.name)
    draw_curves(drawn)
    for figure in ("figure_4.png", "figure_5.png"):
        if (run / figure).exists():
            pixels = [np.asarray(Image.open(folder / figure)) for folder in (run, drawn)]
            assert np.array_equal(*pixels), "run: tactile publish"


def test_the_readme_shows_the_study_where_one_is_published_and_else_the_laptops_run(tmp_path):
    (tmp_path / "laptop").mkdir()
    assert shown_run(tmp_path) == tmp_path / "laptop"
    (tmp_path / "study").mkdir()
    assert shown_run(tmp_path) == tmp_path / "study"


def test_a_page_has_the_tables_on_real_meshes_where_they_were_published(tmp_path):
    run = shutil.copytree(RESULTS / "laptop", tmp_path / "laptop")
    assert "real meshes" not in page(run)
    for name in ("per_step", "per_grasp"):
        shutil.copy(run / f"{name}.csv", run / f"real_{name}.csv")
    about = json.loads((run / "run.json").read_text()) | {"real samples": 195}
    (run / "run.json").write_text(json.dumps(about))
    assert "195 of real meshes, trained on generated ones" in how_it_was_made(run)
    assert page(run).count("on real meshes**") == 2


def test_a_page_says_below_a_table_what_limits_it(tmp_path):
    run = shutil.copytree(PUBLISHED[0], tmp_path / "run")
    about = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps({**about, "notes": {"per_step": NO_INTERVAL}}))
    below_the_table = page(run).partition("**Per step")[2].split("\n\n")[2]
    assert below_the_table == NO_INTERVAL


def test_a_run_is_told_by_the_command_that_makes_it_again():
    assert command({}) == "make run"
    settings = {"ops": {"masks": {"config": {"resolution": 128}}}}
    _, _, given = command(settings).partition("--config-json ")
    assert json.loads(given.strip("'")) == settings


@pytest.mark.parametrize("run", PUBLISHED, ids=lambda run: run.name)
def test_every_published_run_says_how_it_was_made(run):
    about = json.loads((run / "run.json").read_text())
    assert {"command", "commit", "machine", "started", "minutes", "seeds"} <= about.keys()
    assert "dirty" not in about["commit"]


def test_a_readme_without_marks_is_refused():
    with pytest.raises(TactileError, match="lacks the marks"):
        with_results("# Readme", "results")
    assert with_results(f"a {BEGIN} old {END} z", "new") == f"a {BEGIN}\n\nnew\n\n{END} z"


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """Where runs are published in a test."""
    monkeypatch.setattr("tactile_assets.publish.RESULTS", tmp_path / "results")
    monkeypatch.delenv("TACTILE_STORE", raising=False)
    return tmp_path / "results"


def publish_from(platform, monkeypatch, note=None):
    monkeypatch.setenv("TACTILE_HOME", str(platform.home))
    monkeypatch.setenv("DAGSTER_HOME", str(platform.home / "dagster"))
    publish("some", note)


def test_a_run_is_published_with_the_command_commit_and_machine_that_made_it(
    chain, elsewhere, monkeypatch
):
    publish_from(chain, monkeypatch, note="On a warm day.")
    about = json.loads((elsewhere / "some" / "run.json").read_text())
    assert about["command"].startswith(
        "TACTILE_PROFILE=smoke dagster asset materialize --select '*'"
    )
    assert about["profile"] == "smoke" and about["seeds"] == [0]
    assert "×" in about["machine"] and about["note"] == "On a warm day."
    assert len(pd.read_csv(elsewhere / "some" / "per_step.csv")) == 6
    assert "On a warm day." in page(elsewhere / "some")
    assert re.search(r"rays cast through (OpenVINO|PyTorch) on ", page(elsewhere / "some"))
    found = pd.read_csv(elsewhere / "some" / "findings.csv").set_index("finding")
    per_step = pd.read_csv(elsewhere / "some" / "per_step_summary.csv").set_index("policy")
    assert found.loc["`random` after ten rays (Figure 4)", "ours"].startswith(
        f"{per_step.loc['random', 'last']:.1f}"
    )
    assert "finding by finding" in page(elsewhere / "some")


def test_results_of_several_runs_are_not_published(chain, elsewhere, tmp_path, monkeypatch):
    copied(chain.home, tmp_path / "home")
    with dg.DagsterInstance.from_config(str(tmp_path / "home" / "dagster")) as instance:
        copy = Platform(tmp_path / "home", instance)
        copy.materialise("outlines")
        with pytest.raises(TactileError, match=r"outlines and .* were made in different runs"):
            publish_from(copy, monkeypatch)
    assert not elsewhere.exists()


def test_what_another_home_stored_is_not_published_with_the_records_of_this_one(
    chain, elsewhere, tmp_path, monkeypatch
):
    copied(chain.home, tmp_path / "home", symlinks=True)
    table = tmp_path / "home" / "artifacts" / "reconstruction_evaluation.parquet"
    write_table(read_table(table).assign(jaccard=99.0), table)
    other = r"Other content than this home made, as its records tell: reconstruction_evaluation\."
    with pytest.raises(TactileError, match=other):
        publish_from(Platform(tmp_path / "home", chain.instance), monkeypatch)
    assert not elsewhere.exists()


def test_evaluations_of_two_commits_are_not_published_as_of_one(chain, elsewhere, monkeypatch):
    def made(instance, asset):
        other = {"commit": "another"} if asset == "per_grasp_evaluation" else {}
        return how_made(instance, asset) | other

    monkeypatch.setattr("tactile_assets.publish.how_made", made)
    with pytest.raises(TactileError, match="per_grasp are of more than one commit"):
        publish_from(chain, monkeypatch)
    assert not elsewhere.exists()


def test_a_page_that_a_killed_command_had_put_aside_comes_back(elsewhere):
    (elsewhere / ".some.old").mkdir(parents=True)
    (elsewhere / ".some.old" / "run.json").write_text("{}")
    with pytest.raises(ZeroDivisionError), written_anew(elsewhere / "some"):
        raise ZeroDivisionError
    assert [file.name for file in elsewhere.rglob("*")] == ["some", "run.json"]


@pytest.mark.parametrize("name", ["", ".", "..", "../assets", "a/b", "/tmp/a", ".hidden"])
def test_what_is_no_name_of_a_run_replaces_no_folder(elsewhere, name):
    (elsewhere / "laptop").mkdir(parents=True)
    with pytest.raises(TactileError, match="names no run: give a word"):
        main(name, None)
    assert [folder.name for folder in elsewhere.iterdir()] == ["laptop"]


def test_what_is_no_published_run_is_not_replaced(elsewhere):
    (elsewhere / "bench").mkdir(parents=True)
    with pytest.raises(TactileError, match="bench holds no published run, and would be replaced"):
        publish("bench")


def test_of_an_earlier_run_nothing_stays_on_the_page(chain, elsewhere, monkeypatch):
    (elsewhere / "some").mkdir(parents=True)
    for left in ("attainable.csv", "attainable_curve.csv", "real_per_step.csv", "run.json"):
        (elsewhere / "some" / left).write_text("{}")
    publish_from(chain, monkeypatch)
    assert not list((elsewhere / "some").glob("attainable*"))
    assert not list((elsewhere / "some").glob("real*"))
    assert [folder.name for folder in elsewhere.iterdir()] == ["some"]


def test_a_figure_that_is_missing_is_named_with_its_asset_and_leaves_the_page_as_it_was(
    chain, elsewhere, tmp_path, monkeypatch
):
    copied(chain.home, tmp_path / "home", symlinks=True)
    (tmp_path / "home" / "artifacts" / "figures" / "figure_5.png").unlink()
    (elsewhere / "some").mkdir(parents=True)
    (elsewhere / "some" / "run.json").write_text("{}")
    copy = Platform(tmp_path / "home", chain.instance)
    with pytest.raises(TactileError, match=r"figure_5.png .*materialise per_grasp_evaluation"):
        publish_from(copy, monkeypatch)
    assert [file.name for file in elsewhere.rglob("*")] == ["some", "run.json"]


def test_other_variables_than_those_of_the_run_are_refused(chain, elsewhere, monkeypatch):
    monkeypatch.setenv("TACTILE_PROFILE", "laptop")
    with pytest.raises(TactileError, match="set the same"):
        publish_from(chain, monkeypatch)
    assert not elsewhere.exists()


def test_where_nothing_was_run_nothing_is_published(platform, elsewhere, monkeypatch):
    with pytest.raises(TactileError, match="is missing: materialise"):
        publish_from(platform, monkeypatch)
    assert not elsewhere.exists()


def test_without_the_environment_publishing_says_what_to_do(chain, elsewhere, monkeypatch):
    monkeypatch.setenv("TACTILE_HOME", str(chain.home))
    monkeypatch.delenv("DAGSTER_HOME", raising=False)
    with pytest.raises(TactileError, match="activate the environment first"):
        publish("some")
    assert not elsewhere.exists()
