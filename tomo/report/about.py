"""Where a report comes from: the scan, the command, the program, the method in words."""

from __future__ import annotations

import shlex
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import tomo
from tomo.solvers.methods import METHODS, NONE


@dataclass(frozen=True)
class About:
    """What only the writer of an outcome knows: its folder, what was typed, files beside the page.

    ``command`` is empty from Python.
    """

    folder: Path
    command: str = ""
    files: Sequence[str] = ()

    @property
    def view_command(self) -> str:
        """The command that opens the viewer."""
        return f"flametomo view {shlex.quote(str(self.folder))}"


def origin_rows(report: Mapping, about: About | None) -> list[tuple[str, str]]:
    """Return where the volume comes from, as rows of a table."""
    scan, rows = report.get("scan") or {}, []
    if scan.get("source"):
        frame = f", {scan['frame']}" if scan.get("frame") else ""
        rows.append(("scan", f"{scan['source']}{frame}"))
    if report.get("solver") or report.get("method"):
        rows.append(("method", method_in_words(report)))
    if about:
        rows.append(("made", f"{datetime.now():%d %B %Y, %H:%M}"))
        rows.append(("by", about.command or "Python"))
    version = (report.get("versions") or {}).get("flametomo")
    if version:
        found = commit()
        rows.append(("flametomo", f"{version}, commit {found}" if found else str(version)))
    return rows


def method_in_words(report: Mapping) -> str:
    """Return what was minimised and how far, and who chose that.

    >>> method_in_words({"method": "nnls", "solver": {"method": "nnls", "iterations": 20}})
    'Weighted least squares (nnls), 20 iterations.'
    """
    solver = report.get("solver") or {}
    name = solver.get("method") or report["method"]
    method = METHODS.get(name)
    words = f"{method.loss[:1].upper()}{method.loss[1:]} ({name})" if method else str(name)
    parts = [words]
    if method and method.prior != NONE and solver.get("strength"):
        parts.append(f"prior on {method.prior} of strength {solver['strength']:.2g}")
    if solver.get("nonnegative"):
        parts.append("no value below zero")
    if solver.get("smooth_width"):
        parts.append(f"started smooth over {solver['smooth_width']:g} voxels")
    if solver.get("iterations"):
        parts.append(f"{solver['iterations']} iterations")
    if (report.get("basis") or {}).get("name") == "linear":
        parts.append("emission linear between voxel centres")
    sentence = ", ".join(parts) + "."
    tried = len(solver.get("tried") or ())
    if solver.get("chosen_by") == "auto" and tried:
        sentence += f" Chosen from {tried} settings: it predicts left-out pixels best."
    return sentence


def commit() -> str:
    """Return the commit of a checkout that runs; empty where the program is installed."""
    root = Path(tomo.__file__).parents[1]
    if not (root / ".git").exists():
        return ""
    asked = ("git", "describe", "--always", "--dirty", "--exclude=*")
    try:
        found = subprocess.run(asked, cwd=root, capture_output=True, text=True, timeout=5)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return found.stdout.strip()
