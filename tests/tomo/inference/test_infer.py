"""What is wrong is found, nothing else is named, whatever the threads and the cameras' order."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from tomo.inference.infer import infer
from tomo.model import Absorbing, Background, Blur, FallOff, Gain, Pose

OWN = (Gain(), Background(), Blur(), Pose())
ALL = (*OWN, FallOff(), Absorbing(own=False), Absorbing(own=True))
WRONG, SHIFT = 2, (1.2, -0.8)  # pixels


@pytest.fixture(scope="module")
def shifted(observed):
    """Return the observation with a camera that the rig has beside its place."""
    observation, _ = observed
    cameras = list(observation.rig)
    cameras[WRONG] = cameras[WRONG].shifted(*SHIFT)
    return replace(observation, rig=replace(observation.rig, cameras=tuple(cameras)))


@pytest.fixture(scope="module")
def found(shifted):
    return infer(shifted, OWN)


def named(found):
    """Return the cameras that an effect was found of, by effect."""
    free = found.state.free.items()
    return {name: np.flatnonzero(one.any(axis=1)).tolist() for name, one in free if one.any()}


def test_nothing_is_found_of_exact_cameras(observed):
    observation, _ = observed
    found = infer(observation, ALL)
    assert named(found) == {}
    assert not found.has_outside
    assert not found.state.hidden.any()
    assert max(one.max() for one in found.scores.values()) < 1


def test_one_camera_is_found_and_no_other_named(found):
    assert named(found) == {"pose": [WRONG]}
    assert not found.has_outside
    assert not found.state.hidden.any()
    np.testing.assert_allclose(found.state.values["pose"][WRONG, :2], -np.array(SHIFT), atol=0.15)
    assert found.scores["pose"].argmax() == WRONG


def with_gain(observation, gain):
    """Return the observation with a gain of one camera."""
    images = list(observation.images)
    images[WRONG] = np.float32(gain) * images[WRONG]
    return replace(observation, images=tuple(images))


def test_a_gain_is_found(observed):
    found = infer(with_gain(observed[0], 0.85), ALL)
    assert named(found) == {"gain": [WRONG]}
    assert found.state.values["gain"][WRONG, 0] == pytest.approx(np.log(0.85), abs=0.02)


def test_a_bright_camera_is_no_fall_off_of_all(observed):
    assert named(infer(with_gain(observed[0], 1.2), ALL)) == {"gain": [WRONG]}


def test_a_shifted_camera_is_no_fall_off_of_all(shifted):
    assert named(infer(shifted, ALL)) == {"pose": [WRONG]}


def test_the_bits_are_those_of_one_thread(shifted, found, on_threads):
    threads = numba.get_num_threads()
    with on_threads(1 if threads > 1 else 2):
        other = infer(shifted, OWN)
    for name, values in found.state.values.items():
        np.testing.assert_array_equal(other.state.values[name], values)
    np.testing.assert_array_equal(other.state.fit.unknowns, found.state.fit.unknowns)


def test_the_order_of_cameras_does_not_matter(shifted, found):
    order = [3, 0, 5, 2, 1, 4]
    parts = {
        name: tuple(getattr(shifted, name)[k] for k in order)
        for name in ("images", "masks", "noise")
    }
    cameras = tuple(shifted.rig[k] for k in order)
    other = infer(replace(shifted, rig=replace(shifted.rig, cameras=cameras), **parts), OWN)
    for effect in OWN:  # single precision sums in another order, and the steps go on from there
        before, after = (one.state.values[effect.name] for one in (found, other))
        close = 0.02 * effect.deviation(shifted).max()
        np.testing.assert_allclose(after, before[order], atol=close)
    volume = found.state.fit.means
    np.testing.assert_allclose(other.state.fit.means, volume, atol=5e-3 * volume.max())
