"""A GPU against the CPU and, where it is installed, diffct: rates, solves, a film; one process.

A Gray/s is 1e9 rays a second that are projected forward, or back; arrays stay on the device. The
share of the issue limit is that of the instructions a crossing takes, counted in PTX, at the
device's cores and clock. Times are medians of runs in turn, after one that is not counted. Errors
are relative to the norm, against the reference tracer in double precision. Without a device the
part is refused.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rigs
from studies.benchmark.plume import LOWER, UPPER
from studies.common.ptx import body_of, compiled, innermost_loop
from studies.common.scans import simulated_by
from studies.common.study import Request, Tables
from studies.common.timing import in_turn
from tomo import Reconstruction, Scan, VoxelGrid, reconstruct, scan_of_images, solvers
from tomo.operators import Projector, dot_test
from tomo.operators.gpu import CudaDevice, Device, DeviceProjector, device_for, to_device
from tomo.operators.gpu.device import source
from tomo.operators.on_the_fly import OnTheFlyProjector
from tomo.operators.on_the_fly.camera_sources import pixel_source
from tomo.rays import Rays
from tomo.series import reconstruct_series
from tomo.series.frames import BLOCK
from tomo.trace import trace

Row = dict[str, Any]

PLUME = Path("plume_series")
PLUME_BOX = (64, 96, 64), LOWER, UPPER
REPEATS = 5
ALIKE = 10  # runs whose bits are compared


@dataclass(frozen=True)
class Size:
    """How large the problems are."""

    rates: tuple[tuple[int, int], ...]  # voxels along the edge, and views
    image: tuple[int, int]  # pixels of a view, width and height
    # voxels along the edge, views, and pixels along an image's edge, of the large solve
    solve: tuple[int, int, int]
    # voxels of the demo's flame, and their edge; of how many cameras one is taken, and by how much
    # images are shrunk
    demo: tuple[tuple[int, int, int], float, int, int]
    frames: int  # frames of the plume


_DEMO = (20, 94, 20), 0.75, 1, 1
SIZES = {
    "full": Size(((128, 360), (256, 360), (512, 360)), (1024, 768), (512, 60, 1024), _DEMO, 40),
    "quick": Size(((128, 36), (256, 36), (512, 36)), (1024, 768), (256, 60, 512), _DEMO, 24),
    "tiny": Size(((6, 2),), (16, 12), (8, 3, 12), ((6, 28, 6), 2.5, 8, 10), 3),
}


def check(request: Request) -> None:
    """Refuse to run without the device that is asked for."""
    if device_for(request.device, math.inf)[0] is None:
        raise ValueError(f"device: found {request.device!r}, expected cuda or cuda:N")


def run(request: Request) -> Tables:
    """Return the tables of a device."""
    check(request)
    device, _ = device_for(request.device, math.inf)
    assert device is not None
    steps = len(SIZES[request.size].rates) + 3
    tables: Tables = {"errors": errors(device), "rates": [], "solves": [], "film": []}
    size = SIZES[request.size]
    for number, (voxels, views) in enumerate(size.rates):
        request.progress(number, steps, f"{voxels} voxels along an edge")
        tables["rates"] += rates(device, voxels, views, size.image)
    request.progress(steps - 3, steps, "the demo's scan")
    wrong, taken = demo_solve(request.device, size.demo)
    tables["errors"] += wrong
    tables["solves"] += taken
    request.progress(steps - 2, steps, "the large solve")
    tables["solves"] += large_solve(device, *size.solve)
    request.progress(steps - 1, steps, "the plume's film")
    tables["film"] += film(request.data, request.device, size.frames)
    return tables


def errors(device: Device) -> list[Row]:
    """Return the errors of both products and of the dot test, and whether bits repeat."""
    grid = VoxelGrid((24, 30, 20), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))
    rig = rigs.ring(5, distance=400.0, image_size=(60, 80), footprint=0.5, center=grid.center)
    rays = Rays.concatenate([Rays.from_camera(camera) for camera in rig])
    exact = Projector(trace(rays, grid, "reference", dtype=np.float64), grid)
    there = DeviceProjector(OnTheFlyProjector(rays, grid), device)
    random = np.random.default_rng(0)
    x, y = random.random(grid.size, np.float32), random.random(len(rays), np.float32)
    back = there.T @ y
    same = [np.array_equal(there.T @ y, back) for _ in range(ALIKE)]

    def off(found: NDArray, right: NDArray) -> float:
        return float(np.linalg.norm(found - right) / np.linalg.norm(right))

    measured = (
        ("dot test", dot_test(there, 0, np.float32), 1e-6),
        ("forward", off(there @ x, exact @ x.astype(np.float64)), 1e-6),
        ("adjoint", off(back, exact.T @ y.astype(np.float64)), 3e-6),
        (f"adjoints of {ALIKE} with other bits", float(ALIKE - sum(same)), 0.0),
    )
    return [_checked(*one) for one in measured]


def _checked(what: str, found: float, most: float) -> Row:
    return {"what": what, "found": found, "expected": most, "holds": found <= most}


def rates(device: Device, voxels: int, views: int, image: tuple[int, int]) -> list[Row]:
    """Return a row a product, ours and diffct's, of a cube seen from a ring of cameras."""
    distance, footprint = 4.0 * voxels, 2.0 * voxels / image[0]
    grid = VoxelGrid((voxels,) * 3, 1.0)
    rig = rigs.ring(views, distance=distance, image_size=image, footprint=footprint)
    operator = to_device(OnTheFlyProjector(list(map(pixel_source, rig)), grid), device)
    random = np.random.default_rng(0)
    x = device.array(random.random(operator.shape[1], np.float32))
    y = device.array(random.random(operator.shape[0], np.float32))

    def done(result: Any) -> None:
        device.host(result[:1])  # waits for the device

    seconds = in_turn(
        {"forward": lambda: done(operator @ x), "adjoint": lambda: done(operator.T @ y)}, REPEATS
    )
    crossings, limit = operator.n_segments, issue_limit(device)
    rows = []
    for product, taken in seconds.items():
        found = _rate("flametomo", product, voxels, views, operator.shape[0], taken)
        found["crossings_per_second"] = crossings / taken
        counted = instructions(f"{product}_1")
        if limit and counted:
            found["issue_share"] = crossings / taken * counted / limit
        rows.append(found)
    return rows + _of_diffct(voxels, views, image, distance, footprint)


