"""Predicted against measured resolution: plane waves on a smooth blob, seen by six rigs.

A wave is measured down to the length at which half of its amplitude comes back by `cgls` from
clean images, which a projector of voxels half as wide makes. The prediction is that of check-rig.
Counted are directions along which one of the two is above two voxels.
"""

from __future__ import annotations

import numpy as np

from rigs.check.resolved_wavelength import half_sphere
from studies.common.study import Progress, Tables
from studies.scenes import cameras
from studies.scenes.recipe import SEEDS
from studies.scenes.trial import Trials
from studies.stress.resolution import WaveScene, wavelengths, within_factor
from tomo import VoxelGrid

RIGS = ("ring-5", "ring-8", "dome-6", "two-level-12", "half-ring-12", "unlike-8")

SIDE, QUICK_SIDE = 24, 16
"""Voxels along a side of the cube that holds the blob."""

DIRECTIONS, QUICK_DIRECTIONS = 16, 4

SMALL_IMAGES = 3
"""Added to the first seed of a half: selects images of 64 x 80 pixels."""

COLUMNS = {
    "overall": "rigs directions above within lowest",
    "rigs": "rig directions above within ratio predicted_half predicted_most measured_half "
    "measured_most",
    "directions": "",
}


def resolution(_trials: Trials, half: str, *, quick: bool, progress: Progress) -> Tables:
    """Return a row for all rigs, one a rig, and one a direction, which the page leaves out."""
    side, count = (QUICK_SIDE, QUICK_DIRECTIONS) if quick else (SIDE, DIRECTIONS)
    grid, directions = VoxelGrid((side,) * 3, 1.0), half_sphere(count)
    rows, single, ratios = [], [], []
    for number, name in enumerate(RIGS):
        progress(number, len(RIGS), name)
        scene = WaveScene.of(cameras.rig(name, grid, SEEDS[half] + SMALL_IMAGES), side)
        predicted, measured, above = wavelengths(scene, directions)
        ratio = measured[above] / predicted[above]
        ratios.append(ratio)
        rows.append(
            {
                "rig": name,
                "directions": count,
                "above": int(above.sum()),
                "within": within_factor(ratio),
                "ratio": float(np.median(ratio)),
                "predicted_half": float(np.median(predicted)),
                "predicted_most": float(np.quantile(predicted, 0.9)),
                "measured_half": float(np.median(measured)),
                "measured_most": float(np.quantile(measured, 0.9)),
            }
        )
        single += [
            {"rig": name, "direction": n.tolist(), "predicted": p, "measured": m}
            for n, p, m in zip(directions, predicted, measured, strict=True)
        ]
    overall = {
        "rigs": len(RIGS),
        "directions": count * len(RIGS),
        "above": sum(map(len, ratios)),
        "within": within_factor(np.concatenate(ratios)),
        "lowest": min(row["within"] for row in rows),
    }
    return {"overall": [overall], "rigs": rows, "directions": single}
