"""The process that draws: the same pictures, errors where they were asked for, no orphan."""

import os
import subprocess
import sys
import threading
import time

import psutil
import pytest

import phantoms
import rigs
import tomo
from tomo.report import Artist
from tomo.report.outcome_files import Drawn, drawn

KNOWN = ("rig", "convergence", "flame")

ORPHAN = """
import os, time
from tomo.report import Artist

if __name__ == "__main__":
    artist = Artist()
    print(artist.ask(os.getpid).result(), flush=True)
    os._exit(3)
"""


@pytest.fixture(scope="module")
def outcome(as_given):
    grid = tomo.VoxelGrid((6, 9, 6), 1.0)
    rig = rigs.ring(4, 60.0, image_size=(14, 18), footprint=0.8)
    scan = tomo.simulate(rig, phantoms.create("blobs", extent=grid.extent), grid)
    return tomo.reconstruct(scan, method="mlem", iterations=5, **as_given)


@pytest.fixture(scope="module")
def artist():
    with Artist() as artist:
        yield artist


def test_what_another_process_draws_is_the_same(outcome, artist):
    here, there = drawn(outcome, KNOWN), artist.ask(drawn, outcome, KNOWN).result()
    assert [one.name for one in there.pictures] == ["difference"]
    assert [one.png for one in there.pictures] == [one.png for one in here.pictures]
    assert there.pages == here.pages
    assert set(there.pages) == {"flame.html", "rig.html"}
    assert there.warnings == here.warnings == ()


def test_what_is_known_is_not_drawn_again(outcome):
    assert drawn(outcome, (*KNOWN, "difference", "flame.html")) == Drawn()


def test_it_is_asked_in_order_and_what_follows_is_done_by_then(artist):
    reported = []
    first = artist.ask(int, "7", then=reported.append)
    second = artist.ask(os.getpid, then=reported.append)
    assert second.result() != os.getpid()
    assert reported == [first.result(), second.result()]


def test_errors_come_back(artist):
    with pytest.raises(ValueError, match="invalid literal"):
        artist.ask(int, "seven").result()
    assert artist.ask(int, "7").result() == 7


def test_a_process_that_is_killed_is_replaced_by_a_thread():
    with Artist() as artist:
        psutil.Process(artist.ask(os.getpid).result()).kill()
        assert artist.ask(threading.get_ident).result() != threading.get_ident()
        assert artist.ask(os.getpid).result() == os.getpid()


def test_it_ends_with_the_block_and_with_who_started_it(tmp_path):
    with Artist() as artist:
        number = artist.ask(os.getpid).result()
    assert _gone(number)
    path = tmp_path / "orphan.py"
    path.write_text(ORPHAN)
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (3, "")
    assert _gone(int(done.stdout))


def _gone(number):
    """Wait until a process is no more; return whether that came to be."""
    for _ in range(100):
        if not psutil.pid_exists(number) or psutil.Process(number).status() == "zombie":
            return True
        time.sleep(0.1)
    return False
