"""Projections of voxel means converge to line integrals, at the order that theory gives.

Let ``f`` be a smooth field, ``h`` the voxel size and ``x(t)`` a point on a ray of direction ``d``.
The voxel that ``x`` lies in, centre ``c``, holds the mean ``f(c) + O(h²)``, so that the projection
differs from the line integral by ::

    E = ∫ f(c(t)) - f(x(t)) dt + O(h²) = Σ_s l_s ∇f · (c_s - m_s) + O(h²)

with length ``l_s`` and midpoint ``m_s`` of every segment. Along each axis ``c - x`` is a sawtooth
of the position alone: ``(c - x)_i = -h S(x_i / h)``, ``S`` from -1/2 to 1/2 with period one and
the Fourier series ``S(u) = Σ_{m≠0} a_m exp(2πi m u)``, ``|a_m| = 1 / (2π |m|)``. Hence ::

    E = -h Σ_i Σ_m a_m exp(2πi m x_i(0) / h) φ_i(m d_i / h) + O(h²)

where ``φ_i`` is the Fourier transform of ``∂_i f`` along the ray. For a blob of width ``s`` it
falls like ``exp(-2 (π s q)²)``: only axes with ``|d_i|`` of the order of ``h / s`` contribute.

- A ray parallel to an axis has the same offset to the voxels' centres in every voxel: first order,
  and second when it runs through the centres.
- In any other fixed direction the offsets average out along the ray: ``O(h²)`` is left.
- Over isotropic random rays a share of the order of ``h`` is nearly parallel to a plane of axes
  and has an error of the order of ``h``: the root mean square falls like ``h^(3/2)``.
- Over a pixel one voxel wide or more ``S`` has mean zero: second order in every direction.

The voxel means here are exact, from the error function: no sampling error hides in the orders.
"""

import numpy as np
import pytest
from scipy.special import erf

from phantoms import GaussianBlobs
from tomo.grid import VoxelGrid
from tomo.operators import Projector
from tomo.rays import Rays
from tomo.trace import trace

BLOBS = GaussianBlobs(
    [[1.1, -0.7, 0.4], [-1.3, 0.9, -0.5], [0.2, 0.3, 1.2]], [1.1, 1.3, 0.9], [1, 0.7, 0.9]
)
BOX = 16.0  # at its faces less than 1e-6 of the blobs is left
SIZES = np.array([1, 1 / 2, 1 / 4, 1 / 8])


def voxel_means(grid):
    volume = np.zeros(grid.shape)
    for center, width, amplitude in zip(
        BLOBS.centers, BLOBS.widths, BLOBS.amplitudes, strict=True
    ):
        profiles = []
        for axis, middle, edge in zip(grid.axes(), center, grid.spacing, strict=True):
            below, above = ((axis + side * edge - middle) / width for side in (-0.5, 0.5))
            primitive = (erf(above / np.sqrt(2)) - erf(below / np.sqrt(2))) / 2
            profiles.append(primitive * np.sqrt(2 * np.pi) * width / edge)
        volume += amplitude * np.einsum("i,j,k->ijk", *profiles)
    return volume


@pytest.fixture(scope="module")
def volumes():
    """The voxel means for every voxel size: ``{size: (grid, volume)}``."""
    grids = [VoxelGrid((round(BOX / h),) * 3, h) for h in SIZES]
    return {h: (grid, voxel_means(grid)) for h, grid in zip(SIZES, grids, strict=True)}


def errors(volumes, h, points, direction):
    """Return projection minus line integral, for rays through ``points`` ``(N, 3)``."""
    direction = np.array(direction) / np.linalg.norm(direction, axis=-1, keepdims=True)
    origins = points - 40 * direction
    grid, volume = volumes[h]
    projector = Projector(trace(Rays.from_lines(origins, direction), grid, dtype=float), grid)
    return projector @ volume.ravel() - BLOBS.line_integral(origins, direction)


def rms(values):
    return np.sqrt(np.mean(values**2))


def order(error_at):
    """Return the slope of log error over log voxel size, by regression."""
    return np.polyfit(np.log2(SIZES), np.log2([error_at(h) for h in SIZES]), 1)[0]


