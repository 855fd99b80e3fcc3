"""Commands run as a user runs them, in processes of their own, and what is wrong with the end."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

TOOLS = Path(__file__).resolve().parents[1]
ROOT = TOOLS.parent
LONGEST = 300.0
"""Seconds after which a command is taken for hung."""


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    Attributes
    ----------
    code : int
        Its exit code; negative for a signal.
    lines : tuple of str
        What stands on stderr beside progress bars.
    seconds : float
    """

    code: int
    lines: tuple[str, ...]
    seconds: float

    def fault(self, *codes: int) -> str:
        """Return what is wrong with it where one of the exit ``codes`` was expected, or ''.

        Any but 0 has to say why, in one line.
        """
        if any(line.startswith("Traceback") for line in self.lines):
            return f"traceback: {self.lines[-1][:100]}"
        if self.code not in codes:
            last = f": {self.lines[-1][:100]}" if self.lines else " without a word"
            return f"exit code {self.code}{last}"
        if self.code and len(self.lines) != 1:
            return f"exit code {self.code} with {len(self.lines)} lines"
        return ""


def start(
    tool: str,
    *arguments: object,
    environment: Mapping[str, str] | None = None,
    limits: Mapping[str, int] | None = None,
) -> subprocess.Popen[bytes]:
    """Start ``tools/TOOL.py``; ``limits`` are the system's, like ``{"AS": bytes}``."""
    # Set by a process between: code between fork and exec may hang beside threads. Ctrl-C counts
    # even where the stress test runs in the background, which passes on to ignore it.
    code = "import os, resource, signal, sys\nsignal.signal(signal.SIGINT, signal.SIG_DFL)\n"
    for name, value in (limits or {}).items():
        code += f"resource.setrlimit(resource.RLIMIT_{name}, ({value}, {value}))\n"
    prefix = [sys.executable, "-c", code + "os.execv(sys.argv[1], sys.argv[1:])"]
    command = [*prefix, sys.executable, str(TOOLS / f"{tool}.py"), *map(str, arguments)]
    return subprocess.Popen(
        command,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | dict(environment or {}),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def wait(process: subprocess.Popen[bytes], began: float) -> Ended:
    """Wait for the end; a command that hangs is killed, and none outlives who waits for it."""
    try:
        _, told = process.communicate(timeout=LONGEST)
    except subprocess.TimeoutExpired:
        process.kill()
        _, told = process.communicate()
    except BaseException:
        process.kill()
        raise
    bars = ("reconstruct ", "simulate ", "detect ")
    lines = [line for line in told.decode(errors="replace").splitlines() if line.strip()]
    shown = tuple(line for line in lines if not line.startswith(bars))
    return Ended(process.returncode, shown, time.perf_counter() - began)


def wait_until_heard(process: subprocess.Popen[bytes]) -> None:
    """Wait until a command listens to SIGTERM, which it does before it imports anything.

    What Python needs to start, where the signals are its own to deal with, is over then.
    """
    status = Path(f"/proc/{process.pid}/status")
    if not status.exists():  # not Linux
        time.sleep(0.5)
    while status.exists() and process.poll() is None:
        caught = re.search(r"^SigCgt:\s*(\w+)", status.read_text(), re.MULTILINE)
        if int(caught[1], 16) >> (signal.SIGTERM - 1) & 1:
            return
        time.sleep(0.002)


def run(tool: str, *arguments: object, **options: Any) -> Ended:
    """Run ``tools/TOOL.py`` to its end; see `start`."""
    began = time.perf_counter()
    return wait(start(tool, *arguments, **options), began)


def small_scan(folder: Path) -> Path:
    """Write four small views of a few blobs as a scan; return its folder."""
    from phantoms import create
    from rigs import ring
    from tomo import VoxelGrid
    from tomo.simulation import simulate

    grid = VoxelGrid((6, 10, 6), 1.0)
    rig = ring(4, distance=60.0, image_size=(18, 12), footprint=0.8, pitch_degrees=20)
    field = create("blobs", 1, grid.extent, grid.center)
    return simulate(rig, field, grid).save(folder).parent


def volume_in(folder: Path) -> NDArray[np.float32]:
    """Return the volume that a reconstruction wrote into ``folder``."""
    from tomo.io import read_volume

    return read_volume(folder / "volume.npz", allow_nan=True)[0]


def partial_files(folder: Path) -> list[str]:
    """Return the names of what is half-written in ``folder`` and below."""
    return [path.name for path in folder.rglob(".*") if ".partial-" in path.name]
