"""What cameras recorded at one moment, and how: the data that a model of the image explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel
from tomo.operators import TRANSPARENT, Absorption, LinearSystem
from tomo.operators.gpu import on_device
from tomo.operators.gpu.device import Device
from tomo.scan.downsample import coarser_grid, coarser_images

Images = tuple[NDArray[np.float32], ...]
Masks = tuple[NDArray[np.bool_], ...]

BRIGHT = 99.8
"""Percentile of an image's pixels that counts as its brightest. Higher, hot pixels decide; lower,
small flames in large images count as dark."""


@dataclass(frozen=True, eq=False)
class Observation:
    """The images of one frame, and the cameras, noise and gas that they are seen through."""

    rig: Rig
    images: Images  # one (height, width) float32 a camera
    masks: Masks  # (height, width) each: True where a pixel is usable
    noise: tuple[NoiseModel, ...]
    grid: VoxelGrid
    absorption: Absorption = TRANSPARENT  # of gas that is known, or was found
    sets_scale: tuple[bool, ...] | None = None
    """Whether gains have the mean 1, of calibrated brightness; all: None."""
    blur: tuple[float, ...] | None = None
    """Variance of each image's blur, in squared pixels; 0: None."""
    supersample: int = 1  # rays along each side of a pixel
    pixel: int = 1  # width of a pixel, in those of the images as recorded
    light: float | None = None  # the brightest of a film that this is a frame of; its own: None
    device: Device | None = None  # where products with its equations are computed; the CPU: None

    @cached_property
    def brightest(self) -> float:
        """The brightest light of all images, in their unit; 0 where all are dark."""
        if self.light is not None:
            return self.light
        found = [
            float(np.percentile(image[mask], BRIGHT)) if mask.any() else 0.0
            for image, mask in zip(self.images, self.masks, strict=True)
        ]
        return max([0.0, *found])

    def placed(self, system: LinearSystem) -> LinearSystem:
        """Return equations where their products are to be computed."""
        if self.device is None:
            return system
        return replace(system, projector=on_device(system.projector, self.device)[0])

    def coarser(self, factor: int, rays: int = 1) -> Observation:
        """Return the observation in pixels and voxels ``factor`` times as wide.

        ``rays`` are those along each side of a pixel.
        """
        if factor == 1:
            return replace(self, supersample=rays)
        images, masks = coarser_images(self.images, self.masks, factor)
        noise = tuple(NoiseModel(one.read / factor, one.gain / factor**2) for one in self.noise)
        return replace(
            self,
            rig=replace(self.rig, cameras=tuple(camera.shrunk(factor) for camera in self.rig)),
            images=tuple(images),
            masks=tuple(masks),
            noise=noise,
            grid=coarser_grid(self.grid, factor),
            supersample=rays,
            pixel=factor * self.pixel,
        )

    def ordered(self, names: Sequence[str]) -> Observation:
        """Return the observation with its views in the order of their names."""
        order = [self.rig.names.index(name) for name in names]
        sure = self.sets_scale
        return replace(
            self,
            rig=replace(self.rig, cameras=tuple(self.rig[n] for n in order)),
            images=tuple(self.images[n] for n in order),
            masks=tuple(self.masks[n] for n in order),
            noise=tuple(self.noise[n] for n in order),
            sets_scale=sure and tuple(sure[n] for n in order),
            blur=self.blur and tuple(self.blur[n] for n in order),
        )

    def without(self, *views: int) -> Observation:
        """Return the observation of which no pixel of some views is used."""
        masks = (
            np.zeros_like(mask) if view in views else mask for view, mask in enumerate(self.masks)
        )
        return replace(self, masks=tuple(masks))

    @property
    def in_sight(self) -> Observation:
        """The observation of the pixels alone whose rays meet the grid."""
        box = VoxelGrid.from_bounds((1, 1, 1), self.grid.lower, self.grid.upper)
        system = LinearSystem.from_rig(self.rig, box, masks=self.masks, form="stored")
        seen = system.images(np.ones(system.projector.shape[0], np.float32))
        return replace(self, masks=tuple(image > 0 for image in seen))

    def in_powers_of_two(self, power: int) -> Observation:
        """Return the observation in units of ``2**power``: single precision holds no extremes."""
        images = tuple(np.ldexp(image, -power) for image in self.images)
        unit = 2.0**power
        noise = tuple(NoiseModel(one.read / unit, one.gain / unit) for one in self.noise)
        gas = replace(self.absorption, emission=self.absorption.emission * unit)
        light = None if self.light is None else self.light / unit
        return replace(self, images=images, noise=noise, absorption=gas, light=light)

    def __repr__(self) -> str:
        """Name the number of views and the grid."""
        return f"<Observation: {len(self.rig)} views, grid {self.grid.shape}>"
