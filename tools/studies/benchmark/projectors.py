"""Rays a second, on the fly and stored, against plain rivals; medians of runs taken in turn.

Rays that meet the grid, pixels half a voxel wide. A ratio is that of rates, against the row named
at the same size and number of threads; the stored matrix and the tracer use all threads, scipy
and itk-rtk one. The bandwidth is that of reading a large array in the same run.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from rigs import Rig, ring
from studies.benchmark.sizes import SIZES
from studies.common.study import Request, Tables
from studies.common.timing import in_turn
from tomo import LinearSystem, Projector, Rays, VoxelGrid
from tomo.rays.ray_box import BoxCrossing, enter_box
from tomo.trace import trace

Row = dict[str, Any]

EDGE = 100.0  # of the volume, in mm
DISTANCE = 1000.0
LARGE = (64, 1_000_000)  # 256 MB: beyond every cache; many more rows than threads
STEP_DEGREES = 7.3  # no two views alike, none along an axis but the first


def rig_for(voxels: int, views: int) -> Rig:
    """Return a level ring without distortion, pixels half a voxel wide, that sees a cube."""
    pixels = 3 * voxels
    return ring(
        views, STEP_DEGREES, DISTANCE, image_size=(pixels, pixels), footprint=1.5 * EDGE / pixels
    )


def run(request: Request) -> Tables:
    """Return a row a projector or the tracer, size and number of threads."""
    sizes = SIZES[request.size]
    rows: list[Row] = []
    for voxels, views in request.each(sizes.rates, "{0[0]} voxels along an edge".format):
        rows += _on_the_fly(voxels, views, sizes.repeats)
        rows += _joseph(voxels, views, sizes.repeats, rows)
    return {"projectors": rows + _stored(*sizes.stored, sizes.repeats)}


def _on_the_fly(voxels: int, views: int, repeats: int) -> list[Row]:
    rig, grid = rig_for(voxels, views), VoxelGrid((voxels,) * 3, EDGE / voxels)
    system = LinearSystem.from_rig(rig, grid, form="on-the-fly")
    flying = system.projector
    seen = zip(rig, system.pixels, strict=True)  # the walk, too, is given just these rays
    box = enter_box(Rays.concatenate(Rays.from_camera(c, pixels) for c, pixels in seen), grid)
    size = {
        "voxels": voxels, "views": views, "rays": flying.shape[0], "crossings": flying.n_segments,
    }  # fmt: skip
    volume = np.random.default_rng(0).random(grid.size, np.float32)
    images = np.random.default_rng(1).random(flying.shape[0], np.float32)
    threads = numba.get_num_threads()
    rows: list[Row] = []
    try:
        for count in sorted({1, min(2, threads)}):
            numba.set_num_threads(count)
            seconds = in_turn(
                {
                    "plain walk forward": lambda: project(box, grid, volume),
                    "on the fly forward": lambda: flying @ volume,
                    "on the fly adjoint": lambda: flying.T @ images,
                },
                repeats,
            )
            to = (None, "plain walk forward", "on the fly forward")
            for (what, taken), other in zip(seconds.items(), to, strict=True):
                ratio = seconds[other] / taken if other else None
                rows.append(_row(what, count, taken, size, ratio, other))
    finally:
        numba.set_num_threads(threads)
    return rows


def _row(
    what: str, threads: int, seconds: float, size: Row, ratio: float | None, ratio_to: str | None
) -> Row:
    return {
        "what": what, **size, "threads": threads, "seconds": seconds,
        "rays_per_second": size["rays"] / seconds,
        "crossings_per_second": size["crossings"] / seconds,
        "ratio": ratio, "ratio_to": ratio_to,
    }  # fmt: skip


def _joseph(voxels: int, views: int, repeats: int, rows: list[Row]) -> list[Row]:
    """Measure itk-rtk's Joseph projectors on the same rig, one thread; nothing without it."""
    try:
        import itk
        from itk import RTK as rtk  # noqa: N811
    except ImportError:
        return []
    itk.MultiThreaderBase.SetGlobalMaximumNumberOfThreads(1)
    kind = itk.Image[itk.F, 3]
    geometry = rtk.ThreeDCircularProjectionGeometry.New()
    for view in range(views):
        geometry.AddProjection(DISTANCE, 2 * DISTANCE, STEP_DEGREES * view)  # behind the volume
    pixels = 3 * voxels

    def image(values: np.ndarray, pitch: tuple[float, float, float]) -> Any:
        made = itk.image_from_array(values)
        made.SetSpacing(pitch)
        made.SetOrigin([-(n - 1) / 2 * p for n, p in zip(values.shape[::-1], pitch, strict=True)])
        return made

    cube = np.random.default_rng(0).random((voxels,) * 3, np.float32)
    spacing, pitch = (EDGE / voxels,) * 3, (3 * EDGE / pixels, 3 * EDGE / pixels, 1.0)
    blank = np.zeros((views, pixels, pixels), np.float32)

    def run(name: str, first: Any, second: Any) -> None:
        made = getattr(rtk, name)[kind, kind].New()
        made.SetGeometry(geometry)
        made.SetInput(0, first)
        made.SetInput(1, second)
        made.Update()

    seconds = in_turn(
        {
            "itk-rtk Joseph forward": lambda: run(
                "JosephForwardProjectionImageFilter", image(blank, pitch), image(cube, spacing)
            ),
            "itk-rtk Joseph adjoint": lambda: run(
                "JosephBackProjectionImageFilter", image(cube, spacing), image(blank + 1, pitch)
            ),
        },
        repeats,
    )
    ours = {
        r["what"]: r for r in rows if r["voxels"] == voxels and r["threads"] == 1
    }  # the same rig
    size = {
        key: ours["on the fly forward"][key] for key in ("voxels", "views", "rays", "crossings")
    }
    found = []
    for what, taken in seconds.items():
        other = "on the fly " + what.rsplit(" ", 1)[1]
        found.append(_row(what, 1, taken, size, ours[other]["seconds"] / taken, other))
    return found


