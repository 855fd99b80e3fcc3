from types import SimpleNamespace

import numpy as np
import pytest

import rigs
from tomo.grid import VoxelGrid
from tomo.projector import Projector
from tomo.rays import Rays
from tomo.segments import Segments
from tomo.trace import trace


@pytest.fixture(autouse=True, scope="module")
def _one_thread(on_threads):
    """Run small kernels on one thread: waiting for a second costs more, most of all when busy."""
    with on_threads(1):
        yield


@pytest.fixture(scope="session")
def projector_of():
    """Return a function: dense matrix (pixels, unknowns) to Projector; zeros are not stored."""

    def make(matrix, view_ptr=None, live=None):
        matrix = np.asarray(matrix, np.float64)
        rows, columns = np.nonzero(matrix)
        ptr = np.searchsorted(rows, np.arange(len(matrix) + 1)).astype(np.int64)
        entries = matrix[rows, columns].astype(np.float32)
        segments = Segments(ptr, columns.astype(np.int32), entries)
        grid = live.grid if live else VoxelGrid((matrix.shape[1], 1, 1), 1.0)
        return Projector(segments, grid, view_ptr, live)

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
