import itertools

import numpy as np
import pytest

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.priors.differences import Gradient
from tomo.priors.total_variation import TotalVariation


def _with_a_hole(shape, seed=0):
    mask = np.zeros(shape, bool)
    mask[1:-1, 2:, 1:-2] = True
    mask[2, 3:5, 2] = False
    mask &= np.random.default_rng(seed).random(shape) < 0.9
    return mask


def gradient_twin(active, values):
    """Return the differences over the whole grid, voxel by voxel in double precision."""
    volume = active.expand(values.astype(np.float64)).reshape(active.grid.shape)
    spacing = np.array(active.grid.spacing)
    factors = np.cbrt(spacing.prod()) / spacing
    field = np.zeros((*volume.shape, 3))
    for voxel in itertools.product(*map(range, volume.shape)):
        for axis in range(3):
            beyond = list(voxel)
            beyond[axis] += 1
            if beyond[axis] < volume.shape[axis]:
                field[*voxel, axis] = factors[axis] * (volume[*beyond] - volume[voxel])
    return field


CASES = [
    ActiveVoxels(VoxelGrid((4, 5, 3), 0.5)),
    ActiveVoxels(VoxelGrid((4, 5, 3), (0.5, 1.0, 2.0))),
    ActiveVoxels(VoxelGrid((1, 6, 1), 1.0)),
    ActiveVoxels.from_mask(VoxelGrid((6, 8, 7), 1.0), _with_a_hole((6, 8, 7))),
    ActiveVoxels.from_mask(VoxelGrid((6, 8, 7), (1.0, 0.3, 2.0)), _with_a_hole((6, 8, 7), 1)),
    ActiveVoxels.from_mask(VoxelGrid((3, 3, 3), 1.0), np.zeros((3, 3, 3), bool)),
    ActiveVoxels(VoxelGrid((5, 6, 7), 1.0), np.array([0, 209])),  # two opposite corners
    ActiveVoxels(VoxelGrid((5, 6, 7), 1.0), np.array([123])),
]
every_case = pytest.mark.parametrize("active", CASES, ids=str)


@every_case
def test_differences_are_those_of_the_whole_grid(active):
    values = np.random.default_rng(0).standard_normal(active.size).astype(np.float32)
    twin = gradient_twin(active, values)
    found = Gradient(active).forward(values)
    # What lies outside the lines around the active voxels is zero, so sums and norms agree
    assert np.abs(found).sum() == pytest.approx(np.abs(twin).sum(), rel=1e-5)
    expected = np.sqrt((twin**2).sum(axis=-1)).sum()
    assert TotalVariation(active).value(values) == pytest.approx(expected, rel=1e-6)
    if active.all:
        twin = np.moveaxis(twin, -1, 0).reshape(3, -1)
        np.testing.assert_allclose(found, twin, rtol=1e-5, atol=1e-6)


@every_case
def test_the_adjoint_is_the_exact_transpose(active):
    gradient, random = Gradient(active), np.random.default_rng(0)
    columns = np.array([gradient.forward(row).ravel() for row in np.eye(active.size, dtype="f4")])
    rows = []
    for number in range(columns.shape[1] if active.size else 0):
        field = np.zeros(columns.shape[1], np.float32)
        field[number] = 1
        rows.append(gradient.adjoint(field))
    if active.size:
        np.testing.assert_array_equal(columns, np.array(rows).T)
    field = random.standard_normal(gradient.shape).astype(np.float32)
    assert gradient.adjoint(field).shape == (active.size,)


def test_a_constant_is_smooth_on_the_whole_grid_and_has_a_surface_inside_it():
    grid = VoxelGrid((8, 9, 10), 1.0)
    everywhere = TotalVariation(ActiveVoxels(grid))
    assert everywhere.value(np.full(grid.size, 2.5, np.float32)) == 0
    mask = np.zeros(grid.shape, bool)
    a, b, c = 3, 4, 5
    mask[2 : 2 + a, 2 : 2 + b, 2 : 2 + c] = True
    patch = np.full(a * b * c, 2.5, np.float32)
    # Forward differences meet at the three upper edges of the box and at its upper corner
    faces = 2 * (a * b + b * c + c * a)
    edges, corner = (a - 1) + (b - 1) + (c - 1), 1
    expected = 2.5 * (faces - 2 * edges - 3 * corner + np.sqrt(2) * edges + np.sqrt(3) * corner)
    patched = TotalVariation(ActiveVoxels.from_mask(grid, mask))
    assert patched.value(patch) == pytest.approx(expected, rel=1e-6)
    whole = mask.astype(np.float32).ravel() * np.float32(2.5)
    assert everywhere.value(whole) == pytest.approx(expected, rel=1e-6)


