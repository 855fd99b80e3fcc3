"""Voxels and effects found with the products of an operator on a device."""

from dataclasses import replace

import numpy as np
import pytest

from tomo.inference.infer import infer
from tomo.inference.joint import Joint
from tomo.inference.solve import first_fits, next_fits
from tomo.model import Absorber, Absorbing, Background, Blur, FallOff, Gain, Pose
from tomo.operators.gpu.device_operator import DeviceOperator

pytestmark = pytest.mark.usefixtures("quick_solves")


def effects_of(observation):
    gas = [Absorbing(own=False), Absorbing(own=True), Absorber(observation.grid)]
    return [Gain(), Background(), FallOff(), Blur(), Pose(), *gas]


def off(found, expected):
    return np.abs(found - expected).max() / np.abs(expected).max()


def fitted(observation):
    """Return the fit of voxels, the fit with effects, their steps, and that with light around."""
    fits = first_fits([observation])
    (joint,), steps = next_fits(fits, effects_of(observation))
    (around,), _ = next_fits([one.with_surroundings() for one in fits])
    return fits[0], joint, steps, around


@pytest.fixture
def there(observed, host):
    """Return what was observed, with products on the host's build of the kernels."""
    return replace(observed[0], device=host)


def moved_by_a_last_bit(observation):
    """Return the observation with every pixel the next smaller or larger number."""
    random = np.random.default_rng(0)

    def moved(image):
        ends = np.where(random.random(image.shape) < 0.5, -np.inf, np.inf)
        return np.nextafter(image, ends.astype(image.dtype))

    return replace(observation, images=tuple(map(moved, observation.images)))


def test_a_fit_and_its_residual_are_those_of_the_cpu_as_far_as_its_last_bits_tell(observed, there):
    """Gradients are small differences of products, and conjugate gradients enlarge roundings."""
    (own,), (found,) = first_fits([observed[0]], rounds=1), first_fits([there], rounds=1)
    assert isinstance(found.system.projector, DeviceOperator)
    assert off(found.unknowns, own.unknowns) < 1e-6
    assert off(found.measured - found.residual, own.measured - own.residual) < 1e-6
    (own,), (found,) = first_fits([observed[0]]), first_fits([there])
    (moved,) = first_fits([moved_by_a_last_bit(observed[0])])
    assert off(found.unknowns, own.unknowns) < 10 * off(moved.unknowns, own.unknowns)
    assert off(found.unknowns, own.unknowns) < 1e-3


@pytest.mark.parametrize("library", ["torch", "array_api_strict"])
def test_arrays_of_other_libraries_stay_on_the_device_and_give_the_same_fits(
    there, on_arrays_of, monkeypatch, library
):
    fit, joint, steps, around = fitted(there)
    assert isinstance(around.around.projector, DeviceOperator)
    on_arrays_of(library)
    solve, on_numpy, copied = Joint.solve, DeviceOperator._on_numpy, []

    def noted(operator, apply, values):
        copied.append(values.size)
        return on_numpy(operator, apply, values)

    def watched(problem, b, z, iterations):
        assert type(b).__module__.partition(".")[0] == library
        one = problem.frames[0]
        with monkeypatch.context() as patch:
            if one.field is None:  # its nodes are NumPy's
                assert (one.outside or one.operator).row_sums.any()  # kept from here on
                patch.setattr(DeviceOperator, "_on_numpy", noted)
            return solve(problem, b, z, iterations)

    monkeypatch.setattr(Joint, "solve", watched)
    for found, expected in zip(fitted(there), (fit, joint, steps, around), strict=True):
        if isinstance(found, dict):
            for name, values in found.items():
                np.testing.assert_allclose(values, expected[name], rtol=1e-5, atol=1e-9)
        else:
            assert off(found.unknowns, expected.unknowns) < 1e-6
            assert off(found.residual, expected.residual) < 1e-6
    assert not copied


def test_the_same_is_found_as_on_the_cpu(observed, there):
    """Sizes differ by a fifth at most of the spread that exact cameras leave."""
    found = []
    for one in (observed[0], there):
        images = (one.images[0], np.float32(1.08) * one.images[1], *one.images[2:])
        found.append(infer([replace(one, images=images)], effects_of(one)[:4]))
    own, device = found
    assert {name for name, free in own.state.free.items() if free.any()} == {"gain"}
    for name, free in own.state.free.items():
        assert np.array_equal(device.state.free[name], free)
        apart = np.abs(device.state.values[name] - own.state.values[name]).max(axis=0)
        assert (apart <= 0.2 * own.spread.get(name, 0.0)).all()
