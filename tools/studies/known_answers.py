"""What the default makes of known scenes, compared with what it made of them when it was settled.

``python tools/studies/known_answers.py [--data FOLDER] [--update]`` runs twelve small scenes and
three real image sets, and prints a line for each: what was known, what is found, and whether it
is within its tolerance. ``--update`` writes what is found into tests/known_answers.json, so that a
change of the default is seen in the diff.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from rigs.files.text import plain, write_json  # noqa: E402
from studies.benchmark.plume import LOWER, UPPER  # noqa: E402
from studies.common.page import said  # noqa: E402
from studies.common.scans import reconstructed  # noqa: E402
from studies.scenes.findings import findings_of, verdict_of  # noqa: E402
from studies.scenes.recipe import Recipe  # noqa: E402
from studies.scenes.scene import known_scene  # noqa: E402
from tomo import VoxelGrid, load_scan  # noqa: E402
from tomo.pipeline import Reconstruction  # noqa: E402

ANSWERS = ROOT / "tests/known_answers.json"

TOLERANCES = {"nrmse": 0.01, "psnr": 0.005, "rms": 0.01, "baseline": 1e-3}
"""Relative: other processors round otherwise, and a choice between near equals may turn. Half a
per cent of 30 dB is 0.15 dB. Other figures are to be equal; `BITS` are only shown."""

BITS = "bits"

Answer = dict[str, Any]


def of_scene(recipe: Mapping[str, Any]) -> Answer:
    """Return the error, the verdict, the faults named, and the bits of a known scene."""
    outcome = reconstructed(known_scene(Recipe(**recipe)).scan)
    report = outcome.report()
    return {
        "nrmse": report["quality"]["nrmse"],
        "verdict": verdict_of(report),
        "named": sorted(f"{one.effect} {one.camera or 'all'}" for one in findings_of(report)),
        BITS: _bits(outcome),
    }


def of_plume(folder: Path, frame: str) -> Answer:
    """Return how well four cameras of a plume predict the fifth, at a coarse size."""
    scan, grid = (
        load_scan(folder / "transforms.json"),
        VoxelGrid.from_bounds((32, 48, 32), LOWER, UPPER),
    )
    how: dict[str, Any] = {"frame": frame, "hold_out": ["cam02"], "peak": 1.0}
    outcome = reconstructed(scan.scaled(12), grid, **how)
    return {"psnr": outcome.report()["held_out"]["cam02"]["psnr"], BITS: _bits(outcome)}


def of_chessboards(folder: Path) -> Answer:
    """Return the RMS error of a stereo calibration, in pixels, and the baseline, in squares."""
    from rigs.calibrate import calibrate
    from rigs.calibrate.detect import image_set, observe
    from rigs.calibrate.targets import parse_target

    found = calibrate(observe(image_set(folder), parse_target("chessboard:9x6:1")))
    left, right = (camera.position for camera in found.rig)
    return {
        "rms": float((found.residuals[found.used] ** 2).sum(axis=1).mean() ** 0.5),
        "baseline": float(((left - right) ** 2).sum() ** 0.5),
    }


REAL: Mapping[str, Callable[[Path], Answer]] = {
    "scalarflow": lambda data: of_plume(data / "scalarflow", "90"),
    "scalarflow_late": lambda data: of_plume(data / "scalarflow_late", "110"),
    "chessboard_stereo": lambda data: of_chessboards(data / "chessboard_stereo"),
}


def differences(known: Mapping[str, Any], found: Mapping[str, Any]) -> list[str]:
    """Return a line for each figure that is not within its tolerance."""
    lines = []
    for key, value in known.items():
        if key in TOLERANCES:
            same = abs(found[key] - value) <= TOLERANCES[key] * abs(value)
        else:
            same = key == BITS or found[key] == value
        if not same:
            lines.append(f"{key}: found {found[key]}, expected {value}")
    return lines


def read_answers() -> dict[str, Any]:
    """Return what is known: ``scenes``, each with its recipe and answer, and ``real`` sets."""
    return json.loads(ANSWERS.read_text("utf-8"))


def main() -> int:
    """Compare, or update; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, help="The folder of real image sets.")
    parser.add_argument("--update", action="store_true", help="Write what is found.")
    asked, known = parser.parse_args(), read_answers()
    same = True
    for name, entry in known["scenes"].items():
        found = plain(of_scene(entry["recipe"]), digits=5)
        same &= _is_as_known(name, entry["answer"], found)
        entry["answer"] = found
    for name, run in REAL.items() if asked.data else ():
        if not (asked.data / name).is_dir():
            said(f"{name}: left out: {asked.data / name} is no folder")
            continue
        found = plain(run(asked.data), digits=5)
        same &= _is_as_known(name, known["real"].get(name, {}), found)
        known["real"][name] = found
    if asked.update:
        write_json(ANSWERS, known, indent=1)
    return int(not (same or asked.update))


def _is_as_known(name: str, known: Mapping[str, Any], found: Mapping[str, Any]) -> bool:
    """Say what differs; return whether nothing does."""
    lines = differences(known, found)
    bits = ", same bits" if BITS in found and found[BITS] == known.get(BITS) else ""
    said(f"{name}: {'; '.join(lines) or 'as known'}{bits}")
    return not lines


def _bits(outcome: Reconstruction) -> str:
    return hashlib.sha256(outcome.volume.tobytes()).hexdigest()[:12]


if __name__ == "__main__":
    sys.exit(main())
