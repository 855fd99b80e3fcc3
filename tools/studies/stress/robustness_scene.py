"""A flame before the 33 cameras of a preset, shrunk, and what may go wrong with its images."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rigs
from rigs import Rig
from studies.common.scans import OfScan, reconstructed, simulated_by
from tomo import VoxelGrid
from tomo.pipeline import Reconstruction
from tomo.simulation.effects import Effects
from tomo.simulation.simulate import SimulatedImages

PRESET = "paper33_pitch"
FLAMES = ("jet", "turbulent")
WRONG, OTHER = 7, 15  # views that something happens to
ALIKE = ("another moment", "mirrored", "another camera's image")
"""What shows hardly another image of a jet, which is nearly the same from all sides."""

ANOTHER_MOMENT = 100  # added to the seed

Images = list[NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class Scene(OfScan):
    """Images of a known flame."""

    flame: str
    scan: SimulatedImages

    @property
    def brightest(self) -> float:
        """The brightest pixel of all."""
        return max(float(image.max()) for image in self.images)

    def reconstructed(self, images: Images, **how: Any) -> Reconstruction:
        """Return what the default method makes of other images of the same cameras."""
        named = MappingProxyType(dict(zip(self.rig.names, images, strict=True)))
        return reconstructed(replace(self.scan, images=named), uncertainty=0, **how)


@lru_cache(maxsize=16)
def scene(flame: str, seed: int, shrink: float, effects: Effects | None = None) -> Scene:
    """Return a flame before the preset's cameras, voxels and pixels ``1 / shrink`` as large."""
    rig = rigs.preset(PRESET)
    volume = rig.volume
    shape = [max(round(n * shrink), 1) for n in volume.shape]
    half = np.multiply(volume.shape, volume.spacing) / 2
    center = np.asarray(volume.center)
    grid = VoxelGrid.from_bounds(shape, center - half, center + half)
    rig = replace(rig, cameras=tuple(camera.scaled(shrink) for camera in rig))
    made = simulated_by(rig, grid, (flame, seed), effects=effects, seed=seed)
    return Scene(flame, made)


def with_bad_pixels(images: Images, fraction: float, seed: int) -> Images:
    """Return images with a fraction of bad pixels: dead, saturated, and anything up to 4 times."""
    random = np.random.default_rng(seed)
    brightest = max(float(image.max()) for image in images)
    found = []
    for image in images:
        hit = random.random(image.shape) < fraction
        kinds = [np.zeros(image.shape), np.full(image.shape, brightest)]
        kinds.append(brightest * random.uniform(0, 4, image.shape))
        strange = np.choose(random.integers(0, 3, image.shape), kinds)
        found.append(np.where(hit, strange, image).astype(np.float32))
    return found


def one_bad_pixel(images: Images) -> Images:
    """Return images one pixel of which is a thousand times as bright as the flame."""
    found = [image.copy() for image in images]
    height, width = found[WRONG].shape
    found[WRONG][height // 2, width // 2] = 1e3 * max(float(image.max()) for image in images)
    return found


def wrong_views(one: Scene, seed: int, shrink: float) -> Iterator[tuple[str, Images, bool]]:
    """Return what a view may show instead, the images, and whether it can be seen to be wrong."""
    own = one.images[WRONG]
    other = FLAMES[1 - FLAMES.index(one.flame)]
    random = np.random.default_rng(seed)
    shown: Mapping[str, NDArray] = {
        "another flame": scene(other, seed, shrink).images[WRONG],
        "another moment": scene(one.flame, seed + ANOTHER_MOMENT, shrink).images[WRONG],
        "black": np.zeros_like(own),
        "constant": np.full_like(own, one.brightest),
        "noise": one.brightest * random.random(own.shape),
        "mirrored": own[:, ::-1],
        "upside down": own[::-1],
        "turned by 180 degrees": own[::-1, ::-1],
        "another camera's image": one.images[OTHER],
    }
    for name, image in shown.items():
        images = list(one.images)
        images[WRONG] = np.ascontiguousarray(image, np.float32)
        yield name, images, one.flame != "jet" or name not in ALIKE


def swapped(images: Images) -> Images:
    """Return images of which two are with each other's camera."""
    found = list(images)
    found[WRONG], found[OTHER] = images[OTHER], images[WRONG]
    return found


def shifted(rig: Rig, pixels: float, seed: int) -> Rig:
    """Return a rig that is wrong about where each camera looks, by up to so many pixels."""
    random = np.random.default_rng(seed)
    moved = (camera.shifted(*random.uniform(-pixels, pixels, 2)) for camera in rig)
    return replace(rig, cameras=tuple(moved))
