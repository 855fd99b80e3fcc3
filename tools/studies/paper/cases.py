"""The paper's cases: a flame, a layout of cameras, and images by the flame's own voxels."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

import phantoms
import rigs
from studies.paper.sizes import Problem
from tomo import LinearSystem, VoxelGrid
from tomo.hull import carve
from tomo.simulation import camera_noise

NOISE = 0.10
"""Standard deviation of the noise over the images' maximum."""

SEED = 0

SHIFTED = "_shifted"
"""At the end of a layout's name: the images' first row is cut off before they are shrunk."""

FINER = "_finer"
"""At the end of a layout's name: the images are shrunk half as much, pixels half as wide."""


LARGER = " x"
"""Before a number at the end of a flame's name: the flame is so many times as large as the box,
which shows its middle: wrinkles and front are wider by as much."""


@dataclass(frozen=True, eq=False)
class Case:
    """Images of a flame whose voxels are known, and the equations made of them.

    Attributes
    ----------
    flame, layout : str
    noise : float
        Fraction of the images' maximum.
    truth : (nx, ny, nz) float32
    system : LinearSystem
        Of the pixels and voxels that carving left, with midpoints.
    measured : (pixels,) float32
    whole : LinearSystem
        Of all pixels and voxels.
    images : list of (height, width) float32
    seconds : float
        That carving and tracing took.
    """

    flame: str
    layout: str
    noise: float
    truth: NDArray[np.float32]
    system: LinearSystem
    measured: NDArray[np.float32]
    whole: LinearSystem
    images: list[NDArray[np.float32]]
    seconds: float

    def described(self) -> dict[str, str | float | int]:
        """Return what tells this case from others, and how large it is."""
        projector = self.system.projector
        return {
            "flame": self.flame,
            "layout": self.layout,
            "views": len(self.system.rig),
            "noise": self.noise,
            "rays": int(np.count_nonzero(np.diff(projector.segments.ptr))),
            "segments": projector.n_segments,
            "live_voxels": projector.active.size,
            "prepare_seconds": self.seconds,
        }


def grid_of(problem: Problem) -> VoxelGrid:
    """Return the voxels of a problem."""
    return VoxelGrid(problem.grid_shape, problem.spacing)


@lru_cache(maxsize=8)
def truth_of(flame: str, problem: Problem) -> NDArray[np.float32]:
    """Return a phantom at the middle of every voxel."""
    grid = grid_of(problem)
    name, _, times = flame.partition(LARGER)
    extent = float(times or 1) * np.asarray(grid.extent)
    field = phantoms.create(name, SEED, extent, grid.center)
    truth = np.asarray(phantoms.sample(field, grid), np.float32)
    truth.flags.writeable = False
    return truth


@lru_cache(maxsize=2)
def case(flame: str, layout: str, problem: Problem, fraction: float = 0.0) -> Case:
    """Return a flame seen by one of the paper's layouts.

    The images are the true voxels' own projection, through chord lengths, as in the paper: what
    is left of an error afterwards is the method's. ``fraction`` adds white noise of that part of
    the images' maximum.
    """
    rig = _rig(layout, problem.shrink)
    grid, truth = grid_of(problem), truth_of(flame, problem)
    whole = LinearSystem.from_rig(rig, grid, form="stored")
    images = whole.images(whole.projector @ truth.reshape(-1))
    if fraction:
        images = camera_noise.gaussian(images, fraction, np.random.default_rng(SEED))
    started = time.perf_counter()
    carving = carve(tuple(rig), images, None, grid)
    system = LinearSystem.from_rig(
        rig, grid, masks=carving.pixels, active=carving.active, midpoints=True, form="stored"
    )
    measured = system.flatten(images)
    seconds = time.perf_counter() - started
    return Case(flame, layout, fraction, truth, system, measured, whole, images, seconds)


def _rig(layout: str, shrink: int) -> rigs.Rig:
    if layout.endswith(FINER):
        return _rig(layout.removesuffix(FINER), shrink // 2)
    rig = rigs.preset(layout.removesuffix(SHIFTED))
    cameras = list(rig)
    if layout.endswith(SHIFTED):
        sizes = [camera.image_size for camera in cameras]
        cameras = [
            camera.cropped(0, 1, width, height - 1)
            for camera, (width, height) in zip(cameras, sizes, strict=True)
        ]
    return replace(rig, cameras=tuple(camera.shrunk(shrink) for camera in cameras))
