"""How far and how long: said now and then, and never wrong by more than the pace changes."""

import pytest

from tactile_core.progress import SECONDS_BETWEEN_WORDS, counted, duration, teller, to_go


class Clock:
    """Goes on by some seconds whenever it is looked at."""

    def __init__(self, seconds: float) -> None:
        self.now, self.seconds = 0.0, seconds

    def __call__(self) -> float:
        self.now += self.seconds
        return self.now


def test_quick_work_is_told_once_and_slow_work_never_leaves_anyone_waiting():
    said: list[str] = []
    assert list(counted("abcd", 4, said.append, "letters read", Clock(0.1))) == list("abcd")
    assert said == ["4 of 4 letters read"]
    said.clear()
    list(counted("abcd", 4, said.append, "letters read", Clock(SECONDS_BETWEEN_WORDS)))
    assert said == [
        "1 of 4 letters read",
        "2 of 4 letters read; about 30 s to go",
        "3 of 4 letters read; about 15 s to go",
        "4 of 4 letters read",
    ]


def test_what_an_earlier_run_did_says_nothing_of_the_pace():
    said: list[str] = []
    tell = teller(said.append, 100, Clock(20))
    tell(90, "90 %")
    tell(95, "95 %")
    assert said == ["90 %", "95 %; about 20 s to go"]


@pytest.mark.parametrize(("done", "total"), [(0, 5), (-1, 5), (5, 5)])
def test_where_nobody_can_tell_nothing_is_said(done, total):
    assert to_go(10, done, total) == ""


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0, "0 s"), (89, "89 s"), (90, "2 min"), (3600, "60 min"), (9000, "2.5 h"), (2e5, "2.3 days")],
)
def test_times_are_in_the_unit_that_one_would_say(seconds, words):
    assert duration(seconds) == words
