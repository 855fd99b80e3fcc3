"""What every tracer keeps to: half-open voxels, symmetry, grouping by pixel, large grids."""

from itertools import pairwise, permutations, product

import numpy as np
import pytest

from tomo.grid import VoxelGrid
from tomo.operators.on_the_fly import OnTheFlyProjector
from tomo.rays import Rays
from tomo.trace import TRACERS, trace

EVERY = pytest.mark.parametrize("tracer", TRACERS)
CUBE = VoxelGrid((4, 4, 4), 0.5, (8, -2, 1))


def dense(segments, grid):
    """Return the lengths as one volume a pixel, ``(pixels, nx, ny, nz)``."""
    lengths = np.zeros((segments.n_pixels, grid.size))
    pixel = np.repeat(np.arange(segments.n_pixels), np.diff(segments.ptr))
    np.add.at(lengths, (pixel, segments.voxel), segments.length)
    return lengths.reshape(-1, *grid.shape)


def through(grid, n=200, seed=0):
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((n, 3))
    points = rng.uniform(grid.lower, grid.upper, (n, 3))
    return Rays.from_lines(points - 8 * directions, directions)


@EVERY
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_ray_along_a_face_or_an_edge_belongs_to_the_voxel_above(tracer, axis, sign):
    others = [a for a in range(3) if a != axis]
    steps = np.arange(0, 4.5, 0.5)  # on faces and between them, both outer faces included
    position = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    origins = np.full((len(position), 3), 2.0 - 40 * sign)
    origins[:, others] = position
    rays = Rays.from_lines(CUBE.lower + 0.5 * origins, sign * np.eye(3)[axis])
    lengths = dense(trace(rays, CUBE, tracer, dtype=np.float64), CUBE)
    owner = np.minimum(np.floor(position), 3).astype(int)
    lengths = np.moveaxis(lengths, axis + 1, -1)  # (rays, others, axis)
    expected = np.zeros_like(lengths)
    expected[np.arange(len(owner)), owner[:, 0], owner[:, 1]] = 0.5
    np.testing.assert_array_equal(lengths, expected)


@EVERY
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("number", range(5))
def test_an_oblique_ray_in_a_face_belongs_to_the_voxel_above(tracer, axis, number):
    origin, direction = np.array([-9.0, -9.3, -9.6]), np.array([1.0, 1.03, 1.06])
    origin[axis], direction[axis] = number, 0.0
    rays = Rays.from_lines(CUBE.lower + 0.5 * origin, direction)
    layers = np.moveaxis(dense(trace(rays, CUBE, tracer, dtype=np.float64), CUBE)[0], axis, 0)
    chords = layers.sum(axis=(1, 2))
    assert chords[min(number, 3)] > 2
    assert chords.sum() == chords[min(number, 3)]


@EVERY
def test_just_outside_an_outer_face_nothing_is_crossed(tracer):
    outside = np.stack([CUBE.lower - 1e-14, CUBE.upper + 1e-14])
    for axis in range(3):
        origins = np.repeat([CUBE.center], 2, axis=0)
        origins[:, axis] = outside[:, axis]
        rays = Rays.from_lines(origins - 9 * np.eye(3)[axis - 1], np.eye(3)[axis - 1])
        assert len(trace(rays, CUBE, tracer)) == 0


@EVERY
def test_a_diagonal_passes_through_corners_without_detours(tracer):
    rays = Rays.from_lines(CUBE.lower - 1, [1, 1, 1])
    lengths = dense(trace(rays, CUBE, tracer, dtype=np.float64), CUBE)[0]
    expected = np.zeros(CUBE.shape)
    np.fill_diagonal(expected, 0.5 * np.sqrt(3))
    np.testing.assert_allclose(lengths, expected, atol=1e-12)


@EVERY
@pytest.mark.parametrize("tilt", [5e-324, -5e-324, 1e-310, -1e-200, 6e-17, -6e-17])
def test_a_tilt_below_rounding_changes_neither_voxels_nor_lengths(tracer, tilt):
    origin = np.array([-20.0, 1.25, 2.5])
    level, tilted = (
        trace(Rays.from_lines(CUBE.lower + 0.5 * origin, [1, t, t]), CUBE, tracer)
        for t in (0.0, tilt)
    )
    assert len(level) == 4
    np.testing.assert_array_equal(tilted.voxel, level.voxel)
    np.testing.assert_array_equal(tilted.length, level.length)


