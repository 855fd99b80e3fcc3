"""Faults of the size that is printed are noticed about half of the time, and not much smaller."""

from dataclasses import replace

import numpy as np
import pytest

from tomo.inference.infer import infer
from tomo.inference.limits import detection_limits
from tomo.model import Absorbing, Background, Gain, Pose

OWN = (Gain(), Background(), Pose())
WRONG = 2


@pytest.fixture(scope="module")
def exact(observed):
    return observed[0]


@pytest.fixture(scope="module")
def limits(exact):
    return detection_limits(infer([exact], OWN))


def with_pose(seen, number, size):
    """Return what is observed where one camera is off in one parameter of its pose."""
    values = np.zeros((len(seen.rig), 6))
    values[WRONG, number] = size
    return replace(seen, rig=Pose().applied(seen, values).rig)


def with_gain(seen, size):
    images = list(seen.images)
    images[WRONG] = images[WRONG] * np.float32(np.exp(size))
    return replace(seen, images=tuple(images))


@pytest.mark.parametrize(("name", "number"), [("right", 0), ("roll", 2), ("zoom", 3)])
def test_a_pose_is_found_from_about_its_limit_on(exact, limits, name, number):
    size = limits.sizes["pose", name][WRONG]
    assert 0.05 < size < 2  # pixels
    seen = with_pose(exact, number, 2 * size)
    assert infer([seen], OWN).state.free["pose"][WRONG].any()
    seen = with_pose(exact, number, 0.4 * size)
    assert not infer([seen], OWN).state.free["pose"].any()


def test_a_gain_is_found_from_about_its_limit_on(exact, limits):
    size = limits.sizes["gain", "gain"][WRONG]
    assert infer([with_gain(exact, 2 * size)], OWN).state.free["gain"][WRONG].any()
    assert not infer([with_gain(exact, 0.4 * size)], OWN).state.free["gain"].any()


def test_more_noise_hides_more(exact, limits):
    random = np.random.default_rng(1)
    read = 0.05 * exact.brightest
    images = tuple(
        (image + random.normal(0, read, image.shape)).astype(np.float32) for image in exact.images
    )
    noise = tuple(replace(one, read=read) for one in exact.noise)
    found = detection_limits(infer([replace(exact, images=images, noise=noise)], OWN))
    for key in (("gain", "gain"), ("pose", "right"), ("background", "level")):
        assert found.sizes[key].mean() > 1.2 * limits.sizes[key].mean()


def test_what_all_views_share_has_a_limit_where_the_null_is_drawn(exact):
    effects = (*OWN, Absorbing(own=False))
    found = infer([exact], effects)
    assert ("medium", "depth") not in detection_limits(found).sizes
    limit = detection_limits(found, draw_null=True).sizes["medium", "depth"]
    assert 0.005 < limit[0] < 0.5
    assert (limit == limit[0]).all()


def test_effects_with_the_same_columns_are_not_told_apart(exact, limits):
    assert limits.alike == ()

    class Other(Gain):
        name = "other gain"

    found = detection_limits(infer([exact], (Gain(), Other())))
    assert ("gain", "gain") in found.alike  # of the other, taken for the first
