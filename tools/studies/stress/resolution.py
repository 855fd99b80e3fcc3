"""The details that views are said to measure, against the waves that come back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs import Rig, arc, ring
from rigs.check.coverage import coverage
from rigs.check.resolved_wavelength import half_sphere
from studies.stress.row import Row
from tomo import LinearSystem, VoxelGrid, solvers
from tomo.grid import ActiveVoxels
from tomo.operators.operator import ProjectionOperator

SIDE, QUICK_SIDE = 24, 16  # voxels along a side; the object fills three fifths of it
DIRECTIONS, QUICK_DIRECTIONS = 60, 16

FACTOR = 1.5  # between predicted and measured wavelength
SHARE = 0.8  # least fraction of the directions above two voxels that are within `FACTOR`
STEP = 1.15  # ratio between neighbouring wavelengths that are tried
FINEST = 2.0  # voxels, the shortest wave that they hold


def six_rigs(side: int) -> Mapping[str, Rig]:
    """Return six rigs that look at a cube of ``side`` voxels of width 1."""
    size = 2 * side
    how = {"distance": 16.0 * side, "image_size": (size, size), "footprint": 0.7}
    upper = ring(6, pitch_degrees=20.0, **how)
    lower = ring(6, pitch_degrees=-20.0, start_degrees=30.0, **how)
    low, high, top = (
        ring(count, pitch_degrees=pitch, start_degrees=start, **how)
        for count, pitch, start in ((7, 10.0, 0.0), (5, 45.0, 20.0), (2, 80.0, 10.0))
    )
    return {
        "ring of 5": ring(5, **how),
        "ring of 8": ring(8, **how),
        "ring of 12": ring(12, **how),
        "half ring of 6": arc(6, 150.0, **how),
        "two levels of 6": _joined(upper, lower),
        "dome of 14": _joined(low, high, top),
    }


@dataclass(frozen=True, eq=False)
class WaveScene:
    """A smooth blob whose brightness waves of any length modulate, and its way back."""

    # grid, fine: of the reconstruction, and with voxels half as wide for the images
    grid: VoxelGrid
    fine: VoxelGrid
    blob: NDArray[np.float64]  # (fine voxels,)
    # projector, fine_projector: of the same pixels. Unknowns of the first are the voxels that the
    # blob reaches
    projector: ProjectionOperator
    fine_projector: ProjectionOperator
    rig: Rig

    @classmethod
    def of(cls, rig: Rig, side: int) -> WaveScene:
        """Return the scene that a rig sees in a cube of ``side`` voxels of width 1."""
        grid, fine = VoxelGrid((side,) * 3, 1.0), VoxelGrid((2 * side,) * 3, 0.5)
        radius = np.linalg.norm(fine.centers().reshape(-1, 3), axis=1) / (side / 2)
        blob = np.cos(np.pi / 2 * np.clip((radius - 0.55) / 0.4, 0, 1)) ** 2
        means = _means(blob, side).reshape(grid.shape)
        active = ActiveVoxels.from_mask(grid, means > 0.01)
        system = LinearSystem.from_rig(rig, grid, active=active)
        masks = []
        for camera, pixels in zip(rig, system.pixels, strict=True):
            mask = np.zeros(camera.image_size[::-1], bool)
            mask.ravel()[pixels] = True
            masks.append(mask)
        whole = LinearSystem.from_rig(rig, fine, masks=masks, skip=False)
        return cls(grid, fine, blob, system.projector, whole.projector, rig)

    def predicted(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the wavelength down to which waves along ``(M, 3)`` are measured, ``(M,)``."""
        places = self.fine.centers().reshape(-1, 3)
        covariance = np.cov(places.T, aweights=self.blob, ddof=0)
        bright = places[np.flatnonzero(self.blob > 0.5)[:: self.blob.size // 200]]
        views = coverage(self.rig, bright).views_of(covariance, self.grid.spacing[0])
        return np.median(views.wavelengths(directions), axis=0)

    def returned(self, direction: NDArray[np.float64], wavelength: float) -> float:
        """Return the relative amplitude of a wave that `cgls` gives back: mean of two phases."""
        side = self.grid.shape[0]
        phase = 2 * np.pi / wavelength * (self.fine.centers().reshape(-1, 3) @ direction)
        found = whole = 0.0
        for shift in (0.0, np.pi / 2):
            wave = self.blob * np.cos(phase + shift)
            images = self.fine_projector @ wave.astype(np.float32)
            volume = solvers.cgls(self.projector, images, nonnegative=False).volume.ravel()
            truth = _means(wave, side)
            found += float(volume @ truth)
            whole += float(truth @ truth)
        return found / whole

    def measured(self, direction: NDArray[np.float64]) -> float:
        """Return the wavelength at which half of the amplitude comes back.

        The longest one below which less than half does, between neighbours on a logarithmic scale;
        `FINEST` where more comes back of all.
        """
        longer, before = float(self.grid.shape[0]), 1.0
        wavelength = longer
        while wavelength > FINEST / STEP:
            amplitude = self.returned(direction, wavelength)
            if amplitude < 0.5:
                part = (before - 0.5) / max(before - amplitude, 1e-12)
                return longer * (wavelength / longer) ** min(part, 1.0)
            longer, before = wavelength, amplitude
            wavelength /= STEP
        return FINEST


def resolution_rows(quick: bool) -> Iterator[Row]:
    """Yield a row for each of the six rigs."""
    side, count = (QUICK_SIDE, QUICK_DIRECTIONS) if quick else (SIDE, DIRECTIONS)
    for name, rig in six_rigs(side).items():
        yield wave_row(name, WaveScene.of(rig, side), half_sphere(count))


def wave_row(name: str, scene: WaveScene, directions: NDArray[np.float64]) -> Row:
    """Compare predicted and measured wavelengths along some directions."""
    predicted = np.maximum(scene.predicted(directions), FINEST)
    measured = np.maximum([scene.measured(direction) for direction in directions], FINEST)
    above = (predicted > FINEST) | (measured > FINEST)
    ratio = measured[above] / predicted[above]
    within = float(np.mean((ratio < FACTOR) & (ratio > 1 / FACTOR)))
    line = {"rig": name, "within": within, "measured_over_predicted": float(np.median(ratio))}
    for words, values in (("predicted", predicted), ("measured", measured)):
        for part in (50, 90):
            line[f"{words}_{part}"] = float(np.percentile(values, part))
    stress = f"wavelengths predicted within {FACTOR} of those of which half comes back"
    over = f"{name}, {int(above.sum())} of {len(directions)} directions above {FINEST:g} voxels"
    more = {"note": f"measured over predicted: median {np.median(ratio):.2f}", "at_least": True}
    return Row(stress, over, within, SHARE, "of the directions", **more, lines={"waves": [line]})


def _joined(*parts: Rig) -> Rig:
    """Return the cameras of several rigs as one."""
    cameras = [camera for part in parts for camera in part]
    return Rig(tuple(replace(c, name=f"cam{n:02d}") for n, c in enumerate(cameras)))


def _means(values: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """Return the means over voxels of values on the grid with voxels half as wide."""
    return values.reshape(side, 2, side, 2, side, 2).mean(axis=(1, 3, 5)).ravel()