@EVERY
@pytest.mark.parametrize("tilt", [5e-324, -5e-324, 1e-310, -1e-310])
@pytest.mark.parametrize("face", [0, 4])
def test_in_an_outer_face_a_subnormal_tilt_is_none(tracer, tilt, face):
    origin = CUBE.lower + 0.5 * np.array([-20, face, face])
    rays = Rays.from_lines(origin, [1, tilt, tilt])
    segments = trace(rays, CUBE, tracer, dtype=np.float64)
    assert segments.length.tolist() == [0.5] * 4
    assert (OnTheFlyProjector(rays, CUBE) @ np.ones(CUBE.size)).tolist() == [2.0]


@pytest.mark.parametrize("tilt", [1e-3, 1e-6, 1e-9, 1e-12, 1e-14])
def test_a_ray_that_leaves_a_face_belongs_to_the_side_it_goes_to(tilt):
    """From a face exactly, so that geometry and not rounding decides."""
    origin = CUBE.lower + 0.5 * np.array([0, 2, 2])
    for tracer, sign in product(TRACERS, (-1, 1)):
        segments = trace(Rays.from_lines(origin, [1, sign * tilt, 0]), CUBE, tracer)
        assert set(np.unravel_index(segments.voxel, CUBE.shape)[1]) == {2 if sign > 0 else 1}


@EVERY
def test_rays_that_miss_keep_their_row_and_own_nothing(tracer):
    origins = CUBE.center + np.array([[0, 0, 9], [0, 0, -9], [9, 0, 0], [0, 0, -9], [0, 9, -9.0]])
    directions = np.array([[0, 0, 1], [0, 0, 1], [0, 1, 0], [0, 0, -1], [0, 0, 1.0]])
    segments = trace(Rays.from_lines(origins, directions), CUBE, tracer, midpoints=True)
    np.testing.assert_array_equal(np.diff(segments.ptr), [0, 4, 0, 0, 0])
    nothing = trace(Rays.from_lines(origins[2:], directions[2:]), CUBE, tracer, midpoints=True)
    assert len(nothing) == 0
    assert nothing.n_pixels == 3
    assert nothing.midpoint.shape == (0, 3)


@EVERY
def test_a_ray_ends_where_its_length_says(tracer):
    lengths = np.array([0, 1e-12, 0.3, 0.5, 0.75, 2.25, 50, np.inf])
    inside = CUBE.lower + np.array([0.25, 0.1, 0.1])
    segments = trace(Rays.from_lines(inside, [1, 0, 0], lengths), CUBE, tracer, dtype=np.float64)
    total = [segments.length[a:b].sum() for a, b in pairwise(segments.ptr)]
    np.testing.assert_allclose(total, np.minimum(lengths, 1.75), atol=1e-13)
    np.testing.assert_array_equal(np.diff(segments.ptr), [0, 1, 2, 2, 2, 4, 4, 4])


@EVERY
def test_segments_are_ordered_and_touch(tracer):
    rays = through(CUBE)
    segments = trace(rays, CUBE, tracer, midpoints=True, dtype=np.float64)
    for ray in range(len(rays)):
        own = segments.rows(ray, ray + 1)
        along = (own.midpoint + CUBE.center - rays.origins[ray]) @ rays.directions[ray]
        gaps = np.diff(along) - (own.length[:-1] + own.length[1:]) / 2
        np.testing.assert_allclose(gaps, 0, atol=1e-12)


@EVERY
@pytest.mark.parametrize("center", [(0, 0, 0), (1e6, -2e6, 5e5)])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_midpoints_lie_in_their_voxel_and_are_measured_from_the_center(tracer, center, dtype):
    grid = VoxelGrid((5, 7, 3), (0.5, 0.25, 1.0), center)
    segments = trace(through(grid), grid, tracer, midpoints=True, dtype=dtype)
    assert segments.midpoint.dtype == segments.length.dtype == dtype
    index = np.stack(np.unravel_index(segments.voxel, grid.shape), axis=1)
    middle = (index + 0.5 - np.array(grid.shape) / 2) * grid.spacing
    offset = np.abs(segments.midpoint - middle) / grid.spacing
    assert offset.max() <= 0.5 + 1e-6  # in single precision just as well far from the origin
    assert offset.max() > 0.45


