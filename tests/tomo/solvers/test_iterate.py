import numpy as np
import pytest

from tomo.operators.vectors import unit_of
from tomo.solvers.iterate import drive

MEASURED = np.array([3.0, 4.0], np.float32)


def _states(norms, finite=True):
    for number, value in enumerate(norms):
        yield np.full(2, number if finite else np.nan, np.float32), value


def _drive(projector, states, iterations=10, callback=None):
    return drive(states, projector, MEASURED, iterations, callback, {"method": "fake"})


@pytest.fixture
def projector(projector_of):
    return projector_of(np.eye(2))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_solver_that_diverges_keeps_the_last_good_volume(projector, bad):
    found = _drive(projector, _states([5.0, 2.5, bad, 0.0]))
    np.testing.assert_array_equal(found.volume.ravel(), [1, 1])
    assert [line.relative_residual for line in found.history] == [1.0, 0.5]
    assert found.stop_reason.startswith("diverged at iteration 2")


def test_a_volume_that_is_not_finite_has_diverged_however_small_its_residual(projector):
    states = iter([(np.ones(2, np.float32), 5.0), (np.array([1, np.inf], np.float32), 2.5)])
    found = _drive(projector, states)
    np.testing.assert_array_equal(found.volume.ravel(), [1, 1])
    assert found.stop_reason.startswith("diverged at iteration 1")


@pytest.mark.parametrize("number", [0, 1])
def test_a_volume_that_never_was_finite_is_refused(projector, number):
    states = [(np.zeros(2, np.float32), 5.0), (np.zeros(2, np.float32), 5.0)]
    states[number] = (np.full(2, np.inf, np.float32), 2.5)
    with pytest.raises(ValueError, match=r"^measured: found intensities .*, expected smaller"):
        _drive(projector, iter(states))


def test_a_state_that_is_overwritten_after_it_was_yielded_does_not_reach_the_result(projector):
    def overwriting():
        state = np.zeros(2, np.float32)
        yield state, 5.0
        state = state + 1
        yield state, 1.0

    found = _drive(projector, overwriting(), iterations=1)
    np.testing.assert_array_equal(found.volume.ravel(), [1, 1])
    assert found.stop_reason == "all 1 iterations done"


def test_a_generator_that_ends_has_converged(projector):
    found = _drive(projector, _states([5.0, 1.0]))
    assert found.stop_reason == "converged at iteration 1"
    assert len(found.history) == 2


def test_no_more_updates_are_made_than_asked_for(projector):
    states = _states([5.0, 4.0, 3.0, 2.0])
    _drive(projector, states, iterations=2)
    assert next(states)[1] == 2.0


def test_the_callback_sees_every_state_and_stops_by_true_alone(projector):
    seen = []

    def callback(index, volume, residual):
        seen.append((index, float(volume[0]), residual))
        return index == 2

    found = _drive(projector, _states([5.0, 2.5, 1.25, 1.0]), callback=callback)
    assert seen == [(0, 0.0, 1.0), (1, 1.0, 0.5), (2, 2.0, 0.25)]
    assert found.stop_reason == "stopped by the callback at iteration 2"
    assert found.settings == {"method": "fake", "iterations": 10}


@pytest.mark.parametrize("iterations", [-1, 2.5, np.nan, np.inf])
def test_iterations_must_be_a_whole_number_from_zero(projector, iterations):
    with pytest.raises(ValueError, match=r"^iterations: found .*, expected a whole number >= 0$"):
        _drive(projector, _states([5.0] * 20), iterations)


@pytest.mark.parametrize("largest", [1e-40, 3e-5, 0.5, 1.0, 1.5, 3e38])
def test_the_unit_is_the_power_of_two_below_the_largest(largest):
    unit = unit_of(np.array([-largest, 0.0], np.float32))
    assert unit.dtype == np.float32
    assert np.log2(float(unit)) % 1 == 0
    assert 1 <= np.float32(largest) / unit < 2


def test_the_unit_of_nothing_is_one():
    assert unit_of(np.zeros(3, np.float32)) == 1
    assert unit_of(np.zeros(0, np.float32)) == 1
