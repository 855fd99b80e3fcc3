"""Blocks on a cluster: the bits of one process, workers that are lost, and what is refused."""

import asyncio
import os
import pickle
import shutil
import socket
import sys
import threading
import time
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
import tifffile

from tomo import scan_of_images
from tomo.series import on_cluster
from tomo.series.frames import blocks_of
from tomo.series.same_run import Claims

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


def listeners():
    """Return the addresses at which this process and its children take connections."""
    here = psutil.Process()
    for process in (here, *here.children(recursive=True)):
        for one in process.net_connections("tcp"):
            if one.status == psutil.CONN_LISTEN:
                yield f"{one.laddr.ip}:{one.laddr.port}"


@pytest.fixture(scope="module")
def others(scheduler):
    """Return the addresses that this process listens at without workers of its own."""
    return set(listeners())


@pytest.fixture(scope="module")
def local(others):
    """Return what solves blocks in one process of this machine, which is started again."""
    with on_cluster(workers=1) as execute:
        yield execute


def test_a_cluster_gives_the_bits_of_one_process(scheduler, plan, store, undisturbed, assert_same):
    seen = []
    with on_cluster(scheduler=scheduler) as execute:
        execute(plan, store, lambda *what: seen.append(what))
        before = {p: p.stat().st_mtime_ns for p in store.path.rglob("*") if p.is_file()}
        execute(plan, store, None)  # again: nothing is left to do
    assert_same(store, undisturbed)
    assert sorted(what[2] for what in seen if what[2]) == [
        "frames frame_000 to frame_007",
        "frames frame_008 to frame_010",
    ]
    assert seen[-1][:2] == (11, 11)
    assert before == {p: p.stat().st_mtime_ns for p in store.path.rglob("*") if p.is_file()}


def test_lost_workers_cost_their_blocks_only(local, plan, store, undisturbed, assert_same):
    """Every worker is killed while the first block is in hand: all are started again."""
    first = blocks_of(len(plan.places))[0]
    killed = []

    def kill_in_the_first_block():
        with closing(Claims(store.path)) as claims:
            while claims.take(first, wait=False):
                claims.release(first)
                time.sleep(0.005)
        for child in psutil.Process().children(recursive=True):
            if any("spawn_main" in word for word in child.cmdline()):
                child.kill()
                killed.append(child.pid)

    killer = threading.Thread(target=kill_in_the_first_block, daemon=True)
    killer.start()
    local(plan, store, None)
    killer.join()
    assert killed
    assert_same(store, undisturbed)
    assert not list(store.path.rglob("*.partial"))


def test_a_worker_lost_while_it_takes_the_plan_is_replaced(
    local, plan, store, undisturbed, assert_same, monkeypatch
):
    from tomo.series.on_worker import HeldPlan

    killed, state = store.path.parent / "killed", HeldPlan.__getstate__

    def end_at_first(packed):
        if not killed.exists():
            killed.touch()
            os._exit(1)
        return packed

    class Fatal:
        """A packed plan that ends the first process that it is given to."""

        def __init__(self, packed):
            self.packed = packed

        def __reduce__(self):
            return end_at_first, (self.packed,)

    fatal = lambda held: state(held) | {"_packed": Fatal(held._packed)}  # noqa: E731
    monkeypatch.setattr(HeldPlan, "__getstate__", fatal)
    local(plan, store, None)
    assert killed.exists()
    assert_same(store, undisturbed)


def test_other_users_of_the_machine_reach_nothing(scheduler, others, local):
    async def identity(address, timeout=1, **credentials):
        """Return what a part of Dask says of itself to one that knows its address."""
        comm = await distributed.comm.connect(address, timeout, **credentials)
        await comm.write({"op": "identity", "reply": True})
        return await comm.read()

    async def page(address):
        """Return a page of a part of Dask."""
        reader, writer = await asyncio.open_connection(*address.split(":"))
        writer.write(b"GET /health HTTP/1.0\r\n\r\n")
        status = await reader.readline()
        return status if b" 404 " not in status else b""

    async def answers():
        own = distributed.Security.temporary().get_connection_args("client")
        asked = [
            asyncio.wait_for(one, 2)
            for address in addresses
            for one in (
                identity(f"tcp://{address}"),
                identity(f"tls://{address}", **own),
                page(address),
            )
        ]
        found = await asyncio.gather(*asked, return_exceptions=True)
        return [one for one in found if one and not isinstance(one, (OSError, TimeoutError))]

    addresses = set(listeners()) - others
    assert len(addresses) >= 3  # scheduler, worker and who starts it again
    assert asyncio.run(answers()) == []
    assert asyncio.run(identity(scheduler, 30))["type"] == "Scheduler"  # one without credentials


@pytest.mark.skipif(os.name != "posix", reason="permissions of folders are POSIX")
def test_dask_imports_from_a_folder_that_no_other_user_can_write_to(local):
    folders = [Path(one) for one in sys.path if "dask-scratch-space" in one]
    assert folders
    for folder in folders:
        assert any(one.stat().st_mode & 0o077 == 0 for one in (folder, *folder.parents)), folder


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


def test_workers_lost_while_they_start_are_started_again_once(monkeypatch):
    def fails(**how):
        started.append(how)
        raise RuntimeError("Nanny failed to start.")

    started = []
    monkeypatch.setattr("tomo.series.on_worker.LocalCluster", fails)
    with pytest.raises(ChildProcessError, match=r"end as they start, twice, .*__main__"):
        on_cluster(workers=1).__enter__()
    assert len(started) == 2


def test_what_is_no_cluster_is_refused(monkeypatch):
    monkeypatch.setattr("tomo.series.cluster.PATIENCE", 0.5)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{unused.getsockname()[1]}"
        with pytest.raises(ValueError, match=f"nothing that answers at {address} within"):
            on_cluster(scheduler=address).__enter__()
    for wrong in ("nothing", "tcp://", "foo://head:1", "tcp://head:port", ""):
        with pytest.raises(ValueError, match=f"found '{wrong}', expected an address like tcp://"):
            on_cluster(scheduler=wrong).__enter__()


def test_dasks_settings_say_how_a_scheduler_is_reached():
    import dask

    with pytest.raises(ValueError, match=r"no credentials for tls://head:1, expected ca-file"):
        on_cluster(scheduler="tls://head:1").__enter__()
    with (
        dask.config.set({"distributed.comm.require-encryption": True}),
        pytest.raises(ValueError, match="found tcp://head:1, expected tls://, as"),
    ):
        on_cluster(scheduler="tcp://head:1").__enter__()


def test_a_store_that_is_copied_to_an_object_store_is_read_there(undisturbed):
    fsspec, xarray = pytest.importorskip("fsspec"), pytest.importorskip("xarray")
    fsspec.filesystem("memory").put(str(undisturbed.path), "bucket/out.zarr", recursive=True)
    data = xarray.open_zarr("memory://bucket/out.zarr", consolidated=False)
    assert np.array_equal(data.emission[9].to_numpy(), undisturbed.volume(9))
