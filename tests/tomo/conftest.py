from types import SimpleNamespace

import numpy as np
import pytest

import rigs
from tomo.grid import VoxelGrid
from tomo.operators import Projector
from tomo.rays import Rays
from tomo.trace import Segments, trace


@pytest.fixture(scope="session")
def lines():
    """Return the projector of 400 lines every which way, in four views, the second without any."""
    grid = VoxelGrid((9, 14, 7), (0.5, 0.4, 0.6), (0.3, -0.2, 0.1))
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((400, 3))
    points = rng.uniform(grid.lower - 0.5, grid.upper + 0.5, (400, 3))
    segments = trace(Rays.from_lines(points - 20 * directions, directions), grid)
    return Projector(segments, grid, [0, 100, 100, 250, 400])


@pytest.fixture(scope="session")
def projector_of():
    """Return a function: dense matrix (pixels, unknowns) to Projector; zeros are not stored."""

    def make(matrix, view_ptr=None, active=None):
        matrix = np.asarray(matrix, np.float64)
        rows, columns = np.nonzero(matrix)
        ptr = np.searchsorted(rows, np.arange(len(matrix) + 1)).astype(np.int64)
        entries = matrix[rows, columns].astype(np.float32)
        segments = Segments(ptr, columns.astype(np.int32), entries)
        grid = active.grid if active else VoxelGrid((matrix.shape[1], 1, 1), 1.0)
        return Projector(segments, grid, view_ptr, active)

    return make


@pytest.fixture(scope="session")
def dense():
    """Return a function: Projector to its dense float64 matrix."""
    return lambda projector: projector.to_scipy().toarray().astype(np.float64)


def _ring_projector(supersample=1):
    grid = VoxelGrid((10, 14, 10), 1.0)
    rig = rigs.ring(9, distance=300.0, image_size=(16, 20), footprint=0.9, pitch_degrees=10.0)
    rays = Rays.concatenate([Rays.from_camera(camera, supersample=supersample) for camera in rig])
    return Projector(trace(rays, grid), grid, np.arange(10) * 320)


@pytest.fixture(scope="session")
def ring_system():
    """Return a smooth flame-like truth in view of nine cameras: projector, truth, measured."""
    projector = _ring_projector()
    x, y, z = np.moveaxis(projector.grid.centers(), -1, 0)
    truth = np.exp(-(((x - 0.7) / 2) ** 2) - (y / 4) ** 2 - ((z + 0.4) / 2.5) ** 2)
    truth = np.where(truth > 0.02, truth, 0).astype(np.float32)
    return SimpleNamespace(projector=projector, truth=truth, measured=projector @ truth.ravel())


@pytest.fixture(scope="session")
def supersampled(ring_system):
    """Return the same truth seen with 3 x 3 rays a pixel: voxels repeat in a pixel's row."""
    projector = _ring_projector(supersample=3)
    return SimpleNamespace(
        projector=projector,
        truth=ring_system.truth,
        measured=projector @ ring_system.truth.ravel(),
    )