def _rate(what: str, product: str, voxels: int, views: int, rays: int, seconds: float) -> Row:
    return {
        "what": what, "product": product, "voxels": voxels, "views": views, "seconds": seconds,
        "gray_per_second": rays / seconds / 1e9, "crossings_per_second": None, "issue_share": None,
    }  # fmt: skip


def _of_diffct(
    voxels: int, views: int, image: tuple[int, int], distance: float, footprint: float
) -> list[Row]:
    """Return diffct's rows for the same cube and views; none where it is not installed."""
    try:
        diffct, torch = map(importlib.import_module, ("diffct", "torch"))
    except ImportError:
        return []
    way = diffct.circular_trajectory_3d(views, sid=distance, sdd=distance, device="cpu")
    operator = diffct.Projector(way, (voxels,) * 3, image, detector_spacing=footprint)
    x = torch.rand((voxels,) * 3, device="cuda")
    y = torch.rand((views, *image), device="cuda")

    def timed(product: Callable[[Any], Any], argument: Any) -> Callable[[], None]:
        def run() -> None:
            product(argument)
            torch.cuda.synchronize()

        return run

    products = {"forward": timed(operator.project, x), "adjoint": timed(operator.backproject, y)}
    rays = views * math.prod(image)
    return [
        _rate(f"diffct {getattr(diffct, '__version__', '')}".strip(), name, voxels, views, rays, s)
        for name, s in in_turn(products, REPEATS).items()
    ]


def instructions(kernel: str) -> float | None:
    """Return a crossing's instructions, 2/3 of the loop over all axes; None without a compiler."""
    ptx = compiled(source(np.float32))
    return None if ptx is None else 2 / 3 * len(innermost_loop(body_of(ptx, kernel)))


def issue_limit(device: Device) -> float | None:
    """Return the instructions of threads that a device can begin in a second; None if unknown."""
    if not isinstance(device, CudaDevice):
        return None
    runtime = importlib.import_module("cupy").cuda.runtime
    processors, kilohertz = (
        runtime.deviceGetAttribute(number, device.number) for number in (16, 13)
    )
    return processors * 128 * kilohertz * 1e3  # four schedulers a multiprocessor, 32 threads each


