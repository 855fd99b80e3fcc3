"""The equations of a scan: which pixels take part, and the projector that predicts them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.projector import Projector
from tomo.rays import Rays
from tomo.segments import Segments
from tomo.support import check_memory, point_in_view
from tomo.trace import trace

Progress = Callable[[int, int, str], None]
"""Called as ``progress(done, total, where)``."""

RAYS_AT_ONCE = 1_000_000  # bounds the rays' own memory to some 100 MB


class VolumeNotSeenError(ValueError):
    """No usable pixel of any camera sees the volume."""


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """The projector of the pixels that matter, and how they lie in the images.

    Attributes
    ----------
    projector : Projector
        One row a pixel, grouped by view.
    rig : Rig
        The cameras, one a view.
    pixels : tuple of (P_v,) int64
        For each view the flat pixel numbers ``row * width + column`` of its rows.
    """

    projector: Projector
    rig: Rig
    pixels: tuple[NDArray[np.int64], ...]

    @classmethod
    def from_rig(
        cls,
        rig: Rig,
        grid: VoxelGrid,
        *,
        masks: Sequence[NDArray[np.bool_]] | None = None,
        tracer: str = "march",
        skip: bool = True,
        supersample: int = 1,
        midpoints: bool = False,
        progress: Progress | None = None,
    ) -> LinearSystem:
        """Trace the usable pixels of every camera of a rig.

        Parameters
        ----------
        rig : Rig
        grid : VoxelGrid
        masks : sequence of (height, width) bool, optional
            True where a pixel is usable.
        tracer : {"march", "raycast", "reference"}
        skip : bool
            Whether to leave out the pixels whose rays miss the grid.
        supersample : int
            Rays along each side of a pixel.
        midpoints : bool
            Whether to keep the middle of every crossing (WERNet needs them).
        progress : callable, optional

        Raises
        ------
        ValueError
            If the matrix would not fit in memory.
        VolumeNotSeenError
            If no usable pixel of any camera sees the grid.
        """
        check_memory(tuple(rig), grid, supersample=supersample, midpoints=midpoints)
        parts, pixels = [], []
        for number, camera in enumerate(rig):
            if progress:
                progress(number, len(rig), camera.name)
            usable = np.arange(math.prod(camera.image_size))
            if masks is not None:
                usable = np.flatnonzero(masks[number])
            chunks = []
            for first in range(0, max(len(usable), 1), at_once := RAYS_AT_ONCE // supersample**2):
                rays = Rays.from_camera(camera, usable[first : first + at_once], supersample)
                chunks.append(trace(rays, grid, tracer, midpoints=midpoints))
            segments = Segments.concatenate(chunks)
            if skip:
                segments, kept = segments.without_empty()
                usable = usable[kept]
            parts.append(segments)
            pixels.append(usable)
        if progress:
            progress(len(rig), len(rig), "")
        if sum(len(part) for part in parts) == 0:
            raise VolumeNotSeenError(_not_seen(rig, grid))
        view_ptr = np.cumsum([0] + [part.n_pixels for part in parts])
        projector = Projector(Segments.concatenate(parts), grid, view_ptr)
        return cls(projector, rig, tuple(pixels))

    @property
    def blind(self) -> tuple[str, ...]:
        """The cameras of which no usable pixel sees the volume."""
        crossings = np.diff(self.projector.segments.ptr[self.projector.view_ptr])
        return tuple(
            name for name, found in zip(self.rig.names, crossings, strict=True) if not found
        )

    def flatten(self, images: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
        """Return the pixels that take part, view after view: ``(pixels,)``."""
        return np.concatenate(
            [image.ravel()[kept] for image, kept in zip(images, self.pixels, strict=True)]
        )

    def images(self, flat: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        """Return ``(height, width)`` images of a flat vector; zero where no row is."""
        images = []
        for number, (camera, kept) in enumerate(zip(self.rig, self.pixels, strict=True)):
            width, height = camera.image_size
            image = np.zeros(width * height, np.float32)
            start, stop = self.projector.view_ptr[number : number + 2]
            image[kept] = flat[start:stop]
            images.append(image.reshape(height, width))
        return images


def _not_seen(rig: Rig, grid: VoxelGrid) -> str:
    cameras = ", ".join(rig.names) if len(rig) <= 3 else f"the {len(rig)} cameras"
    message = (
        f"grid from {_point(grid.lower)} to {_point(grid.upper)} {rig.length_unit}: no usable "
        f"pixel of {cameras} sees it, expected a box in view"
    )
    aim = point_in_view(rig)
    return (
        message
        if aim is None
        else f"{message}: the middles of the images meet near " + _point(aim)
    )


def _point(coordinates: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{c:.4g}" for c in coordinates) + ")"
