"""Flames seen by the paper's cameras: what solvers and skipping are judged on."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import phantoms
import rigs
from _benchmark.sizes import Sizes
from tomo import Scan, VoxelGrid
from tomo.simulation import camera_noise as noises
from tomo.simulation import simulate
from tomo.simulation.simulate import SimulatedScan

RIGS = {33: "paper33_pitch", 11: "paper11_33deg"}
"""The preset for each number of views; 11 cover the same 363 degrees."""

NOISES = ("clean", "gaussian", "poisson")
FRACTION = 0.10
PHOTONS = 1000.0


@dataclass(frozen=True, eq=False)
class Scene:
    """Images of a flame that is known.

    Attributes
    ----------
    flame, noise : str
    views, seed : int
    scan : SimulatedScan
    """

    flame: str
    views: int
    noise: str
    seed: int
    scan: SimulatedScan

    @property
    def images(self) -> list[NDArray[np.float32]]:
        """One a camera, in the rig's order."""
        return list(self.scan.images.values())

    def saved(self, folder: Path) -> Scan:
        """Return the scan as `tomo.pipeline.reconstruct` takes it, written into ``folder``."""
        return Scan.load(self.scan.save(folder / f"{self.flame}_{self.views}_{self.noise}"))


def flame_rig(views: int, shrink: int) -> rigs.Rig:
    """Return the paper's cameras with images shrunk ``shrink``-fold."""
    rig = rigs.preset(RIGS[views])
    return replace(rig, cameras=tuple(camera.scaled(1 / shrink) for camera in rig))


def scene(
    flame: str, views: int, noise: str, seed: int, sizes: Sizes, shrink: int | None = None
) -> Scene:
    """Return the images of one flame without inverse crime.

    They are taken with several rays a pixel through voxels finer than the grid's; ``gaussian`` is
    white noise of a tenth of the brightest pixel in every pixel, ``poisson`` counts 1000 photons
    in the brightest. ``seed`` is that of the flame and of the noise.
    """
    shrink = sizes.shrink if shrink is None else shrink
    clean = _clean_images(flame, seed, sizes, shrink, tuple(RIGS))
    names = [_name(views, camera) for camera in flame_rig(views, shrink).names]
    images = _with_noise([clean.images[name] for name in names], noise, seed)
    rig = flame_rig(views, shrink)
    taken = replace(clean, rig=rig, images=dict(zip(rig.names, images, strict=True)))
    return Scene(flame, views, noise, seed, taken)


def _with_noise(
    images: list[NDArray[np.float32]], noise: str, seed: int
) -> list[NDArray[np.float32]]:
    random = np.random.default_rng(seed)
    if noise == "gaussian":
        return noises.gaussian(images, FRACTION, random)
    if noise == "poisson":
        return noises.poisson(images, PHOTONS, 0.0, random)
    return images


@lru_cache(maxsize=2)
def _clean_images(
    flame: str, seed: int, sizes: Sizes, shrink: int, layouts: Iterable[int]
) -> SimulatedScan:
    """Simulate all layouts at once: most of the time goes into sampling the flame."""
    cameras = tuple(
        replace(camera, name=_name(views, camera.name))
        for views in layouts
        for camera in flame_rig(views, shrink)
    )
    rig = replace(flame_rig(33, shrink), cameras=cameras)
    grid = VoxelGrid(sizes.grid_shape, sizes.spacing)
    field = phantoms.create(flame, seed, grid.extent, grid.center)
    return simulate(rig, field, grid, refine=sizes.refine, supersample=sizes.supersample)


def _name(views: int, camera: str) -> str:
    return f"{views}_{camera}"
