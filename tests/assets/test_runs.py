"""One run at a time in a home and in a store; one that is killed does not stand in the way."""

import os
import signal
import socket
import subprocess

import dagster as dg
import pytest
from dagster import DagsterRunStatus

from tactile_assets.runs import HOST, PID, SINCE, clear_up, end_dead_runs, tags_of
from tactile_core.claims import claimed
from tactile_core.files import written_whole
from tactile_core.processes import Worker
from tests.assets.running import Platform, begin, nothing, until

MESHES = "dagster asset materialize --select shapenet_meshes"


def runs(platform: Platform) -> list[dg.DagsterRun]:
    """All runs, the first begun first."""
    return platform.instance.get_runs()[::-1]


def says(platform: Platform, run: dg.DagsterRun, text: str) -> bool:
    return any(text in event.message for event in platform.instance.all_logs(run.run_id))


def test_a_second_run_waits_for_the_first_and_takes_over_when_that_is_killed(platform, tmp_path):
    """The first waits in its turn, since somebody else works in the store."""
    store = tmp_path / "shared"
    with claimed(store, "a run of another home", print):
        first = begin(MESHES, platform.home, TACTILE_STORE=str(store))
        until(lambda: runs(platform) and says(platform, runs(platform)[0], "waits until"))
        second = begin(MESHES, platform.home, TACTILE_STORE=str(store))
        until(lambda: len(runs(platform)) == 2 and says(platform, runs(platform)[1], "waits until"))
        one, two = runs(platform)
        assert says(platform, one, f"waits until a run of another home is done in {store}")
        worker = f"run {one.run_id} (process {first.pid} on {one.tags[HOST]}, since "
        assert says(platform, two, f"waits until {worker}")
        assert one.status == two.status == DagsterRunStatus.STARTED
        assert one.tags[PID] == str(first.pid)
        assert end_dead_runs(platform.instance) == []  # both are alive
        first.kill()
        until(lambda: says(platform, two, f"another home is done in {store}"))
    assert second.wait() == 0, second.communicate()[1]
    assert [run.status for run in runs(platform)] == [
        DagsterRunStatus.FAILURE,
        DagsterRunStatus.SUCCESS,
    ]
    assert says(platform, one, "is gone without a word")
    assert says(platform, two, f"run {one.run_id} has ended: process {first.pid} on")


def test_an_interrupt_ends_a_run_that_waits(platform):
    with claimed(platform.home, "somebody", print):
        run = begin(MESHES, platform.home)
        until(lambda: runs(platform) and says(platform, runs(platform)[0], "waits until somebody"))
        run.send_signal(signal.SIGINT)
        assert run.wait() != 0
    assert runs(platform)[0].status == DagsterRunStatus.FAILURE


def test_a_run_that_is_killed_while_it_waits_for_a_cluster_is_over(platform):
    """Else it would stand in the way of every other."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"127.0.0.1:{silent.getsockname()[1]}"
        with begin(MESHES, platform.home, RAY_ADDRESS=address) as process:
            until(lambda: runs(platform) and PID in runs(platform)[0].tags, seconds=60)
            process.kill()
    assert runs(platform)[0].status == DagsterRunStatus.STARTED
    end_dead_runs(platform.instance)
    assert runs(platform)[0].status == DagsterRunStatus.FAILURE


@pytest.fixture
def killed() -> Worker:
    """A process that is no more."""
    with subprocess.Popen(["sleep", "60"]) as process:
        worker = Worker.of(process.pid)
        process.kill()
    return worker


def unfinished(platform: Platform, worker: Worker, **fields: str) -> DagsterRunStatus:
    """What becomes of a started run of this worker, with other tags in part."""
    run = platform.instance.create_run_for_job(
        nothing,
        status=fields.pop("status", DagsterRunStatus.STARTED),
    )
    platform.instance.add_run_tags(run.run_id, {**tags_of(worker, run.run_id), **fields})
    end_dead_runs(platform.instance)
    return platform.instance.get_run_by_id(run.run_id).status


def test_a_run_is_over_when_its_process_is_gone(platform, killed):
    assert unfinished(platform, killed) == DagsterRunStatus.FAILURE
    canceling = DagsterRunStatus.CANCELING
    assert unfinished(platform, killed, status=canceling) == DagsterRunStatus.CANCELED


def test_a_later_process_of_the_same_number_does_not_stand_for_the_run(platform, killed):
    ours = {PID: str(os.getpid())}
    assert unfinished(platform, killed, **ours, **{SINCE: "0.0"}) == DagsterRunStatus.FAILURE
    assert unfinished(platform, Worker.here()) == DagsterRunStatus.STARTED


def test_a_run_that_is_executed_again_is_not_over_as_the_one_before_is(platform, killed):
    """In the UI it begins with all tags of that one."""
    instance = platform.instance
    before = instance.create_run_for_job(nothing, status=DagsterRunStatus.FAILURE)
    again = instance.create_run_for_job(
        nothing, status=DagsterRunStatus.STARTING, tags=tags_of(killed, before.run_id),
        parent_run_id=before.run_id, root_run_id=before.run_id,
    )  # fmt: skip
    assert end_dead_runs(instance) == []
    instance.add_run_tags(again.run_id, tags_of(killed, again.run_id))
    assert len(end_dead_runs(instance)) == 1


def test_nothing_is_known_of_the_processes_of_other_machines(platform, killed):
    elsewhere = {HOST: "another.example"}
    assert unfinished(platform, killed, **elsewhere) == DagsterRunStatus.STARTED


def test_what_killed_runs_left_is_removed_but_for_the_steps_that_a_run_goes_on_from(platform):
    store, instance = platform.store, platform.instance
    over = DagsterRunStatus.FAILURE
    failed, root, under_way = (
        instance.create_run_for_job(nothing, status=status)
        for status in (over, over, DagsterRunStatus.STARTED)
    )

    def after(run: dg.DagsterRun) -> dg.DagsterRun:
        return instance.create_run_for_job(
            nothing, status=over, parent_run_id=run.run_id, root_run_id=root.run_id
        )

    between = after(root)
    parent = after(between)
    again = after(parent)
    for run in (failed, root, between, parent, under_way):
        with written_whole(store.path("steps", run.run_id, "plan.json")) as file:
            file.write(b"{}")
    half = platform.home / "cache" / "unet" / f".{'0' * 32}.part"
    half.parent.mkdir(parents=True)
    half.write_text("")
    [said] = clear_up(store, instance, again)
    assert "1 half-written files, " in said and "1 runs' steps" in said
    line = {root.run_id, between.run_id, parent.run_id}
    assert store.stored_steps() == {*line, under_way.run_id}
    assert not half.exists()