@EVERY
def test_moving_rays_and_grid_together_changes_nothing(tracer):
    rays = through(CUBE)
    # Multiples of 2^-20, so that the shift itself does not round.
    coarse = np.round(rays.origins * 2**20) / 2**20
    shift = np.array([3.0, -17.5, 1024.0])
    here = trace(Rays.from_lines(coarse, rays.directions), CUBE, tracer, midpoints=True)
    moved = VoxelGrid(CUBE.shape, CUBE.spacing, shift + CUBE.center)
    there = trace(Rays.from_lines(coarse + shift, rays.directions), moved, tracer, midpoints=True)
    for name in ("ptr", "voxel", "length", "midpoint"):
        np.testing.assert_array_equal(getattr(there, name), getattr(here, name))


@EVERY
def test_axes_are_alike(tracer):
    """Turned by 90 degrees, mirrored or renamed: 48 symmetries of the axes, one answer."""
    grid = VoxelGrid((4, 3, 5), (0.5, 0.3, 0.7), (2, -1, 0.5))
    rays = through(grid, 60)
    before = dense(trace(rays, grid, tracer, dtype=np.float64), grid)
    assert np.count_nonzero(before) > 250
    for order, signs in product(permutations(range(3)), product([1, -1], repeat=3)):
        signs, order = np.array(signs), list(order)
        turned = VoxelGrid(
            np.array(grid.shape)[order],
            np.array(grid.spacing)[order],
            signs * np.array(grid.center)[order],
        )
        after = trace(
            Rays.from_lines(signs * rays.origins[:, order], signs * rays.directions[:, order]),
            turned, tracer, dtype=np.float64,
        )  # fmt: skip
        flipped = [1 + a for a in range(3) if signs[a] < 0]
        expected = np.flip(np.transpose(before, [0, *(1 + a for a in order)]), flipped)
        np.testing.assert_allclose(dense(after, turned), expected, atol=1e-12)


@EVERY
def test_rays_of_one_pixel_are_weighted_and_stand_together(tracer):
    single = through(CUBE, 6)
    weight = np.array([0.5, 0.5, 1, 0.25, 0.25, 0.5])
    ptr = np.array([0, 2, 2, 3, 6])
    rays = Rays(single.origins, single.directions, single.lengths, weight, ptr)
    whole = dense(trace(single, CUBE, tracer, dtype=np.float64), CUBE)
    grouped = dense(trace(rays, CUBE, tracer, dtype=np.float64), CUBE)
    weighted = weight[:, None, None, None] * whole
    for pixel in range(4):
        expected = weighted[ptr[pixel] : ptr[pixel + 1]].sum(axis=0)
        np.testing.assert_allclose(grouped[pixel], expected, atol=1e-12)


@EVERY
def test_voxel_numbers_beyond_2_to_the_31(tracer):
    grid = VoxelGrid((2000, 2000, 2000), 0.25)
    directions = np.array([[1, 0.9, 0.8], [-1, 0.2, 0.1], [0, 0, 1], [0.3, -1, 0.7]])
    points = np.array([[0, 0, 0], [40, 200, 240], [249.9, 249.9, 0], [200, 100, 100]])
    rays = Rays.from_lines(points - 900 * directions, directions)
    segments = trace(rays, grid, tracer, midpoints=True, dtype=np.float64)
    assert segments.voxel.dtype == np.int64
    assert segments.voxel.min() >= 0
    assert 2**31 < segments.voxel.max() < grid.size
    assert (segments.voxel > 2**31).mean() > 0.2
    sure = segments.length > 1e-6  # shorter ones: on which side the middle lies is rounding
    assert sure.mean() > 0.9
    index = np.floor(segments.midpoint / 0.25 + 1000).astype(np.int64)
    decoded = np.stack(np.unravel_index(segments.voxel, grid.shape), axis=1)
    np.testing.assert_array_equal(decoded[sure], index[sure])


def test_voxel_numbers_are_32_bit_as_long_as_they_fit():
    grid = VoxelGrid((1290, 1290, 1290), 1.0)  # 800 000 voxels fewer than 2^31
    for tracer in TRACERS:
        segments = trace(Rays.from_lines(grid.upper - 0.5, [1, 0, 0]), grid, tracer)
        assert segments.voxel.dtype == np.int32
        assert segments.voxel.tolist() == [grid.size - 1]


def test_an_unknown_tracer_is_named():
    with pytest.raises(ValueError, match="tracer: found 'siddon', expected one of march, raycast"):
        trace(through(CUBE), CUBE, "siddon")
