"""The equations of a scan: the pixels that take part, and the operator that predicts them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import NDArray

from rigs import Rig, point_in_view
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.measurement import check_sizes
from tomo.operators.absorption import Absorption, attenuating, dimmed
from tomo.operators.assembly import Progress, camera_sources, trace_cameras
from tomo.operators.basis import LinearBasis
from tomo.operators.footprint import footprint_blur
from tomo.operators.lens_blur import lens_blur
from tomo.operators.memory import STORED, choose_form
from tomo.operators.on_the_fly import AttenuatedProjector, OnTheFlyProjector
from tomo.operators.operator import ProjectionOperator
from tomo.operators.stored import Projector
from tomo.trace import Segments, merging, tracing


class VolumeNotSeenError(ValueError):
    """No usable pixel of any camera sees the volume."""


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """The operator of the pixels that take part, and where they lie in the images.

    Attributes
    ----------
    projector : ProjectionOperator
        One row a pixel, grouped by view.
    rig : Rig
        The cameras, one a view.
    pixels : tuple of (P_v,) int64
        For each view the flat pixel numbers ``row * width + column`` of its rows.
    form, reason : str
        Whether the matrix is stored or computed on the fly, and why.
    """

    projector: ProjectionOperator
    rig: Rig
    pixels: tuple[NDArray[np.int64], ...]
    form: str = STORED
    reason: str = ""

    @classmethod
    def from_rig(
        cls,
        rig: Rig,
        grid: VoxelGrid,
        *,
        masks: Sequence[NDArray[np.bool_]] | None = None,
        tracer: str = "march",
        active: ActiveVoxels | None = None,
        skip: bool = True,
        supersample: int = 1,
        aperture_rays: int = 1,
        midpoints: bool = False,
        form: str = "auto",
        needs_matrix: bool = False,
        progress: Progress | None = None,
    ) -> LinearSystem:
        """Trace the usable pixels of every camera of a rig.

        Parameters
        ----------
        masks : sequence of (height, width) bool, optional
            True where a pixel is usable.
        tracer : {"march", "raycast", "reference"}
        active : ActiveVoxels, optional
            The voxels that are unknowns, see `tomo.hull.carve`; all when None.
        skip : bool
            Whether to leave out the pixels whose rays miss the active voxels; on the fly, those
            whose rays miss the grid.
        supersample : int
            Rays along each side of a pixel.
        aperture_rays : int
            Rays of a pixel over the lens' aperture, see `tomo.rays.Rays.from_camera`; 1 is a
            pinhole.
        midpoints : bool
            Whether to keep the midpoint of every segment (WERNet needs them).
        form : {"auto", "stored", "on-the-fly"}
            Whether to store the matrix; ``auto`` stores it where it fits in memory. On the fly
            the tracer is not used.
        needs_matrix : bool
            Whether the method goes through the matrix entries: the form is then ``stored``.

        Raises
        ------
        ValueError
            If the system would not fit in memory, the form or the tracer is unknown, the form
            cannot serve the method, a number of rays is below one, or a camera's optics name no
            aperture where there are rays over it.
        VolumeNotSeenError
            If no usable pixel of any camera sees the grid.
        """
        form, reason = choose_form(
            tuple(rig),
            grid,
            wanted=form,
            needs_matrix=needs_matrix or midpoints,
            supersample=supersample,
            aperture_rays=aperture_rays,
            midpoints=midpoints,
        )
        several = supersample, aperture_rays
        active = ActiveVoxels(grid) if active is None else active
        if masks is None:
            usable = [np.arange(math.prod(camera.image_size)) for camera in rig]
        else:
            usable = [np.flatnonzero(mask) for mask in masks]
        if form == STORED:
            in_storage_order = not active.all  # a table of the voxels is read in any case
            how = {"midpoints": midpoints, "active": active, "in_storage_order": in_storage_order}
            threads = numba.get_num_threads() if tracer == "march" else 1  # raycast has its own
            tracers = [tracing(grid, tracer, **how) for _ in range(threads)]
            if aperture_rays > 1 and not midpoints:
                tracers = [merging(find, active.size) for find in tracers]
            parts, pixels = trace_cameras(rig, grid, usable, tracers, skip, *several, progress)
        else:
            parts, pixels = camera_sources(rig, usable, active, skip, *several, progress)
        if progress:
            progress(len(rig), len(rig), "")
        if form == STORED:
            view_ptr = np.cumsum([0] + [len(kept) for kept in pixels])
            segments = Segments.concatenate(parts)
            parts.clear()
            projector = Projector(
                segments, grid, view_ptr, active, in_storage_order=in_storage_order
            )
        else:
            projector = OnTheFlyProjector(parts, grid, active=active)
        if projector.n_segments == 0:
            raise VolumeNotSeenError(_not_seen(rig, grid))
        return cls(projector, rig, tuple(pixels), form, reason)

    def with_lens_blur(self, diameter: float) -> LinearSystem:
        """Return the same equations for lenses out of focus, see `tomo.operators.lens_blur`.

        ``diameter`` is that of the disc at the grid's centre; ValueError: no number above 0.
        """
        blur = lens_blur(self.rig, self.pixels, self.projector.grid, diameter)
        return replace(self, projector=blur @ self.projector)

    def with_linear_basis(
        self, supersample: int = 1, variances: Sequence[float] | None = None
    ) -> LinearSystem:
        """Return the same equations for emission that is linear between voxel centres.

        ``supersample`` is that of the equations. ``variances`` are those of a further blur of each
        camera's image, in squared pixels. ValueError: the grid's centre is behind a camera, or the
        blur would not fit in memory.
        """
        seen = self.projector.row_sums > 0
        blur = footprint_blur(
            self.rig, self.pixels, seen, self.projector.grid, supersample, variances
        )
        return replace(self, projector=LinearBasis(blur @ self.projector))

    def with_absorption(
        self,
        absorption: Absorption,
        volume: NDArray[np.floating] | None = None,
        *,
        supersample: int = 1,
        aperture_rays: int = 1,
        tracer: str = "march",
    ) -> LinearSystem:
        """Return the same equations for gas that absorbs, in place of any that they have.

        ``volume`` (nx, ny, nz) is the mean emission of every voxel, needed where
        ``absorption.emission`` is not 0; the rest are those that the equations were made with. The
        fractions hold for segments, before any blur of images: they serve both bases.
        """
        grid, active = self.projector.grid, self.projector.active
        emission = None if volume is None else active.compress(volume)
        if self.form != STORED:

            def change(rays: ProjectionOperator) -> ProjectionOperator:
                rays = rays.without_absorption
                return AttenuatedProjector(rays, absorption, emission) if absorption else rays

            return replace(self, projector=self.projector.with_rays(change))
        tracers = [
            attenuating(grid, absorption, emission, tracer=tracer, active=active)
            for _ in range(numba.get_num_threads() if tracer == "march" else 1)
        ]
        if aperture_rays > 1 and self.projector.segments.midpoint is None:  # as in `from_rig`
            tracers = [merging(find, active.size) for find in tracers]
        several = supersample, aperture_rays
        parts, _ = trace_cameras(self.rig, grid, self.pixels, tracers, False, *several, None)
        length = np.concatenate([part.length for part in parts])
        return replace(self, projector=self.projector.with_lengths(length))

    def dimming(
        self,
        absorption: Absorption,
        unknowns: NDArray[np.floating],
        volume: NDArray[np.floating] | None = None,
    ) -> ProjectionOperator:
        """Return the change of the pixels by extinction in every voxel, ``(pixels, voxels)``.

        Of the gas that the equations have, see `with_absorption`; ``unknowns`` is whose light is
        dimmed. The derivative of Beer and Lambert's law along the segments of one ray a pixel: it
        steers steps, and four rays take four times as long. Its entries are stored, and have one
        sign. Gas absorbs in voxels that are not active, too.
        """
        grid, active = self.projector.grid, self.projector.active
        light = active.expand(unknowns).ravel()
        emission = None if volume is None else volume.ravel()
        tracers = [
            dimmed(grid, absorption, light, emission) for _ in range(numba.get_num_threads())
        ]
        parts, _ = trace_cameras(self.rig, grid, self.pixels, tracers, False, 1, 1, None)
        rays = Projector(Segments.concatenate(parts), grid, self.projector.view_ptr)
        return self.projector.with_rays(lambda _: rays)

    @property
    def on_voxel_means(self) -> LinearSystem:
        """The same equations for volumes that hold the mean emission of every voxel."""
        return replace(self, projector=self.projector.on_voxel_means)

    @property
    def blind(self) -> tuple[str, ...]:
        """The cameras of which no usable pixel sees the volume."""
        views = range(self.projector.n_views)
        counts = [self.projector.view(number).n_segments for number in views]
        return tuple(name for name, found in zip(self.rig.names, counts, strict=True) if not found)

    @property
    def unseen(self) -> NDArray[np.bool_]:
        """The active voxels that no ray meets, ``(nx, ny, nz)``."""
        active = self.projector.active
        silent = active.expand(self.projector.column_sums == 0)
        return silent.reshape(active.grid.shape)

    def flatten(self, images: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
        """Return the pixels that take part, view after view: ``(pixels,)``.

        ValueError: it is not one image a camera, each of its camera's size.
        """
        check_sizes("images", images, self.rig)
        return np.concatenate(
            [image.ravel()[kept] for image, kept in zip(images, self.pixels, strict=True)]
        )

    def blocks(self, edge: float) -> NDArray[np.int64]:
        """Return a number for each pixel that takes part: that of its square block, ``(pixels,)``.

        ``edge`` is that of a block, in voxels at the grid's centre; at least a pixel.
        """
        grid = self.projector.grid
        across = edge * max(grid.spacing) / self.rig.footprint(grid.center)  # pixels, (cameras,)
        return self.squares([max(round(one), 1) if np.isfinite(one) else 1 for one in across])

    def squares(self, sides: Sequence[int]) -> NDArray[np.int64]:
        """Return the number of the square that each pixel that takes part lies in, ``(pixels,)``.

        ``sides`` are the pixels along each side of a square, one number a camera. Views count by
        name: the order of the cameras in the rig changes no square's number.
        """
        found, first = [np.zeros(0, np.int64)] * len(self.rig), 0
        for view in sorted(range(len(self.rig)), key=lambda view: self.rig[view].name):
            (width, height), side = self.rig[view].image_size, sides[view]
            rows, columns = np.divmod(self.pixels[view], width)
            across = -(-width // side)
            found[view] = first + rows // side * across + columns // side
            first += across * -(-height // side)
        return np.concatenate(found)

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
