"""Simulated scans, and the way back: as a user would, or to the equations of a solver."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import phantoms
from rigs import CameraLike, Rig, box_points
from rigs.geometry.rotation import matrix_of_vector
from tomo import LinearSystem, Scan, VoxelGrid
from tomo.hull import carve
from tomo.pipeline import Options, Reconstruction, reconstruct
from tomo.simulation import simulate_images
from tomo.simulation.simulate import SimulatedImages


@dataclass(frozen=True, eq=False)
class Problem:
    """The equations of a set of images."""

    system: LinearSystem
    measured: NDArray[np.float32]  # (pixels,)
    seconds: float  # from images in memory to here: finding what is dark, tracing, indexing


def problem(
    rig: Rig,
    grid: VoxelGrid,
    images: Sequence[NDArray[np.float32]],
    *,
    skip: bool,
    form: str = "stored",
    midpoints: bool = False,
) -> Problem:
    """Return the equations of all pixels and voxels, or of those that matter (``skip``)."""
    started = time.perf_counter()
    how: dict[str, Any] = {"form": form, "midpoints": midpoints}
    if skip:
        carving = carve(tuple(rig), images, None, grid)
        how |= {"masks": carving.pixels, "active": carving.active}
    system = LinearSystem.from_rig(rig, grid, skip=skip, **how)
    measured = system.flatten(images)
    return Problem(system, measured, time.perf_counter() - started)


def simulated_by(rig: Rig, grid: VoxelGrid, flame: tuple[str, int], **how: Any) -> SimulatedImages:
    """Return what a rig sees of a flame: by 2 x 2 rays a pixel through voxels half as wide."""
    field = phantoms.create(*flame, grid.extent, grid.center)
    return simulate_images(rig, field, grid, **{"supersample": 2, "refine": 2} | how)


def reconstructed(
    scan: SimulatedImages | Scan, grid: VoxelGrid | None = None, **how: Any
) -> Reconstruction:
    """Return the reconstruction of a scan; a simulated one stays in memory."""
    found = scan if isinstance(scan, Scan) else scan.scan
    return reconstruct(found, grid, Options(**how))


def seconds_of(outcome: Reconstruction) -> float:
    """Return the seconds from images in memory to the volume, without what is judged after."""
    others = sum(outcome.seconds[key] for key in ("load", "compare", "evaluate", "uncertainty"))
    return outcome.seconds["total"] - others


def disturbed(rig: Rig, grid: VoxelGrid, seed: int, pixels: float, but: str | None = None) -> Rig:
    """Return the rig with every camera but one moved and turned at random.

    Each of three shifts and three turns moves a camera's image by a normal random number of
    pixels with the standard deviation ``pixels``.
    """
    random = np.random.default_rng(seed)
    cameras = []
    for camera in rig:
        stays = camera.name == but
        cameras.append(
            camera if stays else displaced(camera, grid, random.normal(size=6) * pixels)
        )
    return replace(rig, cameras=tuple(cameras))


def displaced(camera: CameraLike, grid: VoxelGrid, pixels: NDArray[np.float64]) -> CameraLike:
    """Return a camera shifted along, and turned about, its axes right, down and forward.

    ``pixels`` ``(6,)`` say by how much each of the three shifts, then of the three turns, moves
    its image: that of a length at the middle of the grid, for a roll that of the grid's points.
    """
    focal = float(np.sqrt(camera.camera_matrix[0, 0] * camera.camera_matrix[1, 1]))
    depth = abs(float(camera.R[2] @ np.asarray(grid.center) + camera.t[2]))
    corners = camera.project(box_points(grid.lower, grid.upper, 2))[0]
    spread = np.square(corners - corners.mean(axis=0)).sum() / 3 / len(corners)  # over the box
    turn = pixels[3:] / (focal, focal, np.sqrt(spread))
    R = matrix_of_vector(turn) @ camera.R
    position = camera.position + camera.R.T @ (pixels[:3] * depth / focal)
    return camera.with_pose(camera.camera_matrix, R, -R @ position)


class OfScan:
    """What a scene's ``scan`` holds, by shorter names."""

    scan: SimulatedImages

    @property
    def rig(self) -> Rig:
        """The cameras, as a reconstruction knows them."""
        return self.scan.rig

    @property
    def grid(self) -> VoxelGrid:
        """The voxels to reconstruct."""
        return self.scan.grid

    @property
    def truth(self) -> NDArray[np.float32]:
        """The flame's means over the voxels."""
        return self.scan.truth

    @property
    def images(self) -> list[NDArray[np.float32]]:
        """One a camera, in the rig's order."""
        return [self.scan.images[name] for name in self.scan.rig.names]
