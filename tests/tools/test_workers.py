"""Calls that processes share."""

import math
import os
import time

import pytest

CALLS = [(12, 18), (7, 21), (100, 75), (17, 4)]


@pytest.fixture
def results_of(run_tool):
    from _benchmark.workers import results_of

    return results_of


@pytest.mark.parametrize("processes", [1, 2])
def test_every_call_is_made_once(results_of, processes):
    assert sorted(results_of(math.gcd, CALLS, processes)) == sorted(math.gcd(*c) for c in CALLS)


def test_calls_are_made_elsewhere_on_one_thread(results_of):
    before = dict(os.environ)
    asked = "__import__('os').getpid(), __import__('numba').get_num_threads()"
    ((process, threads),) = results_of(eval, [(asked,)], 2)
    assert process != os.getpid()
    assert threads == 1
    assert dict(os.environ) == before


def test_whoever_breaks_off_waits_for_nobody(results_of):
    started = time.monotonic()
    found = results_of(time.sleep, [(0.01,), (600.0,)], 2)
    next(found)
    found.close()
    assert time.monotonic() - started < 120


def test_an_error_is_passed_on(results_of):
    with pytest.raises(ValueError, match="math domain error"):
        list(results_of(math.sqrt, [(4.0,), (-1.0,)], 2))


def test_a_process_that_is_killed_is_told_of(results_of):
    from concurrent.futures.process import BrokenProcessPool

    with pytest.raises(BrokenProcessPool):
        list(results_of(os._exit, [(1,), (1,)], 2))
