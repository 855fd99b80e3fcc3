"""Workers of a cluster that are processes of this machine, closed to its other users.

Dask's processes run what they are sent, and listen at 127.0.0.1, which all users of the machine
reach. So they take connections by TLS alone, with a key that is made for the run and is not kept
on disk. They import from Dask's folder too: it is one of this run, which others cannot write to.
"""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from tempfile import TemporaryDirectory

import dask
from distributed import Client, LocalCluster, Security

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
