"""Blocks of a series as tasks of a Dask cluster: processes of this machine, or other machines.

Dask gives out the blocks, gives those of a lost worker to another one, and starts workers of this
machine again. Workers read their frames and write their blocks by themselves; only the plan
travels, once to each worker.
"""

from __future__ import annotations

import importlib.metadata
import logging
import os
import re
import secrets
import sys
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING

from rigs.files.text import shortened
from tomo.operators.system import Progress
from tomo.series.frames import blocks_of
from tomo.series.plan import Plan
from tomo.series.store import SeriesStore

if TYPE_CHECKING:
    from distributed import Client

    from tomo.series.run import Execute

PATIENCE = 10.0
"""Seconds in which a scheduler answers. Fewer: busy networks are taken for dead. More: a wrong
address is said late."""

_ADDRESS = re.compile(
    r"(?:[a-z]{2,9}://)?(?:[\w.-]{1,253}|\[[\da-fA-F:.%\w]{2,60}\]):(\d{1,5})", re.ASCII
)

ONE_THREAD = dict.fromkeys(
    ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"
)
"""The environment of a worker of this machine: as many workers as cores to be used."""

AGAIN = 2.0
"""Seconds after which workers of this machine that are gone for good are replaced: fewer cost
time, more leave cores idle."""

SETTINGS = {
    "distributed.scheduler.worker-saturation": 1.0,  # no block waits at a worker that may be lost
    "distributed.deploy.lost-worker-timeout": "30s",  # busy machines start one again in so long
    "distributed.nanny.pre-spawn-environ": {},  # which would be this process' own, too
    "distributed.worker.profile.enabled": False,  # it looks at a worker's stack every 10 ms
}
"""Dask's settings for workers of this machine."""


@contextmanager
def on_cluster(workers: int | None = None, scheduler: str | None = None) -> Iterator[Execute]:
    """Yield what solves the missing blocks of a series on a cluster, for `reconstruct_series`.

    Parameters
    ----------
    workers : int, optional
        Processes of one thread each to start on this machine. They end with the run.
    scheduler : str, optional
        The address of a Dask scheduler, ``tcp://host:8786``, in place of ``workers``.

    Raises
    ------
    ValueError
        If neither or both are given, Dask is not installed, the scheduler cannot be reached, or a
        worker has other versions than this process.

    Examples
    --------
    In a script, workers import it as they start::

        if __name__ == "__main__":
            reconstruct_series(scan, "out.zarr", cluster=on_cluster(workers=8))
    """
    if (workers is None) == (scheduler is None):
        found = "neither" if workers is None else "both"
        raise ValueError(f"workers: found {found} of workers and scheduler, expected one of them")
    if workers is not None and workers < 1:
        raise ValueError(f"workers: found {workers}, expected at least 1")
    _import_distributed()
    from tomo.series.on_worker import own_versions

    with ExitStack() as stack:
        if workers is not None:
            client = _local(stack, workers)
        else:
            assert scheduler is not None
            client = _connected(scheduler)
        stack.enter_context(client)
        versions = own_versions()
        _check_versions(client, versions)
        yield partial(_run, client, versions)


def _import_distributed() -> None:
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise ValueError(
            "workers: found no Dask, expected it for more than one process: "
            "pip install 'flametomo[cluster]'"
        ) from None


def _local(stack: ExitStack, workers: int) -> Client:
    """Start workers on this machine."""
    import dask
    from distributed import Client, LocalCluster

    stack.enter_context(dask.config.set(SETTINGS))
    _start_quiet_tracker()
    cluster = stack.enter_context(
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=0,  # Dask would pause workers whose memory it cannot free
            dashboard_address="127.0.0.1:0",  # any free port
            silence_logs=logging.CRITICAL,  # of workers that were lost
            env=ONE_THREAD,
        )
    )
    ended = threading.Event()
    stack.callback(ended.set)

    def keep() -> None:
        """Replace workers: Dask starts a lost one again, but not one lost while it starts."""
        while not ended.wait(AGAIN):
            cluster.scale(workers)

    threading.Thread(target=keep, daemon=True).start()
    return Client(cluster, set_as_default=False)


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


def _connected(address: str) -> Client:
    """Connect to a scheduler."""
    from distributed import Client

    _check_address(address)
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # a loss is raised
    try:
        return Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise ValueError(
            f"scheduler: found nothing that answers at {address} within {PATIENCE:g} s, expected "
            f"a Dask scheduler like tcp://host:8786, which `dask scheduler` starts "
            f"({type(error).__name__})"
        ) from None


