"""Images in the wrong place are known by what the other views predict."""

from dataclasses import replace

import numpy as np
import pytest

from tomo.inference.misplaced import TURNS, Misplaced, find_misplaced, owner
from tomo.inference.solve import first_fit
from tomo.inference.steps import distrust


def found_in(observation, images):
    seen = replace(observation, images=tuple(images))
    return find_misplaced(seen, distrust([first_fit(seen)]))


def test_nothing_is_misplaced_in_exact_images(observed):
    observation, _ = observed
    assert found_in(observation, observation.images) is None


@pytest.mark.parametrize("turned", TURNS)
def test_a_turned_image_is_found(observed, turned):
    observation, _ = observed
    images = list(observation.images)
    images[1] = TURNS[turned](images[1]).copy()
    assert found_in(observation, images) == Misplaced(1, turned)


@pytest.mark.parametrize("pair", [(0, 1), (1, 3), (2, 4)])
def test_swapped_images_are_found(observed, pair):
    observation, _ = observed
    images, (first, second) = list(observation.images), pair
    images[first], images[second] = images[second], images[first]
    doubts = np.isin(np.arange(6), pair).astype(np.float64)
    found = find_misplaced(replace(observation, images=tuple(images)), doubts)
    assert found == Misplaced(first, other=second)


@pytest.mark.parametrize("views", [(0, 1), (1, 3), (4, 2)])
def test_an_image_of_several_cameras_is_that_of_the_camera_the_others_predict(observed, views):
    observation, _ = observed
    images = list(observation.images)
    for view in views:
        images[view] = images[views[-1]]
    assert owner(replace(observation, images=tuple(images)), views) == views[-1]


def test_nothing_tells_whose_the_image_of_cameras_in_one_place_is(observed):
    observation, _ = observed
    cameras, images = list(observation.rig), list(observation.images)
    cameras[3], images[3] = replace(cameras[1], name=cameras[3].name), images[1]
    rig = replace(observation.rig, cameras=tuple(cameras))
    assert owner(replace(observation, rig=rig, images=tuple(images)), (1, 3)) is None
