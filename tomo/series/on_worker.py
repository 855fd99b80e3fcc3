"""One worker of a cluster: the plan that it holds, and the blocks that it is given.

Dask's processes run what they are sent, and all users of a machine reach 127.0.0.1. So those of
this machine take connections by TLS alone, with a key of the run that is not kept on disk, and
import from a folder of the run, which others cannot write to.
"""

from __future__ import annotations

import importlib.metadata
import io
import logging
import os
import pickle
import re
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory

import dask
import numba
from distributed import Client, LocalCluster, Security, WorkerPlugin, get_worker

from tomo.series.plan import Plan
from tomo.series.run import run_blocks
from tomo.series.same_run import COMPARED_VERSIONS, Claims
from tomo.series.store import SeriesStore


class HeldPlan(WorkerPlugin):
    """A plan that Dask's scheduler gives to every worker once, also to those that come later.

    Dask calls ``setup`` where it listens for messages: the plan is unpacked by the first block.
    The store is on a disk that all share; ``versions`` are those of the process that made the
    plan.
    """

    def __init__(self, plan: Plan, store: SeriesStore, versions: Mapping[str, str]) -> None:
        self._packed = pickled(plan.on_cpu)
        self._path = store.path.absolute()
        self._held: tuple[Plan, SeriesStore, Claims] | None = None
        self._stamp = stamp_of(os.stat(self._path / "zarr.json"))
        self._versions = dict(versions)

    def __getstate__(self) -> dict:
        """Return what is sent."""
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def setup(self, worker: object) -> None:
        """Take the plan as a worker."""
        self._lock = threading.Lock()
        self._name = getattr(worker, "address", "this one")
        self._rank = rank_of(getattr(worker, "name", ""))

    def teardown(self, worker: object) -> None:
        """Let the store and the plan go."""
        if self._held is not None:
            self._held[2].close()
        self._held, self._packed = None, b""

    def solve(self, block: range, wait: bool) -> bool:
        """Solve and write a block; return whether it is complete."""
        with self._lock:
            if self._held is None:
                self._held, self._packed = self._open(), b""
            plan, store, claims = self._held
        bound_threads()
        run_blocks(plan, store, claims, [block], wait, None)
        return store.is_complete(block)

    def _open(self) -> tuple[Plan, SeriesStore, Claims]:
        check_versions(self._name, self._versions, own_versions())
        check_store(self._name, self._path, self._stamp, _stat(self._path / "zarr.json"))
        plan = pickle.loads(self._packed).at_device_of(self._rank)
        return plan, SeriesStore(self._path), Claims(self._path)


def solve_block_of(name: str, start: int, stop: int, wait: bool) -> bool:
    """Solve a block by the plan of a name that this worker holds: the task of a cluster."""
    plan = get_worker().plugins[name]
    assert isinstance(plan, HeldPlan)
    return plan.solve(range(start, stop), wait)


def rank_of(name: object) -> int:
    """Return the number of a worker among those of its machine; 0 where its name is none."""
    return int(str(name)) if re.fullmatch(r"\d+", str(name), re.ASCII) else 0


def bound_threads() -> None:
    """Solve a block on as many threads as NUMBA_NUM_THREADS says, or one: each worker has one."""
    threads = int(os.environ.get("NUMBA_NUM_THREADS", "1"))
    most = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]  # made as it is loaded
    numba.set_num_threads(min(threads, most))


class _Pickler(pickle.Pickler):
    """A pickler that makes paths absolute: workers may run in another folder."""

    def reducer_override(self, value: object) -> tuple[type[Path], tuple[str]]:
        """Return how a path is made again; anything else as usual."""
        if isinstance(value, PurePath):
            return Path, (os.path.abspath(value),)
        return NotImplemented


def pickled(plan: Plan) -> bytes:
    """Return a plan as bytes. Open films are not in it: they are opened where it is used."""
    packed = io.BytesIO()
    _Pickler(packed, pickle.HIGHEST_PROTOCOL).dump(plan)
    return packed.getvalue()


