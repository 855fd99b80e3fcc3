"""Commands that write a folder of results, and whether what stands there is of one run."""

from __future__ import annotations

import base64
import json
import math
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from _stress.machine_commands import run, start


@dataclass(frozen=True)
class Results:
    """A command that writes a folder of results.

    Attributes
    ----------
    start : callable
        ``start(folder, number)`` starts run 1 or 2 of the command, which differ.
    mixed : callable
        ``mixed(folder)`` returns what in it is not of the same run as the rest, or ''.
    """

    start: Callable[[Path, int], subprocess.Popen[bytes]]
    mixed: Callable[[Path], str]


def reconstructions(scan: Path) -> Results:
    """Reconstruct a scan with few iterations and with many."""

    def begin(folder: Path, number: int) -> subprocess.Popen[bytes]:
        iterations = {1: 1, 2: 40}[number]
        options = ("--method", "sirt", "--iterations", iterations, "--seed", number)
        return start("reconstruct", scan, *options, "-o", folder)

    return Results(begin, lambda folder: mixed(scan, folder))


def simulations(scan: Path, folder: Path) -> Results:
    """Simulate two phantoms with the cameras of a scan, both once in ``folder`` too."""

    def arguments(number: int) -> list[object]:
        voxels = ("--grid", "6x10x6", "--spacing", 1)
        return ["--rig", scan / "rig.yaml", "--phantom", "blobs", *voxels, "--seed", number, "-o"]

    for number in (1, 2):
        run("simulate", *arguments(number), folder / str(number))
    whole = [files_of(folder / str(number)) for number in (1, 2)]

    def told(found: Path) -> str:
        return "" if files_of(found) in whole else "files of two runs, or half of them"

    return Results(lambda out, number: start("simulate", *arguments(number), out), told)


def files_of(folder: Path) -> dict[str, bytes]:
    """Return what stands in the files of a folder, by their paths in it."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def mixed(scan: Path, out: Path) -> str:
    """Return what in a folder of results is not of the run that its report tells of."""
    from tomo.io import read_volume
    from tomo.metrics import cosine_distance

    if not (out / "report.json").exists():
        return "report.json is missing"
    distance = json.loads((out / "report.json").read_text("utf-8"))["quality"]["cosine_distance"]
    truth = read_volume(scan / "truth.npz")[0]
    page = (out / "report.html").read_text("utf-8")
    for kind in ("npz", "vti", "nrrd"):
        volume = read_volume(out / f"volume.{kind}")[0]
        if not math.isclose(cosine_distance(volume, truth), distance, rel_tol=1e-9):
            return f"volume.{kind} is of another run"
    for picture in out.glob("*.png"):
        # With what ends it: a picture cut short may be the beginning of the whole one.
        if f',{base64.b64encode(picture.read_bytes()).decode()}"' not in page:
            return f"{picture.name} is of another run"
    return ""