def test_a_hole_in_the_active_voxels_is_a_surface():
    grid = VoxelGrid((7, 7, 7), 1.0)
    mask = np.ones(grid.shape, bool)
    mask[3, 3, 3] = False
    variation = TotalVariation(ActiveVoxels.from_mask(grid, mask))
    found = variation.value(np.ones(grid.size - 1, np.float32))
    assert found == pytest.approx(3 + np.sqrt(3), rel=1e-6)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_proximal_map_of_a_step_moves_its_two_sides_together(axis):
    shape = [1, 1, 1]
    shape[axis] = 10
    active = ActiveVoxels(VoxelGrid(tuple(shape), 1.0))
    variation = TotalVariation(active).proximal_map(np.ones(10, np.float32), nonnegative=True)
    step = np.repeat(np.float32([1, 3]), (4, 6))
    # In one dimension each side moves by weight / length
    found = variation(step, 0.6, 400)
    np.testing.assert_allclose(found, np.repeat([1.15, 2.9], (4, 6)), atol=1e-4)
    strong = TotalVariation(active).proximal_map(np.ones(10, np.float32), nonnegative=True)
    np.testing.assert_allclose(strong(step, 100.0, 2000), np.full(10, 2.2), atol=1e-3)


def proximal_twin(active, center, inverse, weight, lowest, steps=20000):
    """Return the proximal map by fast projected gradients on the dual, dense and in double."""
    matrix = np.array([gradient_twin(active, row).ravel() for row in np.eye(active.size)]).T
    dual = ahead = np.zeros(matrix.shape[0])
    bound = np.linalg.norm(matrix * np.sqrt(inverse), 2) ** 2
    for number in range(steps):
        volume = np.maximum(center - inverse * (matrix.T @ ahead), lowest)
        raised = (ahead + matrix @ volume / bound).reshape(-1, 3)
        lengths = np.linalg.norm(raised, axis=1, keepdims=True)
        raised = (raised / np.maximum(lengths / weight, 1)).ravel()
        dual, ahead = raised, raised + number / (number + 3) * (raised - dual)
    return np.maximum(center - inverse * (matrix.T @ dual), lowest)


@pytest.mark.parametrize("active", [CASES[1], CASES[4]], ids=str)
@pytest.mark.parametrize("nonnegative", [True, False])
def test_the_proximal_map_is_that_of_the_dense_twin(active, nonnegative):
    random = np.random.default_rng(3)
    center = random.normal(0.5, 1, active.size)
    inverse = random.uniform(0.1, 2, active.size)
    variation = TotalVariation(active).proximal_map(inverse.astype(np.float32), nonnegative)
    found = variation(center.astype(np.float32), 0.3, 2000)
    expected = proximal_twin(active, center, inverse, 0.3, 0 if nonnegative else -np.inf, 5000)
    np.testing.assert_allclose(found, expected, atol=2e-4)
    again = variation(center.astype(np.float32), 0.3, 1)  # the dual field was kept
    np.testing.assert_allclose(again, found, atol=1e-4)


@every_case
@pytest.mark.parametrize("columns", [2, 5])
def test_volumes_side_by_side_have_the_differences_of_each(active, columns):
    random = np.random.default_rng(3)
    values = random.standard_normal((active.size, columns)).astype(np.float32)
    one, several = Gradient(active), Gradient(active, columns)
    found = several.adjoint(several.forward(values))
    assert found.shape == values.shape
    for column, alone in enumerate(values.T):
        expected = one.adjoint(one.forward(alone))
        np.testing.assert_allclose(found[:, column], expected, rtol=1e-5, atol=1e-5)
