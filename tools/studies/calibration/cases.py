"""The sets of pictures that the study calibrates from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rigs import Rig
from rigs.calibrate.targets import parse_target
from studies.calibration.rendering import Board
from studies.calibration.scenes import COMPLETE, Poses, arc_rig, held, photograph, ring_rig

TARGET = "charuco:9x7:18:13.5:DICT_4X4_50"
"""In mm; 48 inner corners on 162 x 126 mm, seen in images of 256 x 205 mm."""

TEXELS = 12.0
"""Texels of the print in a millimetre: squares and markers' cells are whole numbers of them."""


@dataclass(frozen=True)
class Case:
    """A kind of rig and of poses.

    Attributes
    ----------
    name, words : str
        A word for files, and what it is.
    layout : str
        ``arc`` or ``ring``.
    poses : Poses
    complete : bool
        Whether only images that show the whole target are used.
    cameras : int
    """

    name: str
    words: str
    layout: str
    poses: Poses
    complete: bool
    cameras: int

    def rig(self, seed: int) -> Rig:
        """Return the true rig, which is another for each seed."""
        make = arc_rig if self.layout == "arc" else ring_rig
        return make(seed, self.cameras)


CASES = (
    Case("arc", "5 cameras over 120 degrees, partial boards", "arc", Poses(30), False, 5),
    Case("ring", "12 cameras all round, partial boards", "ring", Poses(36, 180.0), False, 12),
    Case(
        "arc_complete", "5 cameras over 120 degrees, complete boards", "arc",
        replace(COMPLETE, count=30), True, 5,
    ),
    Case(
        "ring_complete", "12 cameras all round, complete boards", "ring",
        replace(COMPLETE, count=36, facing=180.0), True, 12,
    ),
)  # fmt: skip

TINY = (
    Case(
        "arc_complete", "3 cameras over 60 degrees, complete boards", "arc",
        replace(COMPLETE, count=6), True, 3,
    ),
)  # fmt: skip
"""One small case: whether the study runs at all."""


def pictures(case: Case, seed: int, folder: Path, workers: int = 2) -> dict[str, dict[str, Path]]:
    """Render the images of a case into a folder, ``images[camera][frame]``.

    ``seed`` is that of rig, poses and noise.
    """
    target = parse_target(TARGET)
    return photograph(
        folder / f"{case.name}_{seed}",
        case.rig(seed),
        Board.of(target, TEXELS),
        held(case.poses, target.points.mean(axis=0), np.random.default_rng([seed, 3])),
        seed=seed,
        workers=workers,
    )
