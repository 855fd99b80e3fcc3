"""The equations of a scan: which pixels take part, and the projector that predicts them."""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import NDArray

from rigs import Rig, point_in_view
from tomo._compute.threads import share_out
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators.footprint import shadow_spread
from tomo.operators.image_blur import Defocused
from tomo.operators.lens_blur import spread_of
from tomo.operators.linear_basis import Splines
from tomo.operators.memory import STORED, choose_form
from tomo.operators.on_the_fly.counting_pass import survey
from tomo.operators.on_the_fly.projector import OnTheFlyProjector
from tomo.operators.on_the_fly.ray_sources import PixelSource, pixel_source
from tomo.operators.operator import ProjectionOperator
from tomo.operators.stored import Projector
from tomo.rays import Rays
from tomo.trace import Segments, tracing

Progress = Callable[[int, int, str], None]
"""Called as ``progress(done, total, where)``."""

RAYS_AT_ONCE = 16_384  # traced by one thread: they stay near its core, and threads end together


class VolumeNotSeenError(ValueError):
    """No usable pixel of any camera sees the volume."""


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """The projector of the pixels that matter, and how they lie in the images.

    Attributes
    ----------
    projector : Projector, OnTheFlyProjector, Defocused or Splines
        One row a pixel, grouped by view.
    rig : Rig
        The cameras, one a view.
    pixels : tuple of (P_v,) int64
        For each view the flat pixel numbers ``row * width + column`` of its rows.
    form, reason : str
        Whether the projector is stored or computed on the fly, and why.
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
        midpoints: bool = False,
        form: str = "auto",
        needs_matrix: bool = False,
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
        active : ActiveVoxels, optional
            The voxels that are unknowns, see `tomo.hull.carve`; all when None.
        skip : bool
            Whether to leave out the pixels whose rays miss the active voxels; on the fly, the
            grid.
        supersample : int
            Rays along each side of a pixel.
        midpoints : bool
            Whether to keep the middle of every crossing (WERNet needs them).
        form : {"auto", "stored", "on-the-fly"}
            Of the projector; ``auto`` stores the matrix where it fits in memory. On the fly, the
            tracer is not used.
        needs_matrix : bool
            Whether the method goes through the matrix's entries: then only a stored one will do.
        progress : callable, optional

        Raises
        ------
        ValueError
            If the system would not fit in memory, the form or the tracer is unknown, the form
            cannot serve the method, or ``supersample`` is below one.
        VolumeNotSeenError
            If no usable pixel of any camera sees the grid.
        """
        form, reason = choose_form(
            tuple(rig),
            grid,
            wanted=form,
            needs_matrix=needs_matrix or midpoints,
            supersample=supersample,
            midpoints=midpoints,
        )
        active = ActiveVoxels(grid) if active is None else active
        if masks is None:
            usable = [np.arange(math.prod(camera.image_size)) for camera in rig]
        else:
            usable = [np.flatnonzero(mask) for mask in masks]
        if form == STORED:
            by_place = not active.all  # there voxels are looked up in a table in any case
            how = {"midpoints": midpoints, "active": active, "by_place": by_place}
            threads = numba.get_num_threads() if tracer == "march" else 1  # raycast has its own
            tracers = [tracing(grid, tracer, **how) for _ in range(threads)]
            parts, pixels = _traced(rig, usable, tracers, skip, supersample, progress)
        else:
            parts, pixels = _followed(rig, usable, active, skip, supersample, progress)
        if progress:
            progress(len(rig), len(rig), "")
        if form == STORED:
            view_ptr = np.cumsum([0] + [len(kept) for kept in pixels])
            segments = Segments.concatenate(parts)
            parts.clear()
            projector = Projector(segments, grid, view_ptr, active, by_place=by_place)
        else:
            projector = OnTheFlyProjector.from_sources(parts, grid, active)
        if projector.n_segments == 0:
            raise VolumeNotSeenError(_not_seen(rig, grid))
        return cls(projector, rig, tuple(pixels), form, reason)

    def out_of_focus(self, blur: float) -> LinearSystem:
        """Return the same equations for lenses that spread light over discs.

        Parameters
        ----------
        blur : float
            Diameter at the grid's centre, see `tomo.operators.spread_of`.

        Raises
        ------
        ValueError
            If the blur is not a number above 0.
        """
        spread = spread_of(self.rig, self.pixels, self.projector.grid, blur)
        return replace(self, projector=Defocused(self.projector, spread))

    def of_splines(self, supersample: int = 1) -> LinearSystem:
        """Return the same equations for emission that runs straight between voxels' centres.

        Parameters
        ----------
        supersample : int
            Rays along each side of a pixel, as the equations were made with.

        Raises
        ------
        ValueError
            If a camera does not see the grid's centre, or the shares would not fit in memory.
        """
        seeing = self.projector.row_sums > 0
        spread = shadow_spread(self.rig, self.pixels, seeing, self.projector.grid, supersample)
        return replace(self, projector=Splines(self.projector, spread))

    @property
    def of_averages(self) -> LinearSystem:
        """The same equations, of volumes that hold the mean emission in every voxel."""
        return replace(self, projector=self.projector.of_averages)

    @property
    def blind(self) -> tuple[str, ...]:
        """The cameras of which no usable pixel sees the volume."""
        views = range(self.projector.n_views)
        crossings = [self.projector.view(number).n_segments for number in views]
        return tuple(
            name for name, found in zip(self.rig.names, crossings, strict=True) if not found
        )

    @property
    def unseen(self) -> NDArray[np.bool_]:
        """Which voxels no ray crosses though they may emit, of the grid's shape."""
        active = self.projector.active
        silent = active.expand(self.projector.column_sums == 0)
        return silent.reshape(active.grid.shape)

    def flatten(self, images: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
        """Return the pixels that take part, view after view: ``(pixels,)``.

        Raises
        ------
        ValueError
            Unless there is one image a camera, each of its camera's size.
        """
        if len(images) != len(self.rig):
            raise ValueError(
                f"images: found {len(images)}, expected one for each of {len(self.rig)} cameras"
            )
        for camera, image in zip(self.rig, images, strict=True):
            width, height = camera.image_size
            if np.shape(image) != (height, width):
                raise ValueError(
                    f"images: camera {camera.name}: found shape {np.shape(image)}, expected "
                    f"{(height, width)}"
                )
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


def _traced(
    rig: Rig,
    usable: list[NDArray[np.int64]],
    tracers: list[Callable[[Rays], Segments]],
    skip: bool,
    supersample: int,
    progress: Progress | None,
) -> tuple[list[Segments], list[NDArray[np.int64]]]:
    """Return the crossings of the cameras' pixels with active voxels, and each camera's pixels.

    Some rays at a time, by each of the tracers on a thread of its own.
    """
    at_once = max(RAYS_AT_ONCE // max(supersample, 1) ** 2, 1)
    pieces = [
        (view, first)
        for view, pixels in enumerate(usable)
        for first in range(0, max(len(pixels), 1), at_once)
    ]
    found: dict[tuple[int, int], tuple[Segments, NDArray[np.int64]]] = {}
    free, begun, one_at_a_time = iter(tracers), itertools.count(), threading.Lock()

    def worker() -> Callable[[tuple[int, int]], None]:
        find = next(free)

        def trace(piece: tuple[int, int]) -> None:
            view, first = piece
            if progress and first == 0:
                with one_at_a_time:
                    number = next(begun)
                    progress(number, len(rig), rig[number].name)
            some = usable[view][first : first + at_once]
            part = find(Rays.from_camera(rig[view], some, supersample))
            if skip:
                part, seeing = part.without_empty()
                some = some[seeing]
            found[piece] = part, some

        return trace

    share_out(pieces, len(tracers), worker)
    parts, kept = [], [[] for _ in rig]
    for view, first in pieces:
        part, some = found[view, first]
        parts.append(part)
        kept[view].append(some)
    return parts, [np.concatenate(some) for some in kept]


def _followed(
    rig: Rig,
    usable: list[NDArray[np.int64]],
    active: ActiveVoxels,
    skip: bool,
    supersample: int,
    progress: Progress | None,
) -> tuple[list[PixelSource], list[NDArray[np.int64]]]:
    """Return the pixels of the cameras to follow through the grid at every product."""
    sources, kept = [], []
    for view, (camera, pixels) in enumerate(zip(rig, usable, strict=True)):
        if progress:
            progress(view, len(rig), camera.name)
        source = pixel_source(camera, pixels, supersample)
        if skip:
            seeing = np.flatnonzero(survey(source, active.grid).meets)
            source, pixels = source.take(seeing), pixels[seeing]
        sources.append(source)
        kept.append(pixels)
    return sources, kept


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
