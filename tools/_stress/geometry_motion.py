"""What may not matter: which way rays run, how axes are named, where the world's origin is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations

import numba
import numpy as np
from numpy.typing import NDArray

import rigs
from _stress.geometry_scenes import SHAPE, thin_grids, through
from _stress.row import Row, Size, relative_error, worst_of
from _stress.values_scene import reconstructed, simulated_by
from rigs import Camera, Distortion
from rigs.camera import look_at
from tomo import LinearSystem, Projector
from tomo.grid import VoxelGrid
from tomo.operators.on_the_fly.projector import OnTheFlyProjector
from tomo.rays import Rays
from tomo.simulation import simulate
from tomo.solvers import cgls
from tomo.trace import trace


def motion_rows(size: Size) -> Iterator[Row]:
    """Yield how far results move when nothing of substance does."""
    random = np.random.default_rng(size.seed)
    yield _same_bits(random)
    yield _turned(random)
    yield _moved(random)
    yield _threads(random)
    yield _from_inside()
    yield _whole_way()
    yield _limit(size)


def _images(rays: Rays, grid: VoxelGrid, volume: NDArray) -> dict[str, NDArray]:
    return {
        "stored": Projector(trace(rays, grid, dtype=np.float64), grid) @ volume.ravel(),
        "on the fly": OnTheFlyProjector(rays, grid) @ volume.ravel(),
    }


def _same_bits(random: np.random.Generator) -> Row:
    """Scale lengths by powers of two: every chord has to have the same digits."""
    grid = VoxelGrid(SHAPE, 0.3, (1, 2, 3))
    rays, volume = through(grid, 500, random, 50), random.random(SHAPE)
    expected = _images(rays, grid, volume)
    figures = []
    for power in (-30, -10, 10, 30):
        factor = 2.0**power
        scaled = VoxelGrid(SHAPE, 0.3 * factor, tuple(factor * np.asarray(grid.center)))
        found = _images(replace(rays, origins=rays.origins * factor), scaled, volume)
        for name, images in expected.items():
            figures.append((f"{name}, 2^{power}", relative_error(found[name], images * factor)))
    figure, where = worst_of(figures)
    return Row(
        "Lengths scaled by powers of two", "2^-30 to 2^30", figure, 0.0, "relative", note=where
    )


def _turned(random: np.random.Generator) -> Row:
    """Rename and mirror axes, and send rays the other way."""
    grid = VoxelGrid(SHAPE, (0.3, 0.5, 0.4), (1, -2, 3))
    rays, volume = through(grid, 500, random, 50), random.random(SHAPE)
    expected = _images(rays, grid, volume)
    figures = []
    for order in permutations(range(3)):
        axes = list(order)
        turned = VoxelGrid(
            *(tuple(np.asarray(v)[axes]) for v in (grid.shape, grid.spacing, grid.center))
        )
        other = replace(rays, origins=rays.origins[:, axes], directions=rays.directions[:, axes])
        found = _images(other, turned, volume.transpose(axes))
        figures += [
            (f"{n}, axes {axes}", relative_error(found[n], v)) for n, v in expected.items()
        ]
    for axis in range(3):
        sign = np.where(np.arange(3) == axis, -1.0, 1.0)
        mirrored = replace(grid, center=tuple(sign * grid.center))
        other = replace(rays, origins=rays.origins * sign, directions=rays.directions * sign)
        found = _images(other, mirrored, np.flip(volume, axis))
        figures += [(f"{n}, mirrored", relative_error(found[n], v)) for n, v in expected.items()]
    back = replace(rays, origins=rays.origins + 120 * rays.directions, directions=-rays.directions)
    found = _images(back, grid, volume)
    figures += [(f"{n}, reversed", relative_error(found[n], v)) for n, v in expected.items()]
    figure, where = worst_of(figures)
    return Row(
        "Axes renamed and mirrored, rays reversed",
        "all orders",
        figure,
        1e-12,
        "relative",
        note=where,
    )


def _moved(random: np.random.Generator) -> Row:
    """Shift rays and grid together, by up to 1e7 voxels."""
    grid = VoxelGrid(SHAPE, 0.5)
    rays, volume = through(grid, 500, random, 50), random.random(SHAPE)
    expected = _images(rays, grid, volume)
    figures = []
    for distance in (1e2, 1e5, 1e7):
        shift = 0.5 * distance * random.standard_normal(3)
        moved = _images(
            replace(rays, origins=rays.origins + shift),
            VoxelGrid(SHAPE, 0.5, tuple(shift)), volume,
        )  # fmt: skip
        rounding = np.finfo(float).eps * np.abs(shift).max() / 0.5
        figures += [
            (f"{name}, {distance:g} voxels", relative_error(moved[name], images) / rounding)
            for name, images in expected.items()
        ]
    figure, where = worst_of(figures)
    return Row(
        "World moved with everything in it", "1e2 to 1e7 voxels", figure, 8.0,
        "roundings of a coordinate, in voxels", note=where,
    )  # fmt: skip


def _threads(random: np.random.Generator) -> Row:
    """Project through thin grids on any number of threads: the bits have to be the same."""
    differing, cases = [], list(thin_grids(300, random))
    most = numba.config.NUMBA_NUM_THREADS
    counts = sorted({1, 2, most} & set(range(1, most + 1)))
    before = numba.get_num_threads()
    for case in cases:
        x, y = random.random(case.grid.size), random.random(len(case.rays))
        found = []
        for count in counts:
            numba.set_num_threads(count)
            for A in (
                Projector(trace(case.rays, case.grid), case.grid),
                OnTheFlyProjector(case.rays, case.grid),
            ):
                found.append((A @ x, A.T @ y))
        numba.set_num_threads(before)
        for one, other in zip(found[2:], found[:-2], strict=True):
            same = all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
            differing += [case.name] * (not same)
    return Row.of_faults(
        "Grids one voxel thin: bits that differ between threads",
        f"{len(cases)} grids, {', '.join(map(str, counts))} threads",
        differing,
    )


def _from_inside() -> Row:
    """Look out from within the grid: what is behind a camera is not proven empty by it."""
    grid = VoxelGrid((24, 24, 24), 1.0)
    cameras = []
    for number in range(10):
        turn, height = 2 * np.pi * number / 10, 5.5 if number % 2 else -5.5
        position = np.array([11 * np.cos(turn), height, 11 * np.sin(turn)])
        lens = Distortion() if number % 3 else Distortion("fisheye", (0.05, 0, 0, 0))
        R, t = look_at(position, (0, 0, 0))
        matrix = [[30, 0, 23.5], [0, 30, 23.5], [0, 0, 1]]
        cameras.append(Camera(f"cam{number:02}", (48, 48), matrix, lens, R, t))
    rig = rigs.Rig(tuple(cameras))

    def cloud(points: NDArray) -> NDArray:
        away = np.linalg.norm((points - (1, 2, -1)) / (3, 3.5, 3), axis=1)
        return np.exp(-2 * away**2) * (away < 2.2)

    made = simulate(rig, cloud, grid, supersample=2, refine=2)
    errors = [
        reconstructed(made, method="mlem", skip=skip, uncertainty=0)
        .reconstruction.quality["nrmse"] for skip in (True, False)
    ]  # fmt: skip
    return Row(
        "Cameras inside the grid: error with what is empty left out, over that without",
        "10 cameras among the voxels", errors[0] / errors[1], 1.1, "times",
        note=f"NRMSE {errors[0]:.3f}",
    )  # fmt: skip


def _whole_way() -> Row:
    """Go the whole way from images to report, elsewhere and in other units: the same error."""
    figures, first = [], None
    for name, off, unit in (
        ("at the origin", 0.0, 1.0), ("1e7 voxels off", 1e7, 1.0),
        ("units of 1e-9", 0.0, 1e-9), ("units of 1e9", 0.0, 1e9),
    ):  # fmt: skip
        center = off * 0.5 * unit * np.array([1, -0.6, 0.4])
        grid = VoxelGrid((16, 24, 16), 0.5 * unit, tuple(center))
        rig = rigs.ring(
            7, distance=300 * unit, image_size=(36, 52), footprint=0.3 * unit, pitch_degrees=10
        ).transformed(np.eye(3), grid.center)
        found = reconstructed(simulated_by(rig, grid), uncertainty=0)
        error = found.reconstruction.quality["nrmse"]
        first = error if first is None else first
        figures.append((name, abs(error / first - 1)))
    figure, where = worst_of(figures)
    return Row(
        "From images to report by the default method: change of the error",
        "1e7 voxels off, units of 1e-9 and 1e9", figure, 1e-3, "of the error", note=where,
    )  # fmt: skip


def _limit(size: Size) -> Row:
    """Reconstruct from farther and farther: what changes falls with the distance.

    At the grid's rim, half its side n from the axis, a ray from D voxels away leans by n / 2 D:
    over half the side it comes to lie n² / 4 D voxels from a parallel one.
    """
    grid = VoxelGrid((16, 20, 16), 1.0)
    centre = np.linalg.norm(grid.centers() / (5, 6, 5), axis=-1)
    truth = np.exp(-(centre**2)).ravel()
    volumes = {}
    distances = (1e4, 1e6, 1e8)
    for distance in distances:
        rig = rigs.ring(
            5 if size.quick else 9, distance=distance, image_size=(24, 28), footprint=1.0,
            pitch_degrees=10,
        )  # fmt: skip
        A = LinearSystem.from_rig(rig, grid, skip=False).projector
        volumes[distance] = cgls(A, A @ truth, iterations=8).volume
    last = volumes[distances[-1]]
    figures = [(f"{d:g}", relative_error(volumes[d], last) * d) for d in distances[:-1]]
    figure, where = worst_of(figures)
    return Row(
        "Reconstruction from ever farther cameras: change against that of parallel rays",
        "1e4 to 1e8 voxels away", figure, max(grid.shape) ** 2 / 4,
        "voxels over the distance", note=where,
    )  # fmt: skip
