"""Rays in voxels of the refractive index: the solver of another method, orders, the way back."""

import numpy as np
import pytest

from rigs.scene.gas import IndexField, IndexVolume

WIDTH, MIDDLE = 0.3, np.array([0.1, 0.0, -0.05])


def bump(points):
    """Return a warm core that is nothing, with three derivatives, at the faces of [-1, 1]³."""
    core = np.exp(-((points - MIDDLE) ** 2).sum(axis=-1) / (2 * WIDTH**2))
    return core * np.prod(np.cos(np.pi * points / 2) ** 4, axis=-1)


class Warm(IndexField):
    """``n = 1 + strength * bump``, in closed form."""

    lower, upper = np.full(3, -1.0), np.full(3, 1.0)

    def __init__(self, strength):
        self.strength = strength

    def index(self, points):
        return 1 + self.strength * bump(points)

    def gradient(self, points):
        slope = -(points - MIDDLE) / WIDTH**2 - 2 * np.pi * np.tan(np.pi * points / 2)
        return self.strength * bump(points)[:, None] * slope


def volume(count, strength):
    edges = np.array([2.0, 2.0, 2.0]) / count
    axes = [(np.arange(n) + 0.5) * edge - 1 for n, edge in zip(count, edges, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return IndexVolume(1 + strength * bump(points), np.full(3, -1.0), edges)


def rays(count, seed=0):
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(count, 3))
    origins *= 3 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = rng.uniform(-0.3, 0.3, (count, 3)) - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


NOISE = IndexVolume(
    1 + 0.3 * np.random.default_rng(3).random((6, 5, 4)), (-1.0, -0.5, 0.0), (0.3, 0.25, 0.4)
)


@pytest.mark.parametrize("field", [volume((9, 7, 10), 0.2), NOISE], ids=["warm", "noise"])
def test_the_compiled_steps_follow_the_spline_as_another_method_does(field):
    origins, directions = rays(2, 1)
    middle = (field.lower + field.upper) / 2
    fast = field.cross(origins + middle, directions)
    slow = IndexField.cross(field, origins + middle, directions)
    np.testing.assert_allclose(fast.exit_origins, slow.exit_origins, atol=2e-6)
    np.testing.assert_allclose(fast.exit_directions, slow.exit_directions, atol=2e-6)
    assert np.abs(slow.exit_directions - directions).max() > 0.01


def test_the_spline_passes_through_its_values_and_is_the_medium_at_the_faces():
    rng = np.random.default_rng(4)
    field = IndexVolume(1.4 + 0.1 * rng.random((5, 4, 1)), (1, 2, 3), (0.5, 0.3, 0.7), 1.33)
    axes = [
        field.lower[a] + (np.arange(n) + 0.5) * field.spacing[a] for a, n in enumerate((5, 4, 1))
    ]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(field.index(centres), field.values.ravel(), rtol=1e-12)
    face = rng.uniform(field.lower, field.upper, (20, 3))
    face[:10, 0], face[10:, 2] = field.lower[0], field.upper[2]
    np.testing.assert_allclose(field.index(face), 1.33, rtol=1e-12)
    points = rng.uniform(field.lower, field.upper, (20, 3))
    step = 1e-5 * np.eye(3)
    sides = np.stack(
        [(field.index(points + s) - field.index(points - s)) / 2e-5 for s in step], axis=-1
    )
    np.testing.assert_allclose(field.gradient(points), sides, atol=1e-6)


@pytest.mark.parametrize("strength", [3e-4, 0.2])
def test_paths_converge_to_the_closed_form_at_the_order_of_the_spline(strength):
    origins, directions = rays(8)
    exact = Warm(strength).cross(origins, directions)
    errors = []
    for count in (16, 32, 64):
        found = volume((count,) * 3, strength).cross(origins, directions)
        errors.append(np.linalg.norm(found.exit_directions - exact.exit_directions, axis=1))
    first, second, third = (np.sqrt((one**2).mean()) for one in errors)
    assert min(first / second, second / third) > 10  # 16: order 4
    assert third < 2e-5 * strength


@pytest.mark.parametrize("field", [volume((24, 24, 24), 3e-4), volume((24, 24, 24), 0.2), NOISE])
def test_a_ray_sent_back_retraces_its_way_to_rounding(field):
    origins, directions = rays(400, 2)
    middle = (field.lower + field.upper) / 2
    there = field.cross(origins + middle, directions)
    met = np.diff(there.ptr) > 0
    back = field.cross(there.exit_origins, -there.exit_directions)
    start = there.origins[there.ptr[:-1][met]]
    lengths = np.add.reduceat(there.lengths, there.ptr[:-1][met])
    missed = np.linalg.norm(back.exit_origins[met] - start, axis=1)
    assert met.sum() > 300
    assert not there.trapped.any()
    assert (missed < 1e-9 * lengths).all()


def test_rays_along_planes_edges_and_faces_of_voxels_come_through():
    field = volume((8, 8, 8), 0.1)
    at = np.linspace(-0.875, 0.875, 15)  # centres, where the spline has knots, and faces between
    x, y = (one.ravel() for one in np.meshgrid(at, at))
    origins = np.column_stack([x, y, np.full(len(x), -2.0)])
    along = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    found, near = (
        field.cross(origins, along),
        field.cross(origins + np.array([1e-9, -1e-9, 0]), along),
    )
    assert not found.trapped.any()
    np.testing.assert_allclose(found.exit_origins, near.exit_origins, atol=1e-6)
    np.testing.assert_allclose(found.exit_directions, near.exit_directions, atol=1e-6)
    inward = (found.exit_directions[:, :2] * (MIDDLE[:2] - origins[:, :2])).sum(axis=1)
    assert inward.max() > 0.01  # drawn to the core


def test_even_gas_bends_nothing_and_makes_one_piece():
    field = IndexVolume(np.full((5, 6, 7), 1.3), (0, 0, 0), 0.5, 1.3)
    origins, directions = rays(50, 5)
    found = field.cross(origins + np.array([1.25, 1.5, 1.75]), directions)
    assert (np.diff(found.ptr) <= 1).all()
    np.testing.assert_allclose(found.exit_directions, directions, atol=1e-14)


def test_pieces_stay_within_the_tolerance_of_the_path():
    field = volume((12, 12, 12), 0.3)
    origins, directions = rays(6, 6)
    counts = []
    fine = field.cross(origins, directions, 1e-7)
    for tolerance in (1e-2, 1e-3, 1e-4):
        coarse = field.cross(origins, directions, tolerance)
        counts.append(len(coarse))
        np.testing.assert_array_equal(coarse.exit_origins, fine.exit_origins)
        for ray in range(6):
            some = slice(*coarse.ptr[ray : ray + 2])
            nodes = fine.origins[slice(*fine.ptr[ray : ray + 2])][::7]
            away = nodes[:, None] - coarse.origins[some]
            along = (away * coarse.directions[some]).sum(axis=2)
            along = np.clip(along, 0, coarse.lengths[some])
            missed = np.linalg.norm(away - along[..., None] * coarse.directions[some], axis=2)
            assert missed.min(axis=1).max() < tolerance
    assert counts[0] < counts[1] < counts[2]


def test_threads_and_chunks_change_nothing(monkeypatch):
    field = volume((10, 10, 10), 0.2)
    origins, directions = rays(300, 7)
    whole = field.cross(origins, directions)
    monkeypatch.setattr("rigs.scene.gas.follow.RAYS_AT_ONCE", 64)
    parts = field.cross(origins, directions)
    for name in ("origins", "directions", "lengths", "ptr", "exit_origins", "trapped"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"values": np.full((2, 2, 2), 2.9e-4)}, "expected n >= 1: n itself, not n - 1"),
        ({"values": np.ones((2, 2))}, r"expected \(nx, ny, nz\)"),
        ({"values": np.full((2, 2, 2), np.nan)}, "expected finite"),
        ({"spacing": (1, 0, 1)}, "spacing: found"),
        ({"lower": (0, 0)}, "lower"),
        ({"medium": 0.9}, "medium: found 0.9"),
    ],
)
def test_values_are_checked(changed, message):
    given = {"values": np.ones((2, 2, 2)), "lower": (0, 0, 0), "spacing": 1.0} | changed
    with pytest.raises(ValueError, match=message):
        IndexVolume(**given)


def test_gas_that_the_box_cuts_is_said():
    values = np.ones((6, 6, 6))
    values[2:4, 2:4, 2:] = 1.0003
    (line,) = IndexVolume(values, (0, 0, 0), 1.0).warnings()
    assert "upper z (100%)" in line
    assert "lower" not in line
    assert volume((12, 12, 12), 0.1).warnings() == ()
