"""Write one kind of file in a process that is killed at random, and read what is left.

``python -m _stress.machine_writers KIND FOLDER TIMES SEED`` prints what was wrong as JSON. Each
writer is a fork of this process, which itself starts no threads.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from _stress.machine_commands import partial_files
from _stress.machine_kind import Kind
from _stress.machine_kinds import KINDS


def kill_at_random(kind: Kind, folder: Path, times: int, seed: int) -> dict[str, Any]:
    """Kill so many writers, each over what the one before left; return what came of it.

    Returns
    -------
    dict
        ``faults``, and how many ``left`` a temporary file, were done (``new``), or were
        ``between``: stopped while files were moved, which the folder says.
    """
    from rigs.files import remove_leftovers

    random = np.random.default_rng(seed)
    prepared = _in_fork(kind.prepare)
    code, seconds = _write(kind, prepared, folder, 1, None)
    if code:
        raise SystemExit("the first writer fails")
    good, faults, left, new, between = 1, [], 0, 0, 0
    for version in range(2, times + 2):
        _write(kind, prepared, folder, version, seconds * random.uniform(0.0, 1.0))
        try:
            found = kind.read(folder)
        except Exception as error:  # half a file may raise anything
            faults.append(f"not to be read: {type(error).__name__}: {error}"[:100])
            continue
        if len(found) > 1 or not found <= {good, version} or (not found and not kind.tells):
            faults.append(f"found versions {sorted(found)} for {good} or {version}")
        between += not found and good > 0
        new += version in found
        good = max(found, default=0)
        left += bool(partial_files(folder))
    remove_leftovers(folder)
    code, _ = _write(kind, prepared, folder, times + 2, None)
    if code or kind.read(folder) != {times + 2}:
        faults.append("the next writer fails")
    if partial_files(folder):
        faults.append(f"the next writer leaves {partial_files(folder)[0]}")
    return {"faults": faults, "left": left, "new": new, "between": between}


def _in_fork(make: Callable[[], Any]) -> Any:
    """Return what ``make`` returns in a fork: the threads that it starts stay there."""
    with tempfile.TemporaryFile() as file:
        code = wait(fork(lambda: (pickle.dump(make(), file), file.flush())))
        if code:
            raise SystemExit("what is to be written cannot be made")
        file.seek(0)
        return pickle.load(file)


def _write(
    kind: Kind, prepared: Any, folder: Path, version: int, seconds: float | None
) -> tuple[int, float]:
    """Write in a fork, killed after ``seconds``; return its exit code and how long it wrote."""
    began = time.perf_counter()
    writer = fork(lambda: kind.write(folder, prepared, version))
    if seconds is not None:
        time.sleep(seconds)
        os.kill(writer, signal.SIGKILL)
    return wait(writer), time.perf_counter() - began


def fork(work: Callable[[], object]) -> int:
    """Return the number of a fork that does the work and ends."""
    number = os.fork()
    if number == 0:
        code = 1
        try:
            work()
            code = 0
        except BaseException:  # a fork must not go on as its parent would
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(code)
    return number


def wait(number: int) -> int:
    """Return the exit code of a fork, negative for a signal."""
    return os.waitstatus_to_exitcode(os.waitpid(number, 0)[1])


if __name__ == "__main__":
    result = kill_at_random(
        KINDS[sys.argv[1]](), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    )
    sys.stdout.write(json.dumps(result))
