"""Priors in arrays of other libraries: the maps that are compiled for NumPy's."""

import numpy as np
import pytest

from tomo._compute.reductions import dot
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.grid.blur import Blur
from tomo.priors import L1, Gradient, RelativeCurvature, TotalVariation

pytest.importorskip("array_api_compat")

GRID = VoxelGrid((6, 8, 7), (1.0, 0.3, 2.0))
CASES = [
    ActiveVoxels(GRID),
    ActiveVoxels.from_mask(GRID, np.random.default_rng(0).random(GRID.shape) < 0.3),
    ActiveVoxels(GRID, np.array([0, GRID.size - 1])),
    ActiveVoxels(VoxelGrid((1, 6, 1), 1.0), np.array([1, 3, 4])),
]
every_case = pytest.mark.parametrize("active", CASES, ids=str)


@pytest.fixture(params=["torch", "array_api_strict"])
def there(request):
    """Return a function that copies an array to another library."""
    library = pytest.importorskip(request.param)
    return lambda values: library.asarray(np.array(values))


def drawn(active, *columns, seed=0):
    return np.random.default_rng(seed).normal(size=(active.size, *columns)).astype(np.float32)


def alike(found, expected):
    found = np.asarray(found)
    assert found.dtype == expected.dtype
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6 * np.abs(expected).max())


def same(found, expected):
    found = np.asarray(found)
    assert found.dtype == expected.dtype
    assert np.array_equal(found, expected)


@every_case
def test_a_blur_has_the_bits_of_compiled_runs(there, active):
    values, both = drawn(active), drawn(active, 2)
    for width in (0.6, 3.0):
        blur = Blur(active, width)
        same(blur(there(values)), blur(values))
        same(blur(there(both)), np.stack([blur(one.copy()) for one in both.T], axis=1))


@every_case
@pytest.mark.parametrize("columns", [(), (3,)], ids=str)
def test_differences_pass_the_dot_test_and_give_the_same_second_differences(
    there, active, columns
):
    gradient, values = Gradient(active, *columns), drawn(active, *columns)
    field = gradient.forward(there(values))
    other = there(np.random.default_rng(1).normal(size=field.shape).astype(np.float32))
    back = gradient.adjoint(other)
    assert dot(field, other) == pytest.approx(
        dot(there(values), back), abs=1e-6 * (dot(field, field) * dot(other, other)) ** 0.5
    )
    same(gradient.adjoint(field), gradient.adjoint(gradient.forward(values)))


@every_case
@pytest.mark.parametrize("columns", [(), (2,)], ids=str)
def test_relative_curvature_has_the_weights_and_the_maps_of_compiled_runs(there, active, columns):
    bright, values = np.abs(drawn(active, *columns)), drawn(active, *columns, seed=1)
    own, other = RelativeCurvature(active, bright), RelativeCurvature(active, there(bright))
    same(other.weights, own.weights)
    same(other.forward(there(values)), own.forward(values))
    same(other.adjoint(there(values)), own.adjoint(values))
    dark = RelativeCurvature(active, there(np.zeros_like(bright)))
    assert np.array_equal(np.asarray(dark.weights), np.ones_like(bright))


@every_case
@pytest.mark.parametrize("nonnegative", [True, False])
@pytest.mark.parametrize("prior", [TotalVariation, L1])
def test_proximal_maps_are_the_compiled_ones_and_keep_their_state(
    there, active, prior, nonnegative
):
    center, inverse = drawn(active), np.abs(drawn(active, seed=1))
    inverse[::3] = 0  # voxels that nothing sees stay as they are
    own = prior(active).proximal_map(inverse, nonnegative)
    other = prior(active).proximal_map(there(inverse), nonnegative)
    for weight, steps, stretch in ((0.3, 6, 1.0), (0.3, 3, 1.4)):
        how = weight, steps, stretch
        alike(other(there(center), *how), own(center, *how))
    assert prior(active).value(there(center)) == pytest.approx(prior(active).value(center))
