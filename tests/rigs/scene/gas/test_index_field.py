"""Rays in closed-form fields of the refractive index: parabola, Luneburg's lens, the way back."""

from dataclasses import dataclass

import numpy as np
import pytest

from rigs.scene.gas import Crossing, Gas, IndexField


@dataclass(frozen=True, eq=False)
class Slope(IndexField):
    """``n² = 2 + slope · x``: light falls in it as a stone does."""

    slope: np.ndarray
    lower = np.full(3, -1.0)
    upper = np.full(3, 1.0)

    def index(self, points):
        return np.sqrt(2 + points @ self.slope)

    def gradient(self, points):
        return self.slope / (2 * self.index(points)[:, None])


class Luneburg(IndexField):
    """``n² = 2 - r²`` in a ball of radius 1, which focuses parallel rays on its far end."""

    lower, upper = np.full(3, -1.1), np.full(3, 1.1)

    def index(self, points):
        return np.sqrt(np.maximum(2 - (points**2).sum(axis=1), 1))

    def gradient(self, points):
        inside = (points**2).sum(axis=1, keepdims=True) < 1
        return np.where(inside, -points, 0) / self.index(points)[:, None]


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_a_linear_gradient_of_the_squared_index_makes_parabolas():
    field = Slope(np.array([0.1, 0.4, -0.2]))
    rng = np.random.default_rng(0)
    origins = np.column_stack([np.full(6, -1.0), rng.uniform(-0.5, 0.5, (6, 2))])
    directions = unit(np.column_stack([np.ones(6), rng.uniform(-0.5, 0.5, (6, 2))]))
    found = field.cross(origins, directions, tolerance=1e-4)
    # x'' = slope / 2, x' = n d at the start: where x, the velocity, is what the exit says
    speed = field.index(origins)[:, None] * directions
    leaving = field.index(found.exit_origins)[:, None] * found.exit_directions
    times = ((leaving - speed) @ field.slope) / (field.slope @ field.slope) * 2
    np.testing.assert_allclose(leaving, speed + times[:, None] * field.slope / 2, atol=1e-11)
    parabola = origins + times[:, None] * speed + times[:, None] ** 2 * field.slope / 4
    np.testing.assert_allclose(found.exit_origins, parabola, atol=1e-10)
    assert (np.abs(found.exit_origins).max(axis=1) > 1 - 1e-12).all()
    assert (np.abs(found.exit_directions - directions).max(axis=1) > 0.05).all()


def test_a_formula_that_does_not_say_how_it_moves_is_left_where_it_is():
    gas = Gas(Slope(np.array([0.1, 0.4, -0.2])))
    with pytest.raises(ValueError, match="found Slope, which does not say how it moves"):
        gas.transformed(np.eye(3), np.ones(3))
    with pytest.raises(ValueError, match="found Slope, which does not say how it scales"):
        gas.with_lengths_scaled(25.4)


def parallel_rays(count, seed):
    rng = np.random.default_rng(seed)
    directions = unit(rng.normal(size=(count, 3)))
    across = unit(np.cross(directions, rng.normal(size=(count, 3))))
    return rng.uniform(0, 0.95, (count, 1)) * across - 2 * directions, directions


def test_luneburgs_lens_focuses_every_direction_on_its_far_end():
    origins, directions = parallel_rays(8, 1)
    found = Luneburg().cross(origins, directions)
    past = np.cross(directions - found.exit_origins, found.exit_directions)
    assert np.linalg.norm(past, axis=1).max() < 1e-10


@pytest.mark.parametrize("field", [Luneburg(), Slope(np.array([0.5, -0.3, 0.2]))])
def test_a_ray_sent_back_returns_to_where_it_entered(field):
    origins, directions = parallel_rays(5, 2)
    there = field.cross(origins, directions)
    back = field.cross(there.exit_origins, -there.exit_directions)
    met = np.diff(there.ptr) > 0
    assert met.any()
    start = there.origins[there.ptr[:-1][met]]
    assert np.abs(back.exit_origins[met] - start).max() < 1e-10 * there.lengths.sum()


def test_pieces_are_a_chain_near_the_path():
    field = Luneburg()
    origins, directions = parallel_rays(3, 3)
    coarse, fine = (field.cross(origins, directions, tolerance=t) for t in (1e-2, 1e-5))
    assert isinstance(coarse, Crossing)
    assert len(coarse) < len(fine) / 10
    for ray in range(3):
        some = slice(*coarse.ptr[ray : ray + 2])
        ends = coarse.origins[some] + coarse.directions[some] * coarse.lengths[some, None]
        np.testing.assert_allclose(ends[:-1], coarse.origins[some][1:], atol=1e-13)
        np.testing.assert_allclose(ends[-1], coarse.exit_origins[ray], atol=1e-13)
        nodes = fine.origins[slice(*fine.ptr[ray : ray + 2])]
        away = nodes[:, None] - coarse.origins[some]
        along = np.clip((away * coarse.directions[some]).sum(axis=2), 0, coarse.lengths[some])
        missed = np.linalg.norm(away - along[..., None] * coarse.directions[some], axis=2)
        assert 1e-4 < missed.min(axis=1).max() < 1e-2


def test_rays_that_miss_the_box_or_leave_it_have_no_piece():
    field = Luneburg()
    origins = np.array([[2.0, 2, 2], [1.1, 0, 0], [0, 3, 0]])
    directions = np.array([[1.0, 0, 0], [1, 0, 0], [1, 0, 0]])
    found = field.cross(origins, directions)
    assert len(found) == 0
    np.testing.assert_array_equal(found.exit_origins, origins)
    np.testing.assert_array_equal(found.exit_directions, directions)
    assert np.isinf(field.ahead(origins, directions)).all()
    np.testing.assert_allclose(field.ahead([[-3, 0, 0], [0, 0, 0]], directions[:2]), [1.9, 0])


@pytest.mark.parametrize("wrong", [[np.nan, 0, 0], [0, 0, 0]])
def test_rays_are_checked(wrong):
    with pytest.raises(ValueError, match="rays: found NaN, infinity or a zero direction"):
        Luneburg().cross(np.zeros((1, 3)), [wrong])
