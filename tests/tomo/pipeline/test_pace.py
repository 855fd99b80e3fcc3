"""Stages as they pass: their seconds, what is left of them, and of the whole."""

import itertools

import pytest

from rigs.progress import WHOLE
from tomo.pipeline import stage
from tomo.pipeline.stage import Pace


@pytest.fixture
def clock(monkeypatch):
    """Have seconds pass only where a test says so."""
    now = [0.0]
    monkeypatch.setattr(stage.time, "perf_counter", lambda: now[0])
    return lambda seconds: now.__setitem__(0, now[0] + seconds)


def test_each_stage_has_its_seconds(clock):
    own = Pace()
    assert own.stage("tracing") is None
    clock(2)
    own.stage("solve")
    clock(3)
    own.end()
    clock(7)
    own.stage("tracing")
    clock(1)
    own.end()
    assert own.seconds == {"tracing": 3, "solve": 3}
    assert own.spent == 13


def test_nothing_is_said_of_the_whole_until_something_is_expected(clock):
    calls = []
    own = Pace(lambda *step: calls.append(step))
    step = own.stage("tracing")
    step(1, 4, "cam01")
    assert calls == [(0, 1, "plan: tracing"), (1, 4, "plan: tracing: cam01")]
    clock(1)
    own.expect({"tracing": 4, "solve": 6})
    step(2, 4, "cam02")
    (spent, whole, words), last = calls[-2:]
    assert last == (2, 4, "plan: tracing: cam02")
    assert (spent, words) == (10, WHOLE)
    assert whole == 10 * (1 + 0.5 * (0.5 * 4 + 1) + 6)


def test_as_expected_it_counts_down(clock):
    own = Pace(lambda *_: None)
    own.expect({"a": 4, "b": 6})
    left = []
    for name, seconds in (("a", 4), ("b", 6)):
        step = own.stage(name)
        for part in range(seconds):
            step(part, seconds, "")
            left.append(own.left)
            clock(1)
    assert left == pytest.approx(list(range(10, 0, -1)))
    own.end()
    assert own.left == 0


@pytest.mark.parametrize("slower", [0.25, 3.0])
def test_what_is_over_corrects_what_is_to_come(clock, slower):
    own = Pace()
    own.expect({"a": 4, "b": 6, "c": 2})
    own.stage("a")
    clock(4 * slower)
    own.stage("b")
    assert own.left == pytest.approx(slower * (6 + 2))


def test_a_stage_ends_at_its_own_pace(clock):
    own = Pace(lambda *_: None)
    own.expect({"a": 100})
    step, errors = own.stage("a"), []
    for part in range(8):
        step(part, 8, "")
        errors.append(own.left - (8 - part))
        clock(1)
    assert all(after < before for before, after in itertools.pairwise(errors))
    assert 0 <= errors[-1] < 2