def _stored(voxels: int, views: int, repeats: int) -> list[Row]:
    """Measure the stored projector against reading memory and scipy, and the tracer."""
    rig, grid = rig_for(voxels, views), VoxelGrid((voxels,) * 3, EDGE / voxels)
    rays = Rays.concatenate(Rays.from_camera(camera) for camera in rig)
    stored = Projector(trace(rays, grid), grid)
    matrix = stored.to_scipy()
    volume = np.random.default_rng(0).random(grid.size, np.float32)
    images = np.random.default_rng(1).random(stored.shape[0], np.float32)
    large = np.ones(LARGE, np.float32)
    entries = stored.n_segments
    size = {
        "voxels": voxels, "views": views,
        "rays": int((np.diff(stored.segments.ptr) > 0).sum()), "crossings": entries,
    }  # fmt: skip
    threads = numba.get_num_threads()
    seconds = in_turn(
        {
            "read": lambda: read(large),
            "scipy csr forward": lambda: matrix @ volume,
            "stored forward": lambda: stored @ volume,
            "stored adjoint": lambda: stored.T @ images,
            "tracing": lambda: trace(rays, grid),
        },
        repeats,
    )
    bandwidth = large.nbytes / seconds.pop("read")
    to = {"stored forward": "scipy csr forward"}
    rows = []
    for what, taken in seconds.items():
        other = to.get(what)
        count = 1 if what.startswith("scipy") else threads
        row = _row(what, count, taken, size, seconds[other] / taken if other else None, other)
        if what.startswith("stored"):
            row["bytes_per_second"] = entries * 8 / taken  # a voxel's number and a length
            row["bandwidth_share"] = row["bytes_per_second"] / bandwidth
        rows.append(row)
    return rows


# The plain walk is Amanatides and Woo's, "A fast voxel traversal algorithm for ray tracing"
# (Eurographics 1987), as it is usually written: the distance to the next plane of each axis is
# kept up to date by adding the distance between two planes, the nearest one decides the step, and
# the voxel's number is updated by adding its stride. It runs one pixel after another on all cores
# and takes rays that were clipped to the box before: a comparison is one of walks alone.


@numba.njit(inline="always")
def _start(position, direction, count, stride):
    """Return an axis's first voxel, the way to its next plane, between planes, and the step."""
    if direction > 0:
        voxel = min(max(math.floor(position), 0), count - 1)
        return voxel, (voxel + 1 - position) / direction, 1.0 / direction, stride
    if direction < 0:
        voxel = min(max(math.ceil(position) - 1, 0), count - 1)
        return voxel, (voxel - position) / direction, -1.0 / direction, -stride
    return min(max(math.floor(position), 0), count - 1), np.inf, np.inf, 0


@numba.njit(parallel=True)
def _walk(positions, directions, lengths, shape, volume, images):
    ny, nz = shape[1], shape[2]
    for ray in numba.prange(len(images)):
        end = lengths[ray]
        if not end > 0:
            images[ray] = 0
            continue
        x, next_x, between_x, step_x = _start(
            positions[ray, 0], directions[ray, 0], shape[0], ny * nz
        )
        y, next_y, between_y, step_y = _start(positions[ray, 1], directions[ray, 1], ny, nz)
        z, next_z, between_z, step_z = _start(positions[ray, 2], directions[ray, 2], nz, 1)
        voxel = (x * ny + y) * nz + z
        last = end * (1 - 1e-9)  # a plane this close to the end is the outer face
        here, total = 0.0, 0.0
        while True:
            if next_x < next_y and next_x < next_z:
                there, step = next_x, step_x
                next_x += between_x
            elif next_y < next_z:
                there, step = next_y, step_y
                next_y += between_y
            else:
                there, step = next_z, step_z
                next_z += between_z
            if there >= last:
                break
            total += (there - here) * volume[voxel]
            here = there
            voxel += step
        images[ray] = total + (end - here) * volume[voxel]


def project(box: BoxCrossing, grid: VoxelGrid, volume: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the line integrals ``(rays,)`` of ``volume`` ``(voxels,)`` along rays in the box."""
    images = np.zeros(len(box.length), np.float32)
    _walk(box.position, box.direction, box.length, grid.shape, volume, images)
    return images


@numba.njit(parallel=True, fastmath={"reassoc", "nsz", "contract"})
def _sum_rows(values, sums) -> None:
    for part in numba.prange(len(sums)):
        row, total = values[part], np.float32(0)
        for place in range(len(row)):
            total += row[place]
        sums[part] = total


def read(values: NDArray[np.float32]) -> None:
    """Read ``values``, of the shape `LARGE`, on all threads."""
    _sum_rows(values, np.zeros(len(values), np.float32))
