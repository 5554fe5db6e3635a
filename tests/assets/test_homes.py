"""One home for everything, from the activation of the environment on."""

import sqlite3

import pytest

from tactile_assets.config import schedule_or_end
from tactile_assets.paths import REPOSITORY
from tests.assets.running import shell

MESHES = "dagster asset materialize --select shapenet_meshes"


def runs_recorded(home) -> int:
    with sqlite3.connect(home / "dagster" / "history" / "runs.db") as database:
        return database.execute("select count(*) from runs").fetchone()[0]


@pytest.mark.parametrize(
    "command",
    [MESHES, "python -m tactile_core publish x", "true"],
)
def test_a_home_that_cannot_be_made_stops_activation_and_every_command(tmp_path, command):
    (tmp_path / "file").write_text("")
    home = tmp_path / "file" / "not-mounted"
    stopped = shell(command, home)
    assert stopped.returncode != 0
    assert f"TACTILE_HOME={home} cannot be made" in stopped.stderr
    assert len(stopped.stderr.strip().splitlines()) == 1
    if command == "true":
        return
    ignored = shell(command, home, whatever_it_says=True)
    assert ignored.returncode != 0
    assert f"TACTILE_HOME={home} cannot be made" in ignored.stderr.splitlines()[-1]
    assert "Traceback" not in ignored.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


def test_a_home_named_after_activation_is_refused_and_nothing_is_written_there(tmp_path):
    later = f"export TACTILE_HOME={tmp_path}/later && {MESHES}"
    done = shell(later, tmp_path / "first")
    assert done.returncode != 0
    assert done.stderr.splitlines()[-1].startswith(
        f"DAGSTER_HOME={tmp_path}/first/dagster does not"
    )
    assert not list((tmp_path / "later").glob("*"))
    again = f"export TACTILE_HOME={tmp_path}/later && . ./environment.sh && {MESHES}"
    assert shell(again, tmp_path / "first").returncode == 0
    assert runs_recorded(tmp_path / "later") == 1


def test_a_relative_store_is_one_wherever_a_command_is_called(tmp_path):
    done = shell('cd /tmp && echo "$TACTILE_STORE"', tmp_path / "home", TACTILE_STORE="a store")
    assert done.stdout.strip() == f"{REPOSITORY}/a store"
    later = shell(f"export TACTILE_STORE=later && {MESHES}", tmp_path / "home")
    assert later.returncode != 0 and "give its whole path" in later.stderr.splitlines()[-1]


def test_a_home_of_any_usual_name_works_and_leaves_nothing_beside_it(tmp_path):
    name = "sp ace, #1 50% off [1]{a}:b 日本 'quoted'"
    done = shell("dg launch --assets shapenet_meshes", tmp_path / name)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert runs_recorded(tmp_path / name) == 1


def test_a_link_of_ones_own_to_dagsters_settings_stays_and_one_to_a_checkout_follows(tmp_path):
    link, own, other = (tmp_path / name for name in ("dagster/dagster.yaml", "own", "other"))
    (other / "tactile_assets").mkdir(parents=True)
    for folder in (link.parent, own, other):
        folder.mkdir(exist_ok=True)
        (folder / "dagster.yaml").write_text("telemetry: {enabled: false}")
    ours = (REPOSITORY / "dagster.yaml").resolve()
    assert shell("true", tmp_path).returncode == 0
    assert not link.is_symlink()
    for target, stays in (
        (own / "dagster.yaml", True),
        ("../own/dagster.yaml", True),
        (other / "dagster.yaml", False),
        ("../other/dagster.yaml", False),
        (tmp_path / "gone" / "dagster.yaml", False),
    ):
        link.unlink()
        link.symlink_to(target)
        before = link.resolve()
        for interpreter in ("bash", "sh"):
            assert shell(f"{interpreter} -c '. ./environment.sh'", tmp_path).returncode == 0
        assert link.resolve() == (before if stays else ours), target


@pytest.mark.parametrize(
    "cron", ["0 2 * *", "daily", "@daily", "0 0 30 2 *", "0 0 31 4 *", "0 2 * * * *"]
)
def test_what_is_no_schedule_ends_the_process_in_one_line(cron):
    with pytest.raises(SystemExit, match="is no schedule of five fields: minute, hour, day"):
        schedule_or_end({"TACTILE_CRON": cron})


def test_a_schedule_is_taken_as_it_is_and_may_be_left_out():
    assert schedule_or_end({"TACTILE_CRON": "0 2 29 2 *"}) == "0 2 29 2 *"
    assert schedule_or_end({"TACTILE_CRON": ""}) is schedule_or_end({}) is None


def test_a_command_says_so_of_a_schedule_without_a_traceback(tmp_path):
    done = shell("dagster asset list", tmp_path, TACTILE_CRON="daily")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("TACTILE_CRON='daily' is no schedule")
    assert "Traceback" not in done.stdout + done.stderr


def test_sourcing_twice_halves_the_threads_once(tmp_path):
    done = shell("echo $OMP_NUM_THREADS && . ./environment.sh && echo $OMP_NUM_THREADS", tmp_path)
    first, second = done.stdout.split()
    assert first == second


def test_an_unknown_profile_is_told_in_one_line_by_every_command(tmp_path):
    for command in (MESHES, "python -m tactile_core results"):
        done = shell(command, tmp_path, TACTILE_PROFILE="huge")
        assert done.returncode != 0
        assert done.stderr.strip().removeprefix("Error: ").splitlines() == [
            "TACTILE_PROFILE='huge' is unknown: choose one of smoke, laptop, study, report, paper"
        ]


def test_a_home_keeps_the_profile_of_its_last_run(tmp_path):
    assert shell(MESHES, tmp_path, TACTILE_PROFILE="smoke").returncode == 0
    without = shell(MESHES, tmp_path, TACTILE_PROFILE="")
    assert "profile smoke, as in the last run here; TACTILE_PROFILE names another" in without.stderr
    assert "30 of 30 meshes collected" in without.stderr
    other = 'python -c "from tactile_assets.config import which_profile; print(which_profile())"'
    named = shell(other, tmp_path, TACTILE_PROFILE="laptop")
    assert named.stdout == (
        "profile laptop; what is here was made with smoke, and is stale until made anew\n"
    )
    assert (tmp_path / "profile").read_text() == "smoke"


def test_a_profile_that_cannot_be_read_stops_commands_that_name_none_and_no_others(tmp_path):
    (tmp_path / "profile").write_bytes(b"\xff")
    without = shell(MESHES, tmp_path, TACTILE_PROFILE="")
    assert without.returncode != 0
    assert "let TACTILE_PROFILE name a profile" in without.stderr.splitlines()[-1]
    assert shell(MESHES, tmp_path, TACTILE_PROFILE="smoke").returncode == 0
    assert (tmp_path / "profile").read_text() == "smoke"
