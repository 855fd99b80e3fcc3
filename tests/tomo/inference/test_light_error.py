"""What is not known of gains, gas and lenses is not known of the total light."""

from dataclasses import replace

import numpy as np
import pytest

from tomo.inference.infer import infer, light_error
from tomo.model import Absorbing, Gain, Pose
from tomo.model.pose import NOMINAL


@pytest.fixture(scope="module")
def exact(observed):
    return observed[0]


def test_exact_cameras_leave_none(exact):
    assert light_error(infer([exact], (Gain(), Pose()))) == 0


def test_gains_leave_the_standard_error_of_their_mean(exact):
    gains = np.array([0.2, -0.15, 0.1, -0.2, 0.15, -0.1])
    images = tuple(
        (image * np.exp(gain)).astype(np.float32)
        for image, gain in zip(exact.images, gains, strict=True)
    )
    found = infer([replace(exact, images=images)], (Gain(),))
    assert found.state.free["gain"].all()
    least = gains.std(ddof=1) / np.sqrt(len(gains))
    assert light_error(found) == pytest.approx(least, rel=0.2)


def test_lenses_of_a_drawing_leave_twice_their_magnification(exact):
    cameras = tuple(replace(camera, status="nominal") for camera in exact.rig)
    seen = replace(exact, rig=replace(exact.rig, cameras=cameras))
    expected = 2 * NOMINAL.magnification / np.sqrt(len(cameras))
    assert light_error(infer([seen], (Gain(),))) == pytest.approx(expected)


def test_gas_leaves_what_its_depth_is_off(exact):
    found = infer([exact], (Absorbing(own=False),), asked=["medium"])
    found.tested.spread["medium"] = np.array([0.02])
    once = light_error(found)
    assert 0.002 < once < 0.05  # half of the depth across the box, more where flames are thin
    found.tested.spread["medium"] = np.array([0.04])
    assert light_error(found) == pytest.approx(2 * once)