def demo_solve(
    name: str, demo: tuple[tuple[int, int, int], float, int, int]
) -> tuple[list[Row], list[Row]]:
    """Return what differs from the CPU's demo, and its seconds.

    From images in memory to volume and intervals; and those in which pixels are screened and
    effects of cameras and gas looked for. The demo is faultless, so both have to say nothing.
    """
    shape, spacing, every, shrink = demo
    rig, grid = rigs.Rig(tuple(rigs.preset("paper33_pitch"))[::every]), VoxelGrid(shape, spacing)
    scan = simulated_by(rig, grid, ("turbulent", 1)).scan.scaled(shrink)
    found: dict[str, Reconstruction] = {}

    def solve(where: str) -> None:
        found[where] = reconstruct(scan, device=where)

    seconds = in_turn({one: lambda one=one: solve(one) for one in ("cpu", name)}, 1)
    own, there = (found[one] for one in ("cpu", name))
    both = [{(one.effect, one.camera) for one in each.findings} for each in (own, there)]
    volume, other = (np.asarray(one.volume) for one in (own, there))
    off = float(np.abs(volume - other).max() / volume.max())
    wrong = [
        _checked("demo: findings that the CPU has not, or has alone", len(both[0] ^ both[1]), 0.0),
        _checked("demo: volume, of its peak", off, 1e-4),
    ]
    times = {"demo, volume and intervals": seconds}
    times["demo, its effects"] = {one: found[one].seconds["screen"] for one in found}
    return wrong, [
        {"what": what, "where": where, "seconds": taken, "gigabytes": None}
        for what, each in times.items()
        for where, taken in each.items()
    ]


def large_solve(device: Device, voxels: int, views: int, pixels: int) -> list[Row]:
    """Return the seconds of 30 iterations of CGLS, and the memory that the device gave."""
    grid = VoxelGrid((voxels,) * 3, 1.0)
    rig = rigs.ring(
        views, distance=4.0 * voxels, image_size=(pixels, pixels), footprint=2.0 * voxels / pixels
    )
    operator = to_device(OnTheFlyProjector(list(map(pixel_source, rig)), grid), device)
    measured = operator @ np.random.default_rng(0).random(operator.shape[1], np.float32)
    began = time.perf_counter()
    solvers.cgls(operator, measured, iterations=30)
    taken, pool = time.perf_counter() - began, importlib.import_module("cupy")
    held = pool.get_default_memory_pool().total_bytes() / 1e9
    what = f"{voxels}^3, {views} views of {pixels} x {pixels}, 30 iterations"
    return [{"what": what, "where": device.name, "seconds": taken, "gigabytes": held}]


def film(data: Path | None, name: str, frames: int) -> list[Row]:
    """Return a frame's time once the first block is done, and the volumes' relative difference."""
    if data is None or not (data / PLUME).is_dir():
        return []
    folder = data / PLUME
    scan = scan_of_images(folder / "rig.yaml", folder, grid=VoxelGrid.from_bounds(*PLUME_BOX))
    volumes, rows = [], []
    for where in ("cpu", name):
        taken, found = _solved(scan, frames, where)
        volumes.append(found)
        off = np.linalg.norm(found - volumes[0]) / np.linalg.norm(volumes[0])
        rows.append(
            {"where": where, "frames": frames, "milliseconds_a_frame": taken, "off": float(off)}
        )
    return rows


def _solved(scan: Scan, frames: int, device: str) -> tuple[float | None, NDArray[np.float32]]:
    """Return the milliseconds of a frame after the first block, and the volumes."""
    times: dict[int, float] = {}

    def note(done: int, total: int, where: str) -> None:
        if "frame " in where:  # and not a stage of the plan
            times.setdefault(done, time.perf_counter())

    with TemporaryDirectory() as folder:
        store = reconstruct_series(
            scan, Path(folder) / "film.zarr", frames=f"0:{frames}", device=device, progress=note
        )
        volumes = np.asarray(store.group["emission"][:])
    if frames <= BLOCK:
        return None, volumes
    return 1e3 * (times[frames] - times[BLOCK]) / (frames - BLOCK), volumes
