"""That flames move as gas does: carried up, changing, smooth in time."""

import numpy as np
import pytest

import phantoms
from phantoms import GaussianBlobs, JetFlame, Plume, TurbulentFlame

FRAME = 1e-4  # s
UP = 0.4  # mm in a frame


@pytest.fixture(scope="module")
def points():
    return (np.random.default_rng(3).random((6000, 3)) - 0.5) * [12, 50, 12]


def likeness(one, other):
    return np.corrcoef(one, other)[0, 1]


@pytest.mark.parametrize("name", ["jet", "plume", "turbulent"])
def test_time_zero_is_the_still_flame(name, points):
    field = phantoms.create(name, 2)
    assert field.at(0.0) == field
    moved = field.at(0.003)
    assert moved != field
    assert moved == eval(repr(moved), vars(phantoms) | {type(field).__name__: type(field)})
    np.testing.assert_array_equal(moved.at(0.0)(points), field(points))


@pytest.mark.parametrize("name", ["jet", "plume", "turbulent"])
@pytest.mark.parametrize("start", [0.0, 0.02])
def test_flames_are_smooth_in_time(name, start, points):
    field = phantoms.create(name, 1)
    base = field.at(start)(points)
    whole, half = (np.abs(field.at(start + step)(points) - base).max() for step in (1e-5, 5e-6))
    assert 0 < whole < 0.2
    assert half == pytest.approx(whole / 2, rel=0.1)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_turbulence_travels_up_and_lives_for_about_ten_frames(seed, points):
    field = TurbulentFlame(seed)
    still = field(points)

    def carried(frames):
        return likeness(field.at(frames * FRAME)(points + np.array([0, frames * UP, 0])), still)

    assert carried(4) > 0.8
    assert carried(4) > likeness(field.at(4 * FRAME)(points), still) + 0.1
    assert 0.4 < carried(10) < 0.8
    assert carried(40) < 0.5


def test_the_jet_s_pulses_begin_at_the_nozzle_and_travel_up():
    field = JetFlame()
    heights = np.linspace(-22, 10, 17)
    rings = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    radii = np.linspace(0.5, 6, 8)
    y, r, a = np.meshgrid(heights, radii, rings, indexing="ij")
    ring = np.stack([r * np.cos(a), y, r * np.sin(a)], axis=-1)

    def light(time):
        return field.at(time)(ring).mean(axis=(1, 2))

    change = light(0.006) / light(0.0)
    assert np.abs(change - 1).max() > 0.2  # 6 ms: pulses reach 24 mm above the nozzle at -35 mm
    np.testing.assert_allclose(change[heights > -5], 1, atol=0.03)
    late = np.array([light(0.03 + step * 5e-4) for step in range(8)])  # a period of 4 ms
    assert (late.max(axis=0) / late.min(axis=0)).min() > 1.3


def test_the_plume_sways():
    field = Plume(3)
    x = np.linspace(-6, 6, 61)
    top = np.stack([x, np.full_like(x, 20.0), np.zeros_like(x)], axis=-1)
    middles = []
    for time in np.linspace(0, 0.022, 12):
        light = field.at(time)(top)
        middles.append((light @ x) / light.sum())
    assert np.ptp(middles) > 1.0


def test_a_field_that_does_not_move_is_the_same_at_all_times():
    blobs = GaussianBlobs.random(1)
    assert phantoms.field_at(blobs, 3.0) is blobs
    assert phantoms.field_at(JetFlame(1), 3.0) == JetFlame(1, time=3.0)


def test_times_are_numbers():
    with pytest.raises(ValueError, match="JetFlame time: found nan"):
        JetFlame().at(np.nan)