def _check_address(address: str) -> None:
    """Raise where an address cannot be one: Dask would look for it, or warn at the end."""
    found = _ADDRESS.fullmatch(address)
    if found is None or not 0 < int(found[1]) < 2**16:
        raise ValueError(
            f"scheduler: found {shortened(address)}, expected the address of a Dask scheduler, "
            "like tcp://host:8786"
        )


def _check_versions(client: Client, expected: Mapping[str, str]) -> None:
    """Refuse workers with other versions, before anything is computed."""
    from tomo.series.on_worker import check_versions

    found: dict[str, dict[str, object]] = {}
    for name in expected:  # a function that workers without this package have too
        for worker, version in _everywhere(client, importlib.metadata.version, name).items():
            found.setdefault(worker, {})[name] = version
    for worker, versions in found.items():
        if versions.keys() == expected.keys():  # it was there all the time
            check_versions(worker, expected, versions)


def _everywhere(client: Client, function: object, *arguments: object) -> dict[str, object]:
    """Return what a function gives, or raises, on each worker; not of workers lost meanwhile."""
    from distributed.comm import CommClosedError

    found = client.run(function, *arguments, on_error="return") or {}
    lost = CommClosedError, TimeoutError
    return {worker: value for worker, value in found.items() if not isinstance(value, lost)}


def _run(
    client: Client,
    versions: Mapping[str, str],
    plan: Plan,
    store: SeriesStore,
    progress: Progress | None = None,
) -> None:
    """Solve and write every block that is not complete; see `tomo.series.run.run_plan`."""
    from tomo.series.on_worker import HeldPlan, check_store, stamp_of

    record = store.path.absolute() / "zarr.json"
    expected = stamp_of(os.stat(record))
    for worker, found in _everywhere(client, os.stat, str(record)).items():
        check_store(worker, store.path, expected, found)
    name = f"flametomo-{secrets.token_hex(4)}"
    blocks = [one for one in blocks_of(len(plan.places)) if not store.is_complete(one)]
    client.register_plugin(HeldPlan(plan, store, versions), name)
    try:
        for wait in (False, True):  # blocks of another run are waited for, as in one process
            blocks = _run_tasks(client, name, plan, blocks, wait, store, progress)
    finally:
        with suppress(OSError, RuntimeError):  # a scheduler that was lost holds nothing
            client.unregister_worker_plugin(name)


def _run_tasks(
    client: Client,
    name: str,
    plan: Plan,
    blocks: list[range],
    wait: bool,
    store: SeriesStore,
    progress: Progress | None,
) -> list[range]:
    """Have blocks solved; return those that another run has in hand."""
    from distributed import as_completed

    from tomo.series.on_worker import solve_block_of

    tasks = {
        client.submit(solve_block_of, name, one.start, one.stop, wait, pure=False): one
        for one in blocks
    }
    left, done = [], store.n_frames - sum(map(len, blocks))
    if progress:
        progress(done, store.n_frames, "")
    try:
        for task in as_completed(list(tasks), loop=client.loop):
            block = tasks[task]
            ends = [plan.scan.frames[plan.places[one]].name for one in (block[0], block[-1])]
            frames = f"frames {' to '.join(ends)}"
            with _losses_in_one_line(frames, store):
                complete = task.result()
            task.release()
            if not complete:
                left.append(block)
                continue
            done += len(block)
            if progress:
                progress(done, store.n_frames, frames)
    finally:
        for task in tasks:  # those that did not begin, where one failed
            task.release()
    return left


@contextmanager
def _losses_in_one_line(frames: str, store: SeriesStore) -> Iterator[None]:
    """Say of a block whose workers were lost again and again, and of a lost scheduler, what stays.

    Raises
    ------
    ChildProcessError, ConnectionError
        One line that says what was lost and what stays.
    """
    from distributed.comm import CommClosedError
    from distributed.scheduler import KilledWorker

    ending = f"{store.done()}: the same command goes on"
    try:
        yield
    except KilledWorker as error:
        raise ChildProcessError(
            f"{store.path}: {frames}: found {error.allowed_failures + 1} workers lost while they "
            "solved them, expected one to finish: there may be too little memory for so many. "
            f"{ending}"
        ) from None
    except (CommClosedError, CancelledError):
        raise ConnectionError(
            f"{store.path}: found the scheduler lost, expected it to stay. {ending}"
        ) from None
