"""The rays of a rig's pixels: traced on several threads, or set up to be projected on the fly."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from rigs.progress import Progress
from tomo._compute.threads import run_chunks
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators.on_the_fly.camera_sources import pixel_source
from tomo.operators.on_the_fly.chunks import RAYS_AT_ONCE, count_crossings
from tomo.operators.on_the_fly.ray_sources import PixelSource
from tomo.rays import Rays
from tomo.rays.pixel_rays import rays_of_pixel
from tomo.trace import Segments


def trace_cameras(
    rig: Rig,
    grid: VoxelGrid,
    usable: Sequence[NDArray[np.int64]],
    tracers: list[Callable[[Rays], Segments]],
    skip: bool,
    supersample: int,
    aperture_rays: int,
    progress: Progress | None,
) -> tuple[list[Segments], list[NDArray[np.int64]]]:
    """Return the segments of the cameras' pixels in active voxels, and each camera's pixels.

    ``usable`` has for each camera the flat numbers of its usable pixels, ``tracers`` one
    tracer a thread (`tomo.trace.tracing`). ``skip`` leaves out pixels whose rays meet no
    active voxel. Rays of a pixel are those of `tomo.rays.Rays.from_camera`.
    """
    at_once = max(RAYS_AT_ONCE // rays_of_pixel(supersample, aperture_rays), 1)
    chunks = [
        (view, first)
        for view, pixels in enumerate(usable)
        for first in range(0, max(len(pixels), 1), at_once)
    ]
    found: dict[tuple[int, int], tuple[Segments, NDArray[np.int64]]] = {}
    free, begun, lock = iter(tracers), itertools.count(), threading.Lock()

    def worker() -> Callable[[tuple[int, int]], None]:
        find = next(free)

        def trace(chunk: tuple[int, int]) -> None:
            view, first = chunk
            if progress and first == 0:
                with lock:
                    number = next(begun)
                    progress(number, len(rig), rig[number].name)
            some = usable[view][first : first + at_once]
            part = find(Rays.from_camera(rig[view], some, supersample, aperture_rays, grid))
            if skip:
                part, seeing = part.without_empty()
                some = some[seeing]
            found[chunk] = part, some

        return trace

    run_chunks(chunks, len(tracers), worker)
    parts: list[Segments] = []
    kept: list[list[NDArray]] = [[] for _ in rig]
    for view, first in chunks:
        part, some = found[view, first]
        parts.append(part)
        kept[view].append(some)
    return parts, [np.concatenate(some) for some in kept]


def camera_sources(
    rig: Rig,
    usable: Sequence[NDArray[np.int64]],
    active: ActiveVoxels,
    skip: bool,
    supersample: int,
    aperture_rays: int,
    progress: Progress | None,
) -> tuple[list[PixelSource], list[NDArray[np.int64]]]:
    """Return the rays of the cameras to project at every product, and each camera's pixels.

    Parameters as of `trace_cameras`; ``skip`` leaves out pixels whose rays miss the grid.
    """
    sources, kept = [], []
    for view, (camera, pixels) in enumerate(zip(rig, usable, strict=True)):
        if progress:
            progress(view, len(rig), camera.name)
        source = pixel_source(camera, pixels, supersample, aperture_rays, active.grid)
        if skip:
            seeing = np.flatnonzero(count_crossings(source, active.grid).meets)
            source, pixels = source.take(seeing), pixels[seeing]
        sources.append(source)
        kept.append(pixels)
    return sources, kept
