"""The penalty on relative curvature: its parts, its minimum, and what it is for."""

import numpy as np
import pytest
import scipy.optimize
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter

import phantoms
import rigs
from tomo import metrics, solvers
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import LinearSystem, voxel_means
from tomo.priors.curvature import AROUND, DARKEST, RelativeCurvature
from tomo.priors.differences import Gradient
from tomo.simulation import camera_noise, simulate_images
from tomo.solvers.curvature import FIRST

LIVE = ActiveVoxels(VoxelGrid((5, 6, 4), (1.0, 0.8, 1.3)))


def twin(active, volume, values):
    """Return ``C x`` by differences over the whole grid, in double precision."""
    shape, spacing = active.grid.shape, np.array(active.grid.spacing)
    light = active.expand(np.maximum(volume, 0).astype(float)).reshape(shape)
    brightness = gaussian_filter(light, AROUND, mode="constant", truncate=3.0)
    brightness = active.compress(brightness.ravel())
    weights = 1 / (brightness / brightness.max() + DARKEST)
    weights /= np.sqrt(np.sum(weights**2 * brightness) / brightness.sum())
    x = active.expand(values.astype(float)).reshape(shape)
    second = np.zeros(shape)
    for axis, factor in enumerate(np.cbrt(spacing.prod()) / spacing):
        step = np.diff(x, axis=axis) * factor**2
        ahead, behind = [(0, 0)] * 3, [(0, 0)] * 3
        ahead[axis], behind[axis] = (0, 1), (1, 0)
        second += np.pad(step, behind) - np.pad(step, ahead)
    return weights * active.compress(second.ravel())


def some_live(holes):
    mask = np.random.default_rng(4).random(LIVE.grid.shape) < (0.7 if holes else 2.0)
    return ActiveVoxels.from_mask(LIVE.grid, mask)


def dense(penalty, count):
    return np.array([penalty.forward(row) for row in np.eye(count, dtype=np.float32)]).T


@pytest.fixture(scope="module")
def system_on(projector_of):
    """Return a function: active voxels to a projector onto noisy pixels, its matrix, and them.

    Half the voxels are dark.
    """

    def make(active, pixels, seed=0):
        random = np.random.default_rng(seed)
        matrix = random.uniform(0.2, 1.5, (pixels, active.size))
        matrix *= random.random(matrix.shape) < 0.2
        projector = projector_of(matrix, active=active)
        truth = np.maximum(random.normal(0, 1, active.size), 0)
        measured = (matrix @ truth + random.normal(0, 0.5, pixels)).astype(np.float32)
        return projector, matrix.astype(np.float32).astype(float), measured

    return make


@pytest.mark.parametrize("holes", [False, True])
def test_it_is_the_second_differences_over_the_brightness(holes):
    active, random = some_live(holes), np.random.default_rng(0)
    volume = random.standard_normal(active.size).astype(np.float32)
    penalty = RelativeCurvature(active, volume)
    values = random.standard_normal(active.size).astype(np.float32)
    assert_allclose(
        penalty.forward(values), twin(active, volume, values), rtol=1e-4, atol=1e-5 * values.max()
    )
    other = random.standard_normal(active.size).astype(np.float32)
    forward = np.dot(penalty.forward(values).astype(float), other)
    adjoint = np.dot(penalty.adjoint(other).astype(float), values)
    size = np.linalg.norm(penalty.forward(values)) * np.linalg.norm(other)
    assert abs(forward - adjoint) < 1e-6 * size


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize("nonnegative", [True, False])
def test_it_finds_the_minimum(system_on, holes, nonnegative):
    active = some_live(holes)
    projector, matrix, measured = system_on(active, 150)
    strength, weights = 3e-3, np.random.default_rng(1).uniform(0.1, 3, len(measured))
    start = np.random.default_rng(2).uniform(0, 1, active.size).astype(np.float32)
    found = solvers.curvature(
        projector, measured, strength=strength, iterations=400, weights=weights, start=start,
        nonnegative=nonnegative,
    )  # fmt: skip
    root = np.sqrt(weights)
    weighted = root[:, None] * matrix
    factor = (weighted.T @ (weighted @ np.ones(active.size))).max()
    rough = np.sqrt(strength * factor) * dense(RelativeCurvature(active, start), active.size)
    rows = np.vstack([weighted, rough])
    target = np.concatenate([root * measured, np.zeros(active.size)])
    lowest = 0 if nonnegative else -np.inf
    expected = scipy.optimize.lsq_linear(rows, target, (lowest, np.inf), tol=1e-14).x
    assert_allclose(active.compress(found.volume), expected, atol=1e-4)
    assert (expected.min() < -0.01) != nonnegative


