"""A film on a device: its frames, a device that is lost, a worker's own device."""

import pickle
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from host_build import StandIn

from tomo.operators.gpu import DeviceError
from tomo.selection import choose
from tomo.series import reconstruct_series
from tomo.series.run import run_plan

pytestmark = pytest.mark.usefixtures("quick_choices")


NEAR = 1e-4
"""Of the norm. Products round otherwise in the last bit, and in 40 iterations roundings grow some
three hundredfold where four views leave voxels to the noise: a last bit of the images moves the
CPU's own volumes of these frames by as much."""


def off(one, other):
    values, expected = (each.group["emission"][:].ravel() for each in (one, other))
    return np.linalg.norm(values - expected) / np.linalg.norm(expected)


class Lost(Exception):  # noqa: N818
    """What CuPy raises where a device is gone."""


Lost.__module__ = "cupy_backends.cuda.api.runtime"


@pytest.fixture(scope="module")
def run(film, tmp_path_factory):
    """Return a function that computes the film on a device, in one go."""

    def computed(**how):
        path = tmp_path_factory.mktemp("device") / "out.zarr"
        options = film.options.but(device="auto", **how)
        return reconstruct_series(film.scan, path, options=options)

    return computed


@pytest.fixture(scope="module")
def launched():
    """Return the names of the kernels that ran on the stand-in for the store, one by one."""
    return []


@pytest.fixture(scope="module")
def store(run, host, launched, choose_quickly):
    """Return the film computed on a stand-in for a device."""

    def launch(*arguments):
        launched.append(arguments[0])
        host.launch(*arguments)

    with pytest.MonkeyPatch.context() as patch, choose_quickly():
        patch.setitem(sys.modules, "cupy", StandIn(SimpleNamespace(launch=launch)))
        return run()


def test_volumes_are_those_of_the_cpu(store, undisturbed):
    assert store.attributes["place"] == "computed on Stand-in (cuda:0)"
    assert undisturbed.attributes["place"] == "computed on the CPU"
    assert store.attributes["plan"]["device"] == "cuda"
    assert off(store, undisturbed) < NEAR


def test_arrays_that_are_not_numpys_give_the_same_bits(run, cupy, on_arrays_of, monkeypatch):
    monkeypatch.setattr(choose, "MOVES", ())  # one setting: choosing is tested where it is done
    brief = {"frames": "0:2", "key_frames": 1, "iterations": 4}
    expected = run(**brief)
    on_arrays_of("array_api_strict")
    assert np.array_equal(run(**brief).group["emission"][:], expected.group["emission"][:])


def test_the_page_of_a_film_says_where_it_was_computed(store):
    from tomo.report import write_series_outcome

    report = write_series_outcome(store, with_film=False)
    assert report["place"] == "computed on Stand-in (cuda:0)"
    assert report["place"] in Path(report["page"]).read_text("utf-8")


def test_a_lost_device_leaves_the_frames_that_are_done(
    film, cupy, store, launched, tmp_path, monkeypatch, assert_same
):
    launch, path = cupy.host.launch, tmp_path / "out.zarr"
    options = film.options.but(device="auto")
    left = len(launched) - 5  # the last block's last launches fail

    def failing(*arguments):
        nonlocal left
        left -= 1
        if left < 0:
            raise Lost("cudaErrorECCUncorrectable: uncorrectable ECC error")
        launch(*arguments)

    monkeypatch.setattr(cupy, "host", SimpleNamespace(launch=failing))
    with pytest.raises(DeviceError) as caught:
        reconstruct_series(film.scan, path, options=options)
    assert str(caught.value) == (
        f"{path}: GPU: Stand-in (cuda:0): cudaErrorECCUncorrectable: uncorrectable ECC error; "
        "8 of 11 frames are complete and stay: the same command goes on"
    )
    monkeypatch.setattr(cupy, "host", SimpleNamespace(launch=launch))
    assert_same(reconstruct_series(film.scan, path, options=options), store)


def test_what_began_on_a_device_does_not_go_on_elsewhere(film, store, monkeypatch, tmp_path):
    path = tmp_path / "out.zarr"
    shutil.copytree(store.path, path)
    (path / "complete" / "c" / "1").unlink()  # the last block is to be done again
    monkeypatch.setitem(sys.modules, "cupy", None)
    with pytest.raises(ValueError, match=r"plan\.device: found 'cuda' in the store, and now None"):
        reconstruct_series(film.scan, path, options=film.options.but(device="auto"))


@pytest.mark.parametrize(("device", "expected"), [("cuda", "cuda:1"), ("cuda:0", "cuda:0")])
def test_a_worker_takes_the_device_of_its_number(plan, cupy, monkeypatch, device, expected):
    from tomo.series.on_worker import pickled, rank_of

    monkeypatch.setattr(cupy.cuda.runtime, "getDeviceCount", lambda: 2)
    asked = replace(plan, options=plan.options.but(device=device))
    here = asked.at_device_of(0)
    sent = pickle.loads(pickled(replace(here, options=asked.options).on_cpu))
    there = sent.at_device_of(rank_of("3"))
    assert there.options.device == expected
    for system in (there.system.built.system, there.system.apart):
        assert system.projector.device.name == f"Stand-in ({expected})"
    x = np.random.default_rng(0).random(plan.system.active.size, np.float32)
    one, other = (each.system.built.system.projector @ x for each in (here, there))
    assert np.array_equal(one, other)
    assert rank_of("tcp://127.0.0.1:4000") == 0


def test_a_plan_of_the_cpu_stays_there(plan, store):
    assert plan.at_device_of(3).system.built.system.projector is plan.system.built.system.projector
    assert run_plan(plan, store) is None  # everything is there: nothing is solved
