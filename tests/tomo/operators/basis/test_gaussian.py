import numpy as np
import pytest

from tomo.grid import VoxelGrid
from tomo.operators import GaussianBasis, Projector, dot_test
from tomo.rays import Rays
from tomo.trace import trace

WIDTHS = pytest.mark.parametrize("width", [0.3, 0.8, 2.5])


def kernel(width):
    """Return the blur along one axis as a matrix a vector longer than any axis is long."""
    radius = int(3 * width + 0.5)
    weights = np.exp(-(np.arange(-radius, radius + 1) ** 2) / (2 * width**2))
    return weights / weights.sum()


def slow_blur(volume, width):
    """Return the blur by sums over shifted copies, nothing outside."""
    weights = kernel(width)
    radius = len(weights) // 2
    for axis in range(3):
        padded = np.pad(volume, [(radius, radius) if a == axis else (0, 0) for a in range(3)])
        n = volume.shape[axis]
        volume = sum(w * np.take(padded, np.arange(n) + k, axis) for k, w in enumerate(weights))
    return volume


def derived(lines, width):
    smooth = GaussianBasis(lines, width)
    pixels = np.arange(0, 400, 3)
    return {
        "whole": (smooth, lines),
        "subset": (smooth.subset([3, 0]), lines.subset([3, 0])),
        "take": (smooth.take(pixels), lines.take(pixels)),
        "view": (smooth.view(2), lines.view(2)),
    }


@WIDTHS
@pytest.mark.parametrize("name", ["whole", "subset", "take", "view"])
def test_it_projects_the_blurred_coefficients(lines, width, name):
    smooth, plain = derived(lines, width)[name]
    coefficients = np.random.default_rng(1).random(lines.grid.shape)
    expected = plain @ slow_blur(coefficients, width).ravel()
    np.testing.assert_allclose(smooth @ coefficients.ravel(), expected, rtol=0, atol=1e-12)
    assert smooth.shape == plain.shape
    assert smooth.n_views == plain.n_views
    np.testing.assert_array_equal(smooth.view_ptr, plain.view_ptr)


@WIDTHS
def test_a_blob_stands_at_its_voxels_centre_and_loses_nothing_inside(lines, width):
    grid = VoxelGrid((41, 41, 41), 1.0)
    smooth = GaussianBasis(Projector(lines.segments.rows(0, 0), grid), width)
    point = np.zeros(grid.shape)
    point[20, 19, 22] = 5.0
    blob = smooth.to_voxels(point)
    assert blob.shape == grid.shape
    assert blob.sum() == pytest.approx(5, rel=1e-12)
    assert np.unravel_index(blob.argmax(), grid.shape) == (20, 19, 22)
    variance = np.average((np.arange(41) - 22) ** 2, weights=blob.sum(axis=(0, 1)))
    offsets = np.arange(len(kernel(width))) - len(kernel(width)) // 2
    assert variance == pytest.approx(np.average(offsets**2, weights=kernel(width)))
    assert (blob >= 0).all()


def test_row_sums_and_column_sums(lines):
    smooth = GaussianBasis(lines, 0.8)
    matrix = np.stack([smooth.T @ row for row in np.eye(400)])  # (pixels, voxels)
    np.testing.assert_allclose(smooth.row_sums, matrix.sum(axis=1), atol=1e-10)
    np.testing.assert_allclose(smooth.column_sums, matrix.sum(axis=0), atol=1e-10)


def test_a_grid_one_voxel_thin():
    grid = VoxelGrid((1, 6, 1), 1.0)
    rays = Rays.from_lines(grid.center - np.array([5, 1.2, 0]), [[1, 0.1, 0], [1, 0.4, 0.02]])
    smooth = GaussianBasis(Projector(trace(rays, grid), grid), 1.5)
    assert len(smooth.projector.segments) >= 2
    assert max(dot_test(smooth, seed) for seed in range(10)) < 1e-12


@pytest.mark.parametrize("width", [0, -1, float("nan")])
def test_a_width_that_is_none_is_refused(lines, width):
    with pytest.raises(ValueError, match="smooth basis width: found"):
        GaussianBasis(lines, width)
