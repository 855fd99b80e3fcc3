"""A process that fuzzes readers: a line of JSON in is a reader, lines of JSON out its report."""

from __future__ import annotations

import json
import logging
import os
import random
import resource
import sys
import tempfile
import time
import warnings
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random

from _stress.fuzzing_guard import Guard
from _stress.fuzzing_mutations import mutated
from _stress.fuzzing_reader import Reader
from _stress.fuzzing_readers import reader_of

_ROOM = 4 << 30  # bytes of address space beyond what the process has: bombs stop there
_KEPT, _LONG = 2000, 1 << 14  # inputs that reached new statements, and bytes of those not kept


@dataclass
class Report:
    """What fuzzing a reader has given so far.

    Attributes
    ----------
    reader : str
    inputs, statements : int
        Run, and of the project reached.
    slowest : float
        Seconds.
    memory : int
        The most, in bytes beyond four times the file.
    faults : mapping
        What must not be, and how often it was.
    done : bool
    """

    reader: str
    inputs: int = 0
    statements: int = 0
    slowest: float = 0.0
    memory: int = 0
    faults: dict[str, int] = field(default_factory=dict)
    done: bool = False

    def say(self) -> None:
        """Write it as a line."""
        sys.stdout.write(json.dumps(asdict(self)) + "\n")
        sys.stdout.flush()


def fuzz(
    reader: Reader, inputs: int, seed: int, guard: Guard, folder: Path, keep: Path | None
) -> Report:
    """Run a reader on its seeds and on what mutations make of them."""
    rng, report = Random(f"{seed} {reader.name}"), Report(reader.name)
    folder.mkdir()
    for name, content in reader.beside.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    path = folder / reader.file
    path.parent.mkdir(parents=True, exist_ok=True)
    for name in reader.links:
        path.with_name(name).symlink_to(path.name)
    said = time.monotonic()
    corpus = list(reader.seeds)

    def run(data: bytes) -> bool:
        path.write_bytes(data)
        watched = guard.watch(reader.read, path, len(data))
        report.slowest = max(report.slowest, watched.seconds)
        report.memory = max(report.memory, watched.memory)
        report.inputs += 1
        if watched.fault:
            what = watched.fault.replace(str(folder), "")
            report.faults[what] = report.faults.get(what, 0) + 1
            if keep is not None and report.faults[what] == 1:
                name = f"{reader.name.replace(' ', '_')}-{len(report.faults)}"
                (keep / f"{name}-{path.name}").write_bytes(data)
                (keep / f"{name}.txt").write_text(what)
        return watched.new_statements > 0

    for data in reader.seeds:  # what they import is not what they do
        path.write_bytes(data)
        guard.warm(reader.read, path)
    guard.coverage.forget()
    for data in reader.seeds:
        run(data)
    while report.inputs < inputs:
        recent = corpus[len(reader.seeds) :][-50:]
        parent = rng.choice(recent if recent and rng.random() < 0.3 else corpus)
        data = mutated(parent, rng, corpus, reader.mutations)
        if run(data) and len(corpus) < _KEPT and len(data) < _LONG:
            corpus.append(data)
        if time.monotonic() - said > 1:
            report.statements, said = guard.coverage.statements, time.monotonic()
            report.say()
    report.statements = guard.coverage.statements
    return report


def main() -> None:
    """Fuzz what standard input asks for."""
    warnings.simplefilter("ignore")
    logging.disable()
    import cv2

    cv2.setNumThreads(0)
    keep = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    guard = Guard()
    guard.coverage.install()
    shared = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="fuzzing-", dir=shared) as scratch:
        os.chdir(scratch)
        for number, line in enumerate(sys.stdin):
            job = json.loads(line)
            reader = reader_of(job["reader"], Path(scratch) / "seeds")
            _bound_memory()
            random.seed(0)
            folder = Path(scratch) / f"inputs{number}"
            report = fuzz(reader, job["inputs"], job["seed"], guard, folder, keep)
            report.done = True
            report.say()


def _bound_memory() -> None:
    """Let what asks for far too much memory get none, instead of all that the machine has."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + _ROOM
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))


if __name__ == "__main__":
    main()
