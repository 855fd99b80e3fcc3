"""Blocks of a series as tasks of a Dask cluster: processes of this machine, or other machines.

Dask gives out the blocks, and gives those of a lost worker to another one. Workers read their
frames and write their blocks by themselves; only the plan travels, once to each worker.
"""

from __future__ import annotations

import importlib.metadata
import logging
import os
import secrets
from collections.abc import Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, cast

from rigs.files.text import shortened
from tomo.operators.system import Progress
from tomo.series.frames import blocks_of
from tomo.series.plan import Plan
from tomo.series.store import SeriesStore

if TYPE_CHECKING:
    from distributed import Client
    from distributed.deploy import Cluster

    from tomo.series.on_worker import HeldPlan
    from tomo.series.run import Execute

PATIENCE = 10.0
"""Seconds in which a scheduler answers. Fewer: busy networks are taken for dead. More: a wrong
address is said late."""


@contextmanager
def on_cluster(
    workers: int | None = None, scheduler: str | Cluster | None = None
) -> Iterator[Execute]:
    """Yield what solves the missing blocks of a series on a cluster, for `reconstruct_series`.

    Parameters
    ----------
    workers : int, optional
        Processes of one thread each to start on this machine. They end with the run, and take
        nothing from other users of the machine.
    scheduler : str or distributed.deploy.Cluster, optional
        A Dask scheduler, in place of ``workers``: its address, ``tcp://host:8786`` or
        ``tls://host:8786`` with the credentials in Dask's settings; or a cluster object of this
        process, with its credentials.

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
    from tomo.series.on_worker import own_versions, started

    with _connected(scheduler) if scheduler is not None else started(cast(int, workers)) as client:
        versions = own_versions()
        _check_versions(client, versions)
        yield partial(_run, client, versions)


def _import_distributed() -> None:
    try:
        import cryptography  # noqa: F401  keys for TLS
        import distributed  # noqa: F401
    except ImportError as error:
        raise ValueError(
            f"workers: found no {error.name}, expected it for more than one process: "
            "pip install 'flametomo[cluster]'"
        ) from None


def _connected(scheduler: str | Cluster) -> Client:
    """Connect to a scheduler."""
    from distributed import Client

    if isinstance(scheduler, str):
        _check_address(scheduler)
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # a loss is raised
    try:
        return Client(scheduler, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise ValueError(
            f"scheduler: found nothing that answers at {scheduler} within {PATIENCE:g} s, "
            "expected a Dask scheduler like tcp://host:8786, which `dask scheduler` starts "
            f"({type(error).__name__})"
        ) from None


def _check_address(address: str) -> None:
    """Refuse an address that a client could not even try: it would hang for a while after that."""
    from distributed import Security
    from distributed.comm import parse_address, parse_host_port
    from distributed.comm.registry import get_backend

    kind, place = parse_address(address)
    try:
        get_backend(kind)
        host = parse_host_port(place)[0]
        if len(host) > 253:  # no name can be longer
            raise ValueError(f"a host's name of {len(host)} characters")
    except ValueError as error:
        raise ValueError(
            f"scheduler: found {shortened(address)}, expected an address like tcp://host:8786 "
            f"({shortened(str(error))})"
        ) from None
    settings = Security()
    files = settings.get_tls_config_for_role("client")
    if kind == "tls" and not (files["ca_file"] and files["cert"]):
        raise ValueError(
            f"scheduler: found no credentials for {address}, expected ca-file and client.cert in "
            "Dask's settings distributed.comm.tls"
        )
    if kind == "tcp" and settings.require_encryption:
        raise ValueError(
            f"scheduler: found {address}, expected tls://, as Dask's settings require encryption"
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
    found = client.run(function, *arguments, on_error="return") or {}
    return {worker: value for worker, value in found.items() if not _is_loss(value)}


def _is_loss(value: object) -> bool:
    """Return whether a value is Dask's error for a connection that is gone, not the system's."""
    return isinstance(value, OSError) and value.errno is None


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
    held = HeldPlan(plan, store, versions)
    try:
        _hand_out(client, held, name, store)
        for wait in (False, True):  # blocks of another run are waited for, as in one process
            blocks = _run_tasks(client, name, plan, blocks, wait, store, progress)
    finally:
        with suppress(OSError, RuntimeError):  # a scheduler that was lost holds nothing
            client.unregister_worker_plugin(name)


def _hand_out(client: Client, held: HeldPlan, name: str, store: SeriesStore) -> None:
    """Give the plan to every worker, as often as one is lost meanwhile; later ones get it too."""
    while True:
        try:
            client.register_plugin(held, name)
            return
        except OSError as error:
            if not _is_loss(error):
                raise
        with _losses_in_one_line("", store):
            client.nthreads()  # raises where the scheduler is lost


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
    """Say what stays where a block's workers are lost again and again, or the scheduler is."""
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
