"""Which columns rays meet: as many as the reference's crossings say, and cut evenly."""

from dataclasses import replace

import numpy as np
import pytest

from rigs import Distortion, ring
from tomo import Rays, VoxelGrid
from tomo.operators.on_the_fly.camera_sources import pixel_source
from tomo.operators.on_the_fly.chunks import chunks_of, columns_met
from tomo.operators.on_the_fly.running_sums import ORDERS
from tomo.trace import trace

GRID = VoxelGrid((9, 14, 11), (1.0, 0.8, 1.2))


def _rays_by_column(camera, axes, grid):
    """Return how many rays with driving axis a cross voxels of each column, by their segments."""
    rays = Rays.from_camera(camera)
    along = np.abs(rays.directions) / np.asarray(grid.spacing)
    segments = trace(rays, grid, "reference", dtype=np.float64)
    ray = np.repeat(np.arange(len(segments.ptr) - 1), np.diff(segments.ptr))
    column = np.unravel_index(segments.voxel, grid.shape)[axes[1]]
    wanted = (along.argmax(axis=1) == axes[0])[ray] & (segments.length > 1e-9)
    met = np.unique(np.stack([ray, column])[:, wanted], axis=1)
    return np.bincount(met[1], minlength=grid.shape[axes[1]])


@pytest.mark.parametrize("bend", [0.0, -0.2])
@pytest.mark.parametrize("axes", ORDERS)
def test_columns_that_rays_meet_are_those_of_their_crossings(axes, bend):
    lens = Distortion("brown", (bend, 0.03, 0.001, -0.002)) if bend else Distortion()
    found = np.zeros(GRID.shape[axes[1]], np.int64)
    expected = found.copy()
    for camera in ring(5, 67.0, 25.0, image_size=(60, 80), footprint=0.25, pitch_degrees=20.0):
        source = pixel_source(replace(camera, distortion=lens))
        met = columns_met(list(chunks_of([source], [True])), GRID, axes)
        by_column = _rays_by_column(source.camera, axes, GRID)
        crossed = np.flatnonzero(by_column)
        first, end = met.spans[0]
        assert (first, end) == ((crossed[0], crossed[-1] + 1) if len(crossed) else (0, 0))
        found, expected = found + met.rays, expected + by_column
    assert expected.sum() > 1000
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 40])
def test_ranges_make_up_all_columns_and_share_the_work(count):
    (camera,) = ring(1, distance=40.0, image_size=(40, 60), footprint=0.4, pitch_degrees=35.0)
    met = columns_met(list(chunks_of([pixel_source(camera)], [True])), GRID, ORDERS[0])
    for columns in (range(14), range(3, 9), range(5, 6)):
        ranges = met.even_ranges(columns, count)
        assert [n for low, high in ranges for n in range(low, high)] == list(columns)
        assert len(ranges) <= min(count, len(columns))
        work = [met.rays[low:high].sum() for low, high in ranges]
        even = met.rays[columns.start : columns.stop].sum() / count
        assert max(work) < even + met.rays.max() + len(columns)
