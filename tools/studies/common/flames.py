"""Flames seen by the paper's cameras: what solvers and skipping are judged on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

import rigs
from studies.common.scans import OfScan, simulated_by
from tomo import VoxelGrid
from tomo.simulation import camera_noise as noises
from tomo.simulation.simulate import SimulatedImages


@dataclass(frozen=True)
class FlameSize:
    """How finely a flame is seen and reconstructed."""

    # grid_shape, spacing: voxels of the paper's box of 15 x 70 x 15 mm
    grid_shape: tuple[int, int, int]
    spacing: float
    # by how much the presets' images are shrunk; 2 makes a pixel as wide as a 0.5 mm voxel
    shrink: int
    # refine, supersample: voxels finer than the grid and rays along a pixel's side when images are
    # simulated
    refine: int = 2
    supersample: int = 3


RIGS = {33: "paper33_pitch", 11: "paper11_33deg"}
"""The preset for each number of views; 11 cover the same 363 degrees."""

NOISES = ("clean", "gaussian", "poisson")
FRACTION = 0.10
PHOTONS = 1000.0


@dataclass(frozen=True, eq=False)
class Scene(OfScan):
    """Images of a flame that is known."""

    flame: str
    views: int
    noise: str
    seed: int
    scan: SimulatedImages

    @property
    def named(self) -> dict[str, str | int]:
        """What tells it from others, for a row of a table."""
        return {"flame": self.flame, "views": self.views, "noise": self.noise, "seed": self.seed}


def flame_rig(views: int, shrink: int) -> rigs.Rig:
    """Return the paper's cameras with images shrunk ``shrink``-fold."""
    rig = rigs.preset(RIGS[views])
    return replace(rig, cameras=tuple(camera.scaled(1 / shrink) for camera in rig))


def scene(flame: str, views: int, noise: str, seed: int, size: FlameSize) -> Scene:
    """Return the images of one flame without inverse crime.

    They are taken with several rays a pixel through voxels finer than the grid's; ``gaussian`` is
    white noise of a tenth of the brightest pixel in every pixel, ``poisson`` counts 1000 photons
    in the brightest. ``seed`` is that of the flame and of the noise.
    """
    clean, rig = _clean_images(flame, seed, size), flame_rig(views, size.shrink)
    names = [_name(views, camera) for camera in rig.names]
    images = with_noise([clean.images[name] for name in names], noise, seed)
    taken = replace(clean, rig=rig, images=dict(zip(rig.names, images, strict=True)))
    return Scene(flame, views, noise, seed, taken)


def with_noise(
    images: list[NDArray[np.float32]],
    noise: str,
    seed: int | tuple[int, ...],
    fraction: float = FRACTION,
) -> list[NDArray[np.float32]]:
    """Return images with one of `NOISES`; ``fraction`` is white noise's of the brightest pixel."""
    random = np.random.default_rng(seed)
    if noise == "gaussian":
        return noises.gaussian(images, fraction, random)
    return noises.poisson(images, PHOTONS, 0.0, random) if noise == "poisson" else images


@lru_cache(maxsize=2)
def _clean_images(flame: str, seed: int, size: FlameSize) -> SimulatedImages:
    """Simulate all layouts at once: most of the time goes into sampling the flame."""
    cameras = tuple(
        replace(camera, name=_name(views, camera.name))
        for views in RIGS
        for camera in flame_rig(views, size.shrink)
    )
    rig = replace(flame_rig(33, size.shrink), cameras=cameras)
    grid, how = VoxelGrid(size.grid_shape, size.spacing), {"supersample": size.supersample}
    return simulated_by(rig, grid, (flame, seed), refine=size.refine, **how)


def _name(views: int, camera: str) -> str:
    return f"{views}_{camera}"