def lattice(h, offset):
    """Return points near the middle, ``offset`` (2,) voxels from voxels' centres in y and z."""
    steps = (np.arange(-round(2 / h), round(2 / h)) + 0.5) * h
    y, z = np.meshgrid(steps + offset[0] * h, steps + offset[1] * h, indexing="ij")
    return np.stack([np.zeros(y.size), y.ravel(), z.ravel()], axis=1)


def test_a_ray_through_the_centres_is_second_order(volumes):
    found = order(lambda h: rms(errors(volumes, h, lattice(h, (0, 0)), [1, 0, 0])))
    assert found == pytest.approx(2, abs=0.06)


@pytest.mark.parametrize("offset", [(0.25, 0.25), (-0.4, 0.1), (0.0, 0.45)])
def test_an_axis_parallel_ray_beside_the_centres_is_first_order(volumes, offset):
    found = order(lambda h: rms(errors(volumes, h, lattice(h, offset), [1, 0, 0])))
    assert found == pytest.approx(1, abs=0.06)


@pytest.mark.parametrize("direction", [[1, 0.3, 0.2], [1, 0.7, -0.4], [0.5, 0.6, 0.7]])
def test_a_ray_in_a_generic_direction_is_second_order(volumes, direction):
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (3000, 3))
    found = order(lambda h: rms(errors(volumes, h, points, direction)))
    assert found == pytest.approx(2, abs=0.1)


def test_isotropic_random_rays_are_of_order_three_halves(volumes):
    rng = np.random.default_rng(0)
    points, directions = rng.uniform(-1.5, 1.5, (20_000, 3)), rng.standard_normal((20_000, 3))
    error = {h: rms(errors(volumes, h, points, directions)) for h in SIZES}
    local = np.diff(np.log2([error[h] for h in SIZES])) / np.diff(np.log2(SIZES))
    assert (np.diff(local) < 0).all()  # from 2, where all rays count, towards 3/2
    assert 1.45 < local[-1] < 1.65

    # What makes it three halves: away from the planes of the axes the order is two.
    slope = np.abs(directions / np.linalg.norm(directions, axis=1, keepdims=True)).min(axis=1)
    away = slope > 0.3
    assert 1000 < away.sum() < 10_000
    found = order(lambda h: rms(errors(volumes, h, points[away], directions[away])))
    assert found == pytest.approx(2, abs=0.1)


def pixel_errors(volumes, h, centres, direction, size, rays):
    """Return the errors of pixel means: ``rays`` x ``rays`` over squares of edge ``size``."""
    direction = np.array(direction) / np.linalg.norm(direction)
    right = np.cross(direction, [0, 0, 1])
    right /= np.linalg.norm(right)
    down = np.cross(direction, right)
    steps = ((np.arange(rays) + 0.5) / rays - 0.5) * size
    a, b = (s.reshape(-1, 1) for s in np.meshgrid(steps, steps))
    points = np.asarray(centres)[:, None] + a * right + b * down
    found = errors(volumes, h, points.reshape(-1, 3), direction)
    return found.reshape(len(centres), -1).mean(axis=1)


@pytest.mark.parametrize("offset", [(0.25, -0.25), (0.5, 0.5), (0.25, 0.0)])
def test_the_mean_over_a_pixel_one_voxel_wide_is_second_order(volumes, offset):
    """Along an axis, where single rays are first order; 8 rays resolve quarters of a voxel."""
    found = order(
        lambda h: rms(pixel_errors(volumes, h, lattice(h, offset)[::3], [1, 0, 0], h, 8))
    )
    assert found == pytest.approx(2, abs=0.1)


@pytest.mark.parametrize("direction", [[1, 0, 0], [1, 0.3, 0.2], [1, 0.02, 0.01], [0.3, 1, 0.5]])
def test_the_mean_over_a_pixel_many_voxels_wide_is_second_order(volumes, direction):
    # On sixteenths 48 rays fill every voxel evenly; else their own mean of S would not be zero.
    centres = np.random.default_rng(3).integers(-24, 25, (10, 3)) / 16
    found = order(lambda h: rms(pixel_errors(volumes, h, centres, direction, 1.0, 48)))
    assert found == pytest.approx(2, abs=0.2)
