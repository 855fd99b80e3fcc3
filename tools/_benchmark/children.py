"""Work in fresh interpreters, for what a process can do only once."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_LIMIT = 900.0  # seconds; what takes longer hangs


def in_fresh_process(
    script: str, *arguments: str, environment: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Run a script of this folder; return the JSON object that it prints, and its wall time.

    Parameters
    ----------
    script : str
        A file's name.
    arguments : str
    environment : mapping, optional
        Variables to set beside those of this process.

    Raises
    ------
    RuntimeError
        If it fails; the message ends with what it said last.
    """
    path = Path(__file__).with_name(script)
    started = time.perf_counter()
    done = subprocess.run(
        [sys.executable, str(path), *arguments],
        env={**os.environ, **(environment or {})},
        capture_output=True,
        text=True,
        timeout=_LIMIT,
        check=False,
    )
    wall = time.perf_counter() - started
    if done.returncode:
        words = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise RuntimeError(f"{script} {' '.join(arguments)}: {words[-1]}")
    return {**json.loads(done.stdout or "{}"), "wall_seconds": wall}