def test_the_first_iterations_have_a_penalty_on_differences_and_show_where_it_is_bright(system_on):
    projector, _, measured = system_on(LIVE, 150)
    volumes, misfits = [], []

    def keep(_index, volume, misfit):
        volumes.append(volume.copy())
        misfits.append(misfit)

    found = solvers.curvature(
        projector, measured, strength=0.01, iterations=FIRST + 3, callback=keep
    )
    differences = solvers.tikhonov(projector, measured, strength=0.001, iterations=FIRST)
    np.testing.assert_array_equal(volumes[FIRST], differences.volume.ravel())
    assert len(volumes) == len(found.history) == FIRST + 4
    onwards = solvers.curvature(
        projector, measured, strength=0.01, iterations=3, start=differences.volume
    )
    np.testing.assert_array_equal(found.volume, onwards.volume)
    assert misfits[-3:] == [line.relative_residual for line in onwards.history[1:]]


def test_without_strength_it_is_non_negative_least_squares(system_on):
    projector, matrix, measured = system_on(LIVE, 150)
    found = solvers.curvature(projector, measured, strength=0.0, iterations=400)
    expected, _ = scipy.optimize.nnls(matrix, measured.astype(float))
    assert_allclose(found.volume.ravel(), expected, atol=1e-4)


def test_a_steady_slope_costs_nothing_inside():
    active = ActiveVoxels(VoxelGrid((9, 8, 7), (1.0, 2.0, 0.5)))
    x, y, z = np.moveaxis(active.grid.centers(), -1, 0)
    slope = (x - 0.5 * y + 2 * z + 20).astype(np.float32)
    curved = RelativeCurvature(active, slope.ravel()).forward(slope.ravel())
    inside = curved.reshape(active.grid.shape)[1:-1, 1:-1, 1:-1]
    assert np.abs(inside).max() < 1e-4
    assert Gradient(active).forward(slope.ravel()).max() > 0.4


@pytest.mark.parametrize("seed", [0, 1])
def test_few_noisy_views_of_smooth_light_come_nearer_than_by_differences(seed):
    """Both in the linear basis, each with the best strength and number of iterations."""
    grid, random = VoxelGrid((16, 16, 16), 1.0), np.random.default_rng(seed)
    rig = rigs.ring(9, distance=300.0, image_size=(48, 40), footprint=0.5, pitch_degrees=12.0)
    field = phantoms.GaussianBlobs(
        random.uniform(-4, 4, (14, 3)), random.uniform(1.2, 2.2, 14), random.uniform(0.3, 1, 14)
    )
    scan = simulate_images(rig, field, grid, supersample=3, refine=3)
    images = camera_noise.gaussian(list(scan.images.values()), 0.02, random)
    system = LinearSystem.from_rig(rig, grid)
    measured, linear = system.flatten(images), system.with_linear_basis().projector

    def nearest(method):
        distances = []

        def judge(_index, volume, _residual):
            found = voxel_means(linear.active.expand(volume).reshape(grid.shape))
            distances.append(metrics.cosine_distance(found, scan.truth) if volume.any() else 1.0)

        for strength in (1e-4, 3e-4, 1e-3, 3e-3):
            getattr(solvers, method)(
                linear, measured, strength=strength, iterations=40, callback=judge
            )
        return min(distances)

    assert nearest("curvature") < 0.6 * nearest("tikhonov")
