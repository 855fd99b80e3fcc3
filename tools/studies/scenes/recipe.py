"""Recipes: everything that determines a scene, and the families of either half."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, replace

from studies.scenes.exposure import NOISES
from studies.scenes.faults import KNOWN, SIZES
from studies.scenes.fields import FAMILIES, REPORT, SETTLE, SPECIAL_REPORT, SPECIAL_SETTLE
from tomo import VoxelGrid

VERSION = 2  # the version of scenes; another one makes all of them anew

HALVES = {
    "settle": (*SETTLE, *SPECIAL_SETTLE),
    "report": (*REPORT, *SPECIAL_REPORT),
    "fresh": (*REPORT, *SPECIAL_REPORT),
}
"""The families of each half: rules are settled on one, and figures come from another. The third
has other members of the second's families; it is run once, when all rules stand."""

SEEDS = {"settle": 0, "report": 1000, "fresh": 5000}
"""The first seed of each half; those from 5000 on are fresh, and nothing else is."""

GRIDS = ((24, 32, 24), (28, 36, 28), (32, 40, 32))
LARGE, FIRST_LARGE = (36, 48, 36), 900
"""The grid of seeds so far above a whole thousand, or further; others have one of `GRIDS`."""

CENTER = (1.3, -0.7, 0.4)


@dataclass(frozen=True)
class Recipe:
    """Everything that determines a scene; what is not of its half is refused."""

    half: str  # one of `HALVES`
    family: str  # of the half's fields
    rig: str  # see `studies.scenes.cameras.rig`
    noise: str  # one of `NOISES`
    seed: int  # of field, grid, rig, noise and fault
    fault: str = ""  # one of `studies.scenes.faults.KNOWN`; none when empty
    size: int = 0  # 0, 1 or 2: which of the fault's sizes

    def __post_init__(self) -> None:
        """Check every field."""
        known = {"half": HALVES, "family": HALVES.get(self.half, FAMILIES), "noise": NOISES}
        for name, values in (known | {"fault": ("", *KNOWN), "size": range(SIZES)}).items():
            if getattr(self, name) not in values:
                found, words = getattr(self, name), ", ".join(map(str, values))
                raise ValueError(f"{name}: found {found!r}, expected one of {words}")
        if (self.seed >= SEEDS["fresh"]) != (self.half == "fresh"):
            raise ValueError(
                f"seed: found {self.seed} of half {self.half}, expected "
                f"{SEEDS['fresh']} or more for fresh, less for the others"
            )

    @property
    def name(self) -> str:
        """As a table has it."""
        what = f", {self.fault} {self.size + 1}" if self.fault else ""
        fresh = "fresh " if self.half == "fresh" else ""
        return f"{fresh}{self.family}, {self.rig}, {self.noise}, seed {self.seed}{what}"

    @property
    def key(self) -> str:
        """The hash that the scene is stored under."""
        text = json.dumps(asdict(self) | {"version": VERSION}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def views(self) -> int:
        """The number of cameras."""
        return int(self.rig.rpartition("-")[2])

    @property
    def view(self) -> int:
        """The number of the camera at fault, for faults of one camera."""
        return (2 * self.seed + (self.half != "settle")) % self.views

    @property
    def faultless(self) -> Recipe:
        """The same scene without its fault."""
        return replace(self, fault="", size=0)

    @property
    def grid(self) -> VoxelGrid:
        """The voxels to reconstruct, of edge length one."""
        large = self.seed % 1000 >= FIRST_LARGE
        return VoxelGrid(LARGE if large else GRIDS[self.seed % len(GRIDS)], 1.0, CENTER)
