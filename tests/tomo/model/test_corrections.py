"""Corrections undo known faults of images, camera by camera, by name."""

from dataclasses import replace

import numpy as np
import pytest

from tomo.model import Background, Corrections, FallOff, Gain, Pose
from tomo.model.effect import image_frame

GAINS = np.log([1.1, 0.9, 1.0, 1.3, 0.7, 1.05])
LEVELS = np.array([0.1, 0.0, 0.3, 0.05, 0.2, 0.0])
LOSS = 0.4


def values(pose=None):
    found = {"gain": GAINS, "background": LEVELS, "fall-off": np.full(6, LOSS)}
    found = {name: one[:, None] for name, one in found.items()}
    return found if pose is None else found | {"pose": pose}


@pytest.fixture
def faulty(observed):
    """Return the observation with gains, backgrounds and a lens that darkens corners."""
    observation, _ = observed
    height, width = observation.images[0].shape
    x, y, radius = image_frame((width, height))
    squared = (x**2 + y**2) * radius**2 / (width**2 / 4 + height**2 / 4)
    images = tuple(
        (np.exp(gain) * ((1 - LOSS * squared) * image + level)).astype(np.float32)
        for image, gain, level in zip(observation.images, GAINS, LEVELS, strict=True)
    )
    return replace(observation, images=images)


def test_known_faults_are_undone(observed, faulty):
    observation, _ = observed
    effects = (Gain(), Background(), FallOff())
    found = Corrections(observation.rig.names, observation.grid, effects, values())
    seen = found.applied(faulty)
    for image, noise, expected, own, gain in zip(
        seen.images, seen.noise, observation.images, observation.noise, GAINS, strict=True
    ):
        np.testing.assert_allclose(image, expected, atol=1e-5)
        assert noise.read == pytest.approx(own.read / np.exp(gain))
    assert seen.rig is faulty.rig


def test_values_belong_to_names(observed, faulty):
    observation, _ = observed
    names, pose = observation.rig.names, np.zeros((6, 6))
    pose[1, 0] = 2.0
    mask = np.zeros(observation.images[0].shape, bool)
    mask[3, 4] = True
    order = [4, 1, 0]  # what was found of other cameras does not matter, and those stay
    found = Corrections(
        tuple(names[k] for k in order),
        observation.grid,
        (Gain(), Pose()),
        {"gain": GAINS[order, None], "pose": pose[order]},
        untrusted={names[4]: mask},
    )
    seen, still = found.applied(faulty), found.applied(faulty, move=False)
    for k in range(6):
        gain = GAINS[k] if k in order else 0
        np.testing.assert_allclose(seen.images[k], faulty.images[k] / np.exp(gain), rtol=1e-6)
        assert (seen.rig[k] == faulty.rig[k]) == (k != 1)
        assert still.rig[k] == faulty.rig[k]
        np.testing.assert_array_equal(seen.masks[k], ~mask if k == 4 else faulty.masks[k])
    assert repr(found) == "<Corrections: gain, pose>"
    assert repr(Corrections(names, observation.grid)) == "<Corrections: none>"
