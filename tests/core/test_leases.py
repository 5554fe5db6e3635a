"""One process at a time in a folder of an object store; against a server that answers as S3."""

import subprocess
import threading
import time

import pytest
from upath import UPath

from tactile_core import leases
from tactile_core.claims import LOCK, claimed
from tactile_core.errors import TactileError
from tactile_core.leases import Claim
from tactile_core.processes import Worker
from tests.object_store import BUCKET, object_store

ELSEWHERE = Worker("another.example", 1, 0.0)


@pytest.fixture
def place(monkeypatch):
    times = {"RENEWED": 0.1, "ENDS": 1.0, "UNKNOWN": 0.4, "SETTLED": 0.2, "POLL": 0.05}
    for name, seconds in times.items():
        monkeypatch.setattr(leases, name, seconds)
    with object_store(monkeypatch):
        yield UPath(f"s3://{BUCKET}/store")


def left_behind(place: UPath, worker: Worker) -> None:
    (place / LOCK).write_bytes(Claim("a run of another home", worker).to_bytes())


def test_whoever_comes_while_another_works_is_told_so_and_follows(place):
    order, waiting = [], threading.Event()

    def second() -> None:
        with claimed(place, "second", lambda said: (order.append(said), waiting.set())):
            order.append("second works")

    with claimed(place, "first", order.append):
        thread = threading.Thread(target=second)
        thread.start()
        assert waiting.wait(10)
        time.sleep(3 * leases.ENDS)  # however long the first works, as it renews its claim
        order.append("first is done")
    thread.join()
    assert order == [f"waits until first is done in {place}", "first is done", "second works"]
    assert not (place / LOCK).exists()


def test_a_claim_whose_process_is_gone_counts_no_longer(place, monkeypatch):
    with subprocess.Popen(["sleep", "60"]) as process:
        worker = Worker.of(process.pid)
        process.kill()
    left_behind(place, worker)
    monkeypatch.setattr(leases, "ENDS", 1e6)  # it is not that which ends it
    with claimed(place, "ours", lambda said: None):
        assert Claim.from_bytes((place / LOCK).read_bytes()).name == "ours"


def test_a_claim_whose_creation_was_answered_too_late_is_not_waited_for(place, monkeypatch):
    """The client asks again where an answer is lost, and is told that the object is there."""
    created = leases._created

    def answer_lost(lock, claim):
        created(lock, claim)
        return created(lock, claim)

    monkeypatch.setattr(leases, "_created", answer_lost)
    said = []
    with claimed(place, "ours", said.append):
        assert said == []


def test_a_process_that_works_in_another_container_of_the_same_name_is_waited_for(place):
    """Its number is that of no process here, but it renews its claim."""
    with subprocess.Popen(["sleep", "60"]) as process:
        worker = Worker.of(process.pid)
        process.kill()
    lock, order = place / LOCK, []
    left_behind(place, worker)
    thread = threading.Thread(target=lambda: _work(place, order))
    thread.start()
    claim = Claim.from_bytes(lock.read_bytes())
    until = time.monotonic() + 3 * leases.ENDS
    while time.monotonic() < until:
        claim = claim.renewed()
        lock.write_bytes(claim.to_bytes())
        time.sleep(leases.RENEWED)
    order.append("the other is done")
    lock.unlink()
    thread.join()
    assert order == ["the other is done", "ours"]


def _work(place: UPath, order: list[str]) -> None:
    with claimed(place, "ours", lambda said: None):
        order.append("ours")


@pytest.mark.parametrize("damaged", [False, True])
def test_a_claim_of_another_machine_ends_when_nobody_renews_it(place, damaged):
    left_behind(place, ELSEWHERE)
    if damaged:
        (place / LOCK).write_bytes(b"{")
    said = []
    with claimed(place, "ours", said.append):
        pass
    name = "another" if damaged else "a run of another home"
    assert said == [f"waits until {name} is done in {place}"]


def test_of_several_that_find_a_dead_claim_one_works_at_a_time(place):
    left_behind(place, ELSEWHERE)
    at_work, most = [], []

    def work() -> None:
        with claimed(place, "one of four", lambda said: None):
            at_work.append(1)
            most.append(len(at_work))
            time.sleep(0.1)
            at_work.pop()

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1, 1, 1, 1]


def test_a_process_whose_claim_another_took_is_interrupted(place, monkeypatch):
    # By itself pytest would take the interrupt for the end of all tests.
    monkeypatch.setattr(leases, "_thread", lost := _Interrupts())
    with claimed(place, "ours", pytest.fail):
        left_behind(place, ELSEWHERE)
        assert lost.came.wait(10)
    assert (place / LOCK).exists()  # the other's is left alone


class _Interrupts:
    def __init__(self) -> None:
        self.came = threading.Event()

    def interrupt_main(self) -> None:
        self.came.set()


def test_a_store_that_cannot_be_written_to_is_named(place):
    nowhere = UPath("s3://nowhere/store")
    with pytest.raises(TactileError, match=f"{nowhere} cannot be written to"):
        claimed(nowhere, "ours", pytest.fail).__enter__()


def test_work_that_is_done_stays_so_where_the_store_has_gone_meanwhile(place, monkeypatch):
    with claimed(place, "ours", pytest.fail):
        monkeypatch.setattr(leases, "_holder", lambda lock: 1 / 0)
