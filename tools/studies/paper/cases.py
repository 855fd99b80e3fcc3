"""The paper's cases: a flame, a layout of cameras, and images by the flame's own voxels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

import phantoms
import rigs
from tomo import LinearSystem, VoxelGrid
from tomo.hull import carve
from tomo.simulation import camera_noise

NOISE = 0.10  # standard deviation of the noise over the images' maximum
SEED = 0  # seed of flames and noise
FINE = 2 / 3
"""Width of a pixel in voxels, in the middle of the grid. The text has 96 steps of 3200 rays in an
epoch, 307,200 rays of 33 views: 9,309 a view, with which a pixel of a box of 30 x 140 voxels is
0.67 voxels wide."""


@dataclass(frozen=True)
class Layout:
    """Cameras on a circle, all looking at the middle of the flame from 5.5 to 6.5 m."""

    views: int = 33
    step: float = 11.0  # degrees from a view to the next
    pitched: bool = True  # views are 15 degrees above and below the level of the middle in turns
    # distances are drawn evenly from 5500 to 6500 mm; all are 5800 mm otherwise
    random: bool = True
    pixel: float = FINE  # width of a pixel in voxels
    # by how many rows the images' middle is off the middle of the flame. A quarter keeps rows of
    # `FINE` pixels of level cameras off the faces between voxel layers
    row: float = 0.25


LAYOUTS = {
    "case 1, level": Layout(pitched=False, random=False),
    "case 2, pitched": Layout(random=False),
    "case 3, pitched, random distances": Layout(),
    "11 views of 11 degrees": Layout(11),
    "11 views of 22 degrees": Layout(11, 22.0),
    "11 views of 33 degrees": Layout(11, 33.0),
    "case 1, rows on faces": Layout(pitched=False, random=False, pixel=1.0, row=0.5),
}
"""In the last one every image row falls on a face between two voxel layers, in all views alike."""

CASE_3 = "case 3, pitched, random distances"


@dataclass(frozen=True, eq=False)
class Case:
    """Images of a flame whose voxels are known, and the equations made of them."""

    truth: NDArray[np.float32]  # (nx, ny, nz)
    system: LinearSystem  # of the pixels and voxels that carving left, with midpoints
    measured: NDArray[np.float32]  # (pixels,)
    whole: LinearSystem  # of all pixels and voxels
    images: list[NDArray[np.float32]]  # (height, width)

    def described(self) -> dict[str, int]:
        """Return how large the case is."""
        projector = self.system.projector
        return {
            "rays": int(np.count_nonzero(np.diff(projector.segments.ptr))),
            "segments": projector.n_segments,
            "live_voxels": projector.active.size,
        }


@lru_cache(maxsize=8)
def truth_of(flame: str, grid: VoxelGrid) -> NDArray[np.float32]:
    """Return a phantom at the middle of every voxel."""
    field = phantoms.create(flame, SEED, grid.extent, grid.center)
    truth = np.asarray(phantoms.sample(field, grid), np.float32)
    truth.flags.writeable = False
    return truth


@lru_cache(maxsize=2)
def case(flame: str, layout: str, grid: VoxelGrid, noise: float = 0.0) -> Case:
    """Return a flame seen by one of the paper's layouts.

    The images are the true voxels' own projection, through segment lengths, as in the paper: an
    error that is left afterwards is the method's. ``noise`` adds white noise of that part of the
    images' maximum.
    """
    rig, truth = rig_of(LAYOUTS[layout], grid), truth_of(flame, grid)
    whole = LinearSystem.from_rig(rig, grid, form="stored")
    images = whole.images(whole.projector @ truth.reshape(-1))
    if noise:
        images = camera_noise.gaussian(images, noise, np.random.default_rng(SEED))
    carving = carve(tuple(rig), images, None, grid)
    system = LinearSystem.from_rig(
        rig, grid, masks=carving.pixels, active=carving.active, midpoints=True, form="stored"
    )
    return Case(truth, system, system.flatten(images), whole, images)


def rig_of(layout: Layout, grid: VoxelGrid) -> rigs.Rig:
    """Return the cameras of a layout; every image holds the whole grid."""
    views, distance = layout.views, 5800.0
    distances = np.full(views, distance)
    if layout.random:
        distances = np.random.default_rng(2024).uniform(5500.0, 6500.0, 33)[:views]
    pitch = np.where(np.arange(views) % 2 == 0, 15.0, -15.0) * layout.pitched
    lens = {
        "focal_length": distance,
        "pixel_pitch": layout.pixel * float(np.mean(grid.spacing)),
        "pitch_degrees": pitch,
    }
    box = rigs.Volume(grid.shape, float(np.mean(grid.spacing)))
    reach = np.zeros(2)  # pixels from the middle to the farthest corner
    for camera in rigs.ring(views, layout.step, distances, image_size=(2, 2), **lens):
        corners, _, _ = camera.project(box.corners())
        reach = np.maximum(reach, np.abs(corners - 0.5).max(axis=0))
    width, height = (2 * (int(size) + 2) for size in reach)
    rig = rigs.ring(views, layout.step, distances, image_size=(width, height), **lens)
    shift = np.array([[0.0, 0, 0], [0, 0, layout.row], [0, 0, 0]])
    moved = (replace(one, camera_matrix=one.camera_matrix + shift) for one in rig)
    return replace(rig, cameras=tuple(moved))
