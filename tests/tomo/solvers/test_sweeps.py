"""The compiled sweeps of ART and MART against twins in float64 that go pixel by pixel."""

import numpy as np
import pytest

from tomo.solvers import art, mart, sart, sirt


def art_twin(matrix, measured, order, relaxation, nonnegative, x):
    x = x.astype(np.float64)
    squares = np.sum(matrix**2, axis=1)
    floor = 0.1 * np.median(squares[squares > 0]) if squares.any() else 1.0
    for pixel in order:
        row = matrix[pixel]
        x = x + relaxation * (measured[pixel] - row @ x) / max(row @ row, floor) * row
        if nonnegative:
            x[row > 0] = np.maximum(x[row > 0], 0)
    return x


def mart_twin(matrix, measured, order, relaxation, x):
    x = x.astype(np.float64)
    longest = np.max(matrix, axis=1)
    floor = 0.1 * np.median(longest[longest > 0]) if longest.any() else 1.0
    for pixel in order:
        row = matrix[pixel]
        if row @ x > 0:
            power = relaxation * row / max(row.max(), floor)
            x = x * (max(measured[pixel], 0) / (row @ x)) ** power
    return x


def _order(matrix, seed=0):
    return np.random.default_rng(seed).permutation(np.flatnonzero(matrix.any(axis=1)))


@pytest.mark.parametrize(
    ("method", "twin"), [(art, lambda *a: art_twin(*a[:4], True, a[4])), (mart, mart_twin)]
)
def test_several_rays_of_a_pixel_are_one_equation(supersampled, dense, method, twin):
    projector, measured = supersampled.projector, supersampled.measured
    assert len(projector.segments) > np.count_nonzero(dense(projector))  # voxels do repeat
    start = np.full(projector.shape[1], 0.2, np.float32)
    found = method(projector, measured, iterations=1, start=start, relaxation=0.5)
    matrix = dense(projector)
    expected = twin(matrix, measured, _order(matrix), 0.5, start)
    np.testing.assert_allclose(found.volume.ravel(), expected, rtol=1e-3, atol=1e-4)


def test_art_with_relaxation_one_satisfies_the_equation_used_last(ring_system):
    projector, measured = ring_system.projector, ring_system.measured
    measured = measured + np.random.default_rng(0).normal(0, 0.3, len(measured))  # inconsistent
    found = art(projector, measured, iterations=1, relaxation=1.0, nonnegative=False, seed=5)
    crossed = np.flatnonzero(np.diff(projector.segments.ptr))
    last = np.random.default_rng(5).permutation(crossed)[-1]
    misfit = measured - projector @ found.volume.ravel()
    assert abs(misfit[last]) < 1e-5
    assert np.abs(misfit[crossed]).max() > 0.1


@pytest.mark.parametrize(
    ("solve", "settings"), [(art, {}), (mart, {}), (sart, {}), (sirt, {"subsets": 4})]
)
def test_the_noise_of_a_ray_that_grazes_throws_no_voxel_off(projector_of, solve, settings):
    """Undamped, its noise is divided by the billionth of a voxel that it meets."""
    chords = np.random.default_rng(0).uniform(0.5, 1.5, (24, 6))
    chords[:-1, 0] = 0
    chords[::6] = [1e-9, 0, 0, 0, 0, 0]  # most views and subsets see no more of the first voxel
    x = np.arange(1.0, 7)
    measured = chords @ x + 0.1
    projector = projector_of(chords, np.arange(0, 25, 6))
    found = solve(projector, measured, iterations=5, relaxation=1.0, **settings).volume
    assert found.max() < 2 * x.max()


def test_the_order_of_the_pixels_is_the_seeds(ring_system):
    volumes = [
        art(ring_system.projector, ring_system.measured, iterations=1, seed=seed).volume
        for seed in (0, 0, 1)
    ]
    np.testing.assert_array_equal(volumes[0], volumes[1])
    assert (volumes[0] != volumes[2]).any()


def test_mart_keeps_voxels_positive_and_empties_those_behind_a_dark_pixel(projector_of, dense):
    random = np.random.default_rng(0)
    matrix = random.uniform(0.2, 1, (12, 10)) * (random.random((12, 10)) < 0.4)
    projector = projector_of(matrix)
    measured = dense(projector) @ random.uniform(0.5, 2, 10)
    measured[3] = 0
    measured[5] = -1  # below zero counts as zero
    found = mart(projector, measured, iterations=5).volume.ravel()
    behind = (matrix[[3, 5]] > 0).any(axis=0)
    seen = matrix.any(axis=0)
    assert behind.any()
    assert (seen & ~behind).any()
    np.testing.assert_array_equal(found[behind], 0)
    assert (found[seen & ~behind] > 0).all()
