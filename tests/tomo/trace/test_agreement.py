"""Three tracers, one answer: on every rig preset, and exactly; at the worst in test_extremes.

``reference`` is the oracle of the other two, and rational arithmetic is the oracle of all three.
"""

from fractions import Fraction
from itertools import pairwise
from math import ceil, floor

import numpy as np
import pytest
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st

import rigs
from tomo.grid import VoxelGrid
from tomo.rays import Rays
from tomo.trace import TRACERS, trace

TOLERANCE = 1e-5  # voxel edges


def lines(points, directions, distance, lengths=np.inf):
    """Return rays through ``points`` that start ``distance`` before them."""
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return Rays.from_lines(
        points - directions * np.reshape(distance, (-1, 1)), directions, lengths
    )


def matrix(segments, grid):
    """Return the lengths as rays times voxels, pieces in one voxel summed."""
    return scipy.sparse.csr_array(
        (segments.length.copy(), segments.voxel.astype(np.int64), segments.ptr.copy()),
        shape=(segments.n_pixels, grid.size),
    )


def chord(rays, grid, outward):
    """Return the length of each ray in the box whose faces move ``outward`` (rays,) voxels.

    In extended precision and in world coordinates, which no tracer uses.
    """
    origin, direction = rays.origins.astype(np.longdouble), rays.directions.astype(np.longdouble)
    margin = outward[:, None] * np.longdouble(grid.spacing)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ends = np.stack([grid.lower - margin - origin, grid.upper + margin - origin]) / direction
    between = (origin >= grid.lower - margin) & (origin <= grid.upper + margin)
    parallel = direction == 0
    near = np.where(parallel, np.where(between, -np.inf, np.inf), ends.min(axis=0))
    far = np.where(parallel, np.where(between, np.inf, -np.inf), ends.max(axis=0))
    start = np.maximum(near.max(axis=1), 0)
    return np.maximum(np.minimum(far.min(axis=1), rays.lengths) - start, 0).astype(float)


def assert_all_agree(rays, grid):
    edge = min(grid.spacing)
    found = {name: matrix(trace(rays, grid, name, dtype=np.float64), grid) for name in TRACERS}
    oracle = found.pop("reference")
    for name, other in found.items():
        difference = abs(other - oracle)
        assert difference.nnz == 0 or difference.max() < TOLERANCE * edge, name
        assert ((other > TOLERANCE * edge) != (oracle > TOLERANCE * edge)).nnz == 0, name

    # An origin is rounded to its last bit: the faces may seem to be that much further in or out.
    reach = np.abs(rays.origins).max(axis=1) + np.abs([grid.lower, grid.upper]).max()
    rounding = 4 * np.finfo(float).eps * reach / edge
    total = oracle.sum(axis=1)
    assert (total <= chord(rays, grid, rounding) + TOLERANCE * edge).all()
    assert (total >= chord(rays, grid, -rounding) - TOLERANCE * edge).all()
    return total


@pytest.mark.parametrize("name", rigs.preset_names())
def test_tracers_agree_on_every_preset(name):
    rig = rigs.preset(name)
    grid = VoxelGrid(rig.volume.shape, rig.volume.spacing, rig.volume.center)
    pixels = np.arange(0, np.prod(rig[0].image_size), 199)
    total = assert_all_agree(
        Rays.concatenate(Rays.from_camera(camera, pixels) for camera in rig), grid
    )
    assert (total > 0).mean() > 0.5


def exact_lengths(origin, direction, length, grid):
    """Return ``{voxel: length}`` of one ray by Siddon's algorithm in rational numbers."""
    lower = [Fraction(v) for v in grid.lower]
    position = [
        (Fraction(o) - low) / Fraction(s)
        for o, low, s in zip(origin, lower, grid.spacing, strict=True)
    ]
    speed = [Fraction(d) / Fraction(s) for d, s in zip(direction, grid.spacing, strict=True)]
    start, stop = Fraction(0), None if np.isinf(length) else Fraction(length)
    for p, v, n in zip(position, speed, grid.shape, strict=True):
        if v == 0:
            if not 0 <= p <= n:
                return {}
            continue
        low, high = sorted((-p / v, (n - p) / v))
        start, stop = max(start, low), high if stop is None else min(stop, high)
    if stop <= start:
        return {}
    cuts = {start, stop}
    for p, v, n in zip(position, speed, grid.shape, strict=True):
        if v != 0:
            ends = sorted((p + v * start, p + v * stop))
            planes = range(ceil(ends[0]), min(floor(ends[1]), n) + 1)
            cuts |= {(k - p) / v for k in planes if start < (k - p) / v < stop}
    cuts = sorted(cuts)
    lengths = {}
    for here, there in pairwise(cuts):
        middle = [p + v * (here + there) / 2 for p, v in zip(position, speed, strict=True)]
        index = [min(floor(m), n - 1) for m, n in zip(middle, grid.shape, strict=True)]
        lengths[int(np.ravel_multi_index(index, grid.shape))] = float(there - here)
    return lengths


eighths = st.integers(-80, 80).map(lambda k: k / 8)
coordinates = st.one_of(eighths, st.floats(-10, 10, width=32))
components = st.one_of(st.integers(-6, 6).map(float), st.sampled_from([0.0, 5e-324, -1e-310]))


@settings(max_examples=500)
@given(
    shape=st.tuples(*[st.integers(1, 6)] * 3),
    spacing=st.tuples(*[st.sampled_from([0.25, 0.5, 1.0, 1.5, 3.0])] * 3),
    center=st.tuples(eighths, eighths, eighths),
    origin=st.tuples(coordinates, coordinates, coordinates),
    direction=st.tuples(components, components, components).filter(lambda d: np.abs(d).max() >= 1),
    length=st.one_of(st.just(np.inf), st.floats(0, 20)),
    distance=st.sampled_from([0, 0, 8, 1e7]),
)
def test_every_tracer_is_exact(shape, spacing, center, origin, direction, length, distance):
    grid = VoxelGrid(shape, spacing, center)
    # Aimed at the grid, or most rays would miss it; from where planes and rounding are far apart.
    origin = np.round(2**12 * (np.array(origin) / 10 * grid.extent + center)) / 2**12
    rays = lines(np.array([origin]), np.array([direction]), distance, length + distance)
    exact = exact_lengths(rays.origins[0], rays.directions[0], rays.lengths[0], grid)
    assert sum(exact.values()) == pytest.approx(
        chord(rays, grid, np.zeros(1))[0], abs=1e-12 + 1e-15 * distance
    )
    subnormal = np.any((rays.directions != 0) & (np.abs(rays.directions) < 1e-300))
    expected = np.zeros(grid.size)
    expected[list(exact)] = list(exact.values())
    for name in TRACERS:
        lengths = matrix(trace(rays, grid, name, dtype=np.float64), grid).toarray()[0]
        error = TOLERANCE * 1e-4 * (1 + distance / 1e3)
        if subnormal:  # which of two sides of a plane it runs along is below rounding
            assert lengths.sum() == pytest.approx(expected.sum(), abs=error), name
        else:
            np.testing.assert_allclose(lengths, expected, rtol=0, atol=error, err_msg=name)
