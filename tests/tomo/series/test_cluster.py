"""Blocks on a cluster: the bits of one process, workers that are lost, and what is refused."""

import os
import pickle
import shutil
import socket
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
import tifffile

from tomo import scan_of_images
from tomo.series import on_cluster
from tomo.series.claims import Claims
from tomo.series.frames import blocks_of

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def scheduler():
    """Return the address of a cluster whose two workers are threads of this process."""
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=False,
        protocol="tcp",
        dashboard_address="127.0.0.1:0",
    ) as cluster:
        yield cluster.scheduler_address


def test_a_cluster_gives_the_bits_of_one_process(scheduler, plan, store, undisturbed, assert_same):
    seen = []
    with on_cluster(scheduler=scheduler) as execute:
        execute(plan, store, lambda *what: seen.append(what))
    assert_same(store, undisturbed)
    assert sorted(what[2] for what in seen if what[2]) == [
        "frames frame_000 to frame_007",
        "frames frame_008 to frame_010",
    ]
    assert seen[-1][:2] == (11, 11)
    before = {p: p.stat().st_mtime_ns for p in store.path.rglob("*") if p.is_file()}
    with on_cluster(scheduler=scheduler) as execute:
        execute(plan, store, None)  # again: nothing is left to do
    assert before == {p: p.stat().st_mtime_ns for p in store.path.rglob("*") if p.is_file()}


def test_lost_workers_cost_their_blocks_only(plan, store, undisturbed, assert_same):
    """Every worker is killed while the first block is in hand: all are started again."""
    first = blocks_of(len(plan.places))[0]
    mine = set(psutil.Process().children(recursive=True))
    killed = []

    def kill_in_the_first_block():
        with Claims(store.path) as claims:
            while claims.take(first, wait=False):
                claims.release(first)
                time.sleep(0.005)
        for child in set(psutil.Process().children(recursive=True)) - mine:
            if any("spawn_main" in word for word in child.cmdline()):
                child.kill()
                killed.append(child.pid)

    killer = threading.Thread(target=kill_in_the_first_block, daemon=True)
    with on_cluster(workers=1) as execute:
        killer.start()
        execute(plan, store, None)
        killer.join()
    assert killed
    assert_same(store, undisturbed)
    assert not list(store.path.rglob("*.partial"))


def test_a_worker_of_another_version_is_refused(scheduler, monkeypatch):
    own = {"flametomo": "0.1.0", "numba": "0.60.0"}
    monkeypatch.setattr("tomo.series.on_worker.own_versions", lambda: own)
    with (
        pytest.raises(
            ValueError, match=r"^worker tcp:.*: numba: found .*, expected 0\.60\.0"
        ) as no,
        on_cluster(scheduler=scheduler),
    ):
        pass
    assert "\n" not in str(no.value)


def test_a_worker_that_comes_later_is_checked_too(scheduler, plan, store, monkeypatch):
    from tomo.series import on_worker

    with on_cluster(scheduler=scheduler) as execute:
        own = on_worker.own_versions()
        monkeypatch.setattr(on_worker, "own_versions", lambda: own | {"numpy": "1.0"})
        with pytest.raises(ValueError, match=r"numpy: found 1\.0, expected"):
            execute(plan, store, None)
    assert not store.complete.any()


def test_a_store_that_a_worker_does_not_see_is_refused(plan, store):
    from tomo.series.on_worker import HeldPlan, own_versions

    def worker():
        held = pickle.loads(pickle.dumps(HeldPlan(plan, store, own_versions())))
        held.setup(SimpleNamespace(address="tcp://node7:1"))
        return held

    other, none = worker(), worker()
    block = blocks_of(len(plan.places))[0]
    os.utime(store.path / "zarr.json", (1e9, 1e9))
    with pytest.raises(ValueError, match=r"out\.zarr: worker tcp://node7:1 found another store"):
        other.solve(block, False)
    shutil.rmtree(store.path)
    with pytest.raises(ValueError, match=r"out\.zarr: worker tcp://node7:1 found no such store"):
        none.solve(block, False)


def test_a_plan_travels_without_open_films_and_with_absolute_paths(film, tmp_path, monkeypatch):
    from tomo.series.on_worker import pickled

    monkeypatch.chdir(tmp_path)
    for name, images in film.images.items():
        tifffile.imwrite(f"{name}.tif", images[:3], photometric="minisblack")
    scan = scan_of_images(film.rig, ".")
    images = scan.images("1")  # the films are open now
    copy = pickle.loads(pickled(scan))
    monkeypatch.chdir("/")
    assert all(np.array_equal(*both) for both in zip(copy.images("1"), images, strict=True))


def test_without_dask_the_message_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match=r"pip install 'flametomo\[cluster\]'"):
        on_cluster(workers=2).__enter__()


def test_what_is_no_cluster_is_refused(monkeypatch):
    monkeypatch.setattr("tomo.series.cluster.PATIENCE", 0.5)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{unused.getsockname()[1]}"
        with pytest.raises(ValueError, match=f"nothing that answers at {address} within"):
            on_cluster(scheduler=address).__enter__()
    for wrong in ("nothing", "tcp://"):
        with pytest.raises(ValueError, match=f"scheduler: found '{wrong}', expected the address"):
            on_cluster(scheduler=wrong).__enter__()


def test_a_store_that_is_copied_to_an_object_store_is_read_there(undisturbed):
    fsspec, xarray = pytest.importorskip("fsspec"), pytest.importorskip("xarray")
    fsspec.filesystem("memory").put(str(undisturbed.path), "bucket/out.zarr", recursive=True)
    data = xarray.open_zarr("memory://bucket/out.zarr", consolidated=False)
    assert np.array_equal(data.emission[9].to_numpy(), undisturbed.volume(9))