def own_versions() -> dict[str, str]:
    """Return the versions of the packages that decide the bits."""
    return {name: importlib.metadata.version(name) for name in COMPARED_VERSIONS}


def check_versions(worker: str, expected: Mapping[str, str], found: Mapping[str, object]) -> None:
    """Refuse a worker that has other versions than the process that made the plan."""
    for name, version in expected.items():
        if found[name] != version:
            theirs = found[name] if isinstance(found[name], str) else "none"
            raise ValueError(
                f"worker {worker}: {name}: found {theirs}, expected {version} as here: its "
                "volumes may differ in their last bits. Install the same versions everywhere"
            )


def stamp_of(found: os.stat_result) -> tuple[int, int]:
    """Return what is the same of a file on one disk from wherever it is seen: size and time."""
    return found.st_size, int(found.st_mtime)


def check_store(worker: str, path: Path, expected: tuple[int, int], found: object) -> None:
    """Refuse a worker that does not see the store, or sees another one at its place."""
    if not isinstance(found, os.stat_result) or stamp_of(found) != expected:
        what = "another store" if isinstance(found, os.stat_result) else "no such store"
        raise ValueError(
            f"{path}: worker {worker} found {what} there, expected this one: write it on a disk "
            "that all workers share, under the same path"
        )


def _stat(path: Path) -> os.stat_result | OSError:
    try:
        return os.stat(path)
    except OSError as error:
        return error


ONE_THREAD = dict.fromkeys(
    ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"
)
"""The environment of a worker: as many workers as cores to be used."""

AGAIN = 2.0
"""Seconds after which workers that are gone for good are replaced: fewer cost time, more leave
cores idle."""

SETTINGS = {
    "distributed.scheduler.worker-saturation": 1.0,  # no block waits at a worker that may be lost
    "distributed.deploy.lost-worker-timeout": "30s",  # busy machines start one again in so long
    "distributed.nanny.pre-spawn-environ": {},  # which would be this process' own, too
    "distributed.worker.profile.enabled": False,  # it looks at a worker's stack every 10 ms
    "distributed.scheduler.http.routes": [],  # pages, which are not behind TLS
    "distributed.worker.http.routes": [],
}
"""Dask's settings for workers of this machine."""


@contextmanager
def started(workers: int) -> Iterator[Client]:
    """Start so many processes of one thread each; yield what gives them work."""
    _start_quiet_tracker()
    with (
        TemporaryDirectory(prefix="dask-", ignore_cleanup_errors=True) as folder,
        dask.config.set(SETTINGS | {"temporary-directory": folder}),
        _cluster_of(workers) as cluster,
        _kept(cluster, workers),
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


def _cluster_of(workers: int) -> LocalCluster:
    """Start a cluster; Dask gives up where one worker is lost while the first ones start."""
    for _ in range(2):
        with suppress(RuntimeError):
            return LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                memory_limit=0,  # Dask would pause workers whose memory it cannot free
                security=Security.temporary(),
                dashboard_address="127.0.0.1:0",  # any free port
                scheduler_kwargs={"dashboard": False},
                silence_logs=logging.CRITICAL,  # of workers that were lost
                env=ONE_THREAD,
            )
    raise ChildProcessError(
        "workers: found processes that end as they start, twice, expected them to stay. "
        "A script that starts them does so under `if __name__ == '__main__':`"
    )


@contextmanager
def _kept(cluster: LocalCluster, workers: int) -> Iterator[None]:
    """Replace workers: Dask starts a lost one again, but not one lost while it starts."""
    ended = threading.Event()

    def keep() -> None:
        while not ended.wait(AGAIN):
            cluster.scale(workers)

    threading.Thread(target=keep, daemon=True).start()
    try:
        yield
    finally:
        ended.set()


def _start_quiet_tracker() -> None:
    """Start the process that cleans up after others, which would add to what Ctrl-C says."""
    if os.name != "posix":  # there is none
        return
    quiet = "ignore:resource_tracker:UserWarning"
    sys.warnoptions.append(quiet)
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.remove(quiet)
