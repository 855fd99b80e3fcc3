"""Every piece is done once, on as many threads as there are, and a failure ends the work."""

import threading
import time

import numba
import pytest

from tomo._compute.threads import WORTH_WAKING, run_chunks, run_ranges, threads_worth


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 4, 100])
def test_every_piece_is_done_once(threads, count):
    done, workers = [], []

    def worker():
        workers.append(threading.current_thread())
        return done.append

    run_chunks(iter(range(count)), threads, worker)
    assert sorted(done) == list(range(count))
    assert len(workers) == max(min(threads, count), 1)
    assert threading.current_thread() in workers


def test_pieces_are_done_at_the_same_time():
    together = threading.Barrier(3, timeout=10)
    run_chunks(range(3), 3, lambda: lambda piece: together.wait())


@pytest.mark.skipif(numba.get_num_threads() < 2, reason="one thread is all there are")
def test_pieces_have_one_thread_each_and_what_comes_after_them_all():
    before, inside = numba.get_num_threads(), []
    run_chunks(range(8), 2, lambda: lambda piece: inside.append(numba.get_num_threads()))
    assert inside == [1] * 8
    run_chunks(range(2), 1, lambda: lambda piece: inside.append(numba.get_num_threads()))
    assert inside[8:] == [before] * 2
    assert numba.get_num_threads() == before


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("count", [0, 1, 3, 100])
def test_parts_make_up_the_range(threads, count, on_threads):
    parts = []
    with on_threads(threads):
        run_ranges(count, lambda start, stop: parts.append((start, stop)))
    assert sorted(number for part in parts for number in range(*part)) == list(range(count))
    assert len(parts) == 1 or threads > 1


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_failure_ends_the_work_and_is_raised(error):
    done, main = [], threading.main_thread()

    def piece(number):
        if threading.current_thread() is main:
            raise error("this one")
        done.append(number)
        time.sleep(0.01)

    before = threading.active_count()
    with pytest.raises(error, match="this one"):
        run_chunks(range(10_000), 2, lambda: piece)
    assert len(done) < 10_000
    assert threading.active_count() == before


def test_what_another_thread_raises_is_raised_here():
    here = threading.current_thread()

    def piece(number):
        if threading.current_thread() is not here:
            raise ValueError(f"piece {number}")
        time.sleep(0.01)

    with pytest.raises(ValueError, match="piece"):
        run_chunks(range(1000), 2, lambda: piece)


def test_where_no_more_threads_are_to_be_had_those_begun_end(monkeypatch):
    done, start, begun = [], threading.Thread.start, []

    def piece(number):
        time.sleep(0.01)
        done.append(number)

    def start_one(thread):
        if begun:
            raise RuntimeError("can't start new thread")
        begun.append(thread)
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", start_one)
    with pytest.raises(RuntimeError, match="new thread"):
        run_chunks(range(1000), 3, lambda: piece)
    begun[0].join(timeout=5)
    assert not begun[0].is_alive()
    assert len(done) < 1000


def test_small_work_wakes_no_thread_and_the_number_comes_back():
    threads = numba.get_num_threads()

    def fail():
        with threads_worth(WORTH_WAKING / 2):
            assert numba.get_num_threads() == 1
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert numba.get_num_threads() == threads
    with threads_worth(1e12):
        assert numba.get_num_threads() == threads
