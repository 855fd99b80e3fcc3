"""Properties of every phantom."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import phantoms
from phantoms import (  # noqa: F401
    GaussianBlobs,
    JetFlame,
    Plume,
    RandomHomogeneous,
    TurbulentFlame,
)
from tomo.grid import VoxelGrid

NAMES = ("blobs", "homogeneous", "jet", "plume", "turbulent")
EXTENT = np.array([15.0, 70.0, 15.0])


@pytest.fixture(scope="module")
def points():
    return (np.random.default_rng(5).random((20000, 3)) - 0.5) * EXTENT


def test_names():
    assert phantoms.names() == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_is_nonnegative_lit_and_bounded(name, points):
    values = phantoms.create(name)(points)
    assert values.dtype == np.float64
    assert values.min() >= 0
    assert 0.5 < values.max() < 1.5


@pytest.mark.parametrize("name", NAMES)
def test_is_dark_at_the_faces_and_outside(name, points):
    field = phantoms.create(name, seed=2)
    for axis in range(3):
        for side in (-0.5, 0.5):
            face = points.copy()
            face[:, axis] = side * EXTENT[axis]
            assert field(face).max() < 1e-6
            face[:, axis] *= 1.5
            assert field(face).max() < 1e-6


@pytest.mark.parametrize("name", ["jet", "plume", "turbulent"])
def test_flames_fade_continuously_towards_the_faces(name, points):
    """No jump anywhere: the greatest change over a step shrinks in proportion to the step."""
    field = phantoms.create(name)
    base = field(points)
    steps = [0.02, 0.01, 0.005]
    changes = [
        max(np.abs(field(points + step * np.eye(3)[axis]) - base).max() for axis in range(3))
        for step in steps
    ]
    assert changes[0] < 0.06  # less than 3 a millimetre: no front thinner than a voxel
    assert changes[1] / changes[0] == pytest.approx(0.5, abs=0.05)
    assert changes[2] / changes[1] == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("name", ["jet", "plume", "turbulent"])
def test_flames_are_exactly_dark_in_a_good_part_of_the_box(name, points):
    dark = (phantoms.create(name)(points) == 0).mean()
    assert 0.4 < dark < 0.9


@pytest.mark.parametrize("name", NAMES)
def test_seed_decides(name, points):
    first, again, other = (phantoms.create(name, seed=seed) for seed in (7, 7, 8))
    assert first == again
    assert first != other
    np.testing.assert_array_equal(first(points), again(points))
    assert np.abs(first(points) - other(points)).max() > 0.01


@pytest.mark.parametrize("name", NAMES)
def test_repr_makes_an_equal_value_that_can_be_a_key(name):
    field = phantoms.create(name, seed=3, extent=(2, 5, 3), center=(1, 0, -1))
    assert eval(repr(field)) == field
    assert {field: 1}[eval(repr(field))] == 1


@given(
    scale=st.floats(1e-3, 1e3),
    x=st.floats(-50, 50),
    y=st.floats(-50, 50),
    name=st.sampled_from(NAMES),
)
def test_a_scaled_and_moved_box_holds_the_same_field(scale, x, y, name):
    unit = np.random.default_rng(1).random((200, 3)) - 0.5
    # Points off the faces of the homogeneous phantom's cells, where rounding may choose a side.
    unit = (np.floor(unit * [15, 70, 15]) + 0.25) / [15, 70, 15]
    center = np.array([x, y, x - y]) * scale
    field = phantoms.create(name, 1, extent=EXTENT * scale, center=center)
    np.testing.assert_allclose(
        field(center + unit * EXTENT * scale),
        phantoms.create(name, 1)(unit * EXTENT),
        atol=1e-9,
    )


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shape", [(), (1,), (0,), (3, 1, 4)])
def test_any_shape_of_points(name, shape):
    field = phantoms.create(name)
    rng = np.random.default_rng(0)
    points = rng.normal(size=(*shape, 3))
    values = field(points)
    assert np.shape(values) == shape
    np.testing.assert_allclose(np.ravel(values), field(points.reshape(-1, 3)), atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"name": "candle"}, "phantom: found 'candle', expected one of blobs, homogeneous"),
        ({"name": "jet", "seed": -1}, "seed: found -1"),
        ({"name": "turbulent", "seed": 1.5}, "seed: found 1.5"),
        ({"name": "blobs", "extent": (1, 2)}, "extent: found"),
        ({"name": "jet", "extent": (1, 0, 1)}, "extent: found"),
        ({"name": "homogeneous", "center": (0, 0, np.nan)}, "center: found"),
    ],
)
def test_says_what_is_wrong(arguments, words):
    with pytest.raises(ValueError, match=words) as caught:
        phantoms.create(**arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", NAMES)
def test_points_need_three_coordinates(name):
    with pytest.raises(ValueError, match=r"points: found shape \(4, 2\)"):
        phantoms.create(name)(np.zeros((4, 2)))


def test_the_paper_s_grid_holds_the_random_homogeneous_set_exactly():
    field = phantoms.create("homogeneous")
    grid = VoxelGrid((30, 140, 30), 0.5)
    np.testing.assert_array_equal(phantoms.sample(field, grid, 2), phantoms.sample(field, grid))


def test_random_homogeneous_is_alike_everywhere_and_uncorrelated():
    volume = phantoms.sample(RandomHomogeneous(seed=4), VoxelGrid((15, 70, 15), 1.0))
    inner = volume[1:-1, 1:-1, 1:-1].astype(float)
    assert (volume > 0).sum() == inner.size
    halves = inner[:, :34], inner[:, 34:]
    for half in halves:  # a uniform distribution has mean 1/2 and variance 1/12
        assert half.mean() == pytest.approx(0.5, abs=5 / np.sqrt(12 * half.size))
        assert half.var() == pytest.approx(1 / 12, rel=0.05)
    neighbours = np.corrcoef(inner[:, 1:].ravel(), inner[:, :-1].ravel())[0, 1]
    assert abs(neighbours) < 5 / np.sqrt(inner.size)


def test_random_homogeneous_needs_cells_inside_its_dark_layer():
    with pytest.raises(ValueError, match=r"cells: found \(2, 5, 5\)"):
        RandomHomogeneous(cells=(2, 5, 5))


def test_import_loads_nothing_heavy():
    code = (
        "import sys, phantoms; heavy = {'scipy', 'numba', 'torch', 'matplotlib', 'skimage'};"
        "phantoms.create('turbulent')([[0.0, 0.0, 0.0]]); print(sorted(heavy & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "[]", result.stderr
