"""Studies are imported as the commands in ``tools/`` import them."""

import sys
from concurrent.futures import Future
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[3] / "tools"))


class InTurn(nullcontext):
    """A pool of processes that works in this one."""

    def __enter__(self):
        return self

    def submit(self, function, *arguments):
        done = Future()
        try:
            done.set_result(function(*arguments))
        except KeyboardInterrupt as error:
            done.set_exception(error)
        return done


@pytest.fixture
def in_this_process(monkeypatch):
    """Studies of scenes start no processes."""
    from studies.common import processes

    monkeypatch.setattr(processes, "_pool", InTurn)


@pytest.fixture(scope="module")
def images_as_given(as_given):
    """Let studies take images and rigs as they are unless they say otherwise, see `as_given`."""
    from studies.common import scans

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scans, "Options", partial(scans.Options, **as_given))
        yield


@pytest.fixture(scope="module", autouse=True)
def quick_studies(on_threads):
    """Let no threads spin while they wait for each other, and run no default for a fingerprint.

    Each takes most of a busy machine's time; test_figures.py takes one fingerprint.
    """
    from studies.common import results

    with pytest.MonkeyPatch.context() as patch, on_threads(1):
        patch.setenv("OMP_WAIT_POLICY", "passive")  # of processes that studies start
        patch.setattr(results, "origin", lambda: {"commit": "1234567", "default": {}})
        yield
