"""Images in the wrong place are known by what the other views predict."""

from dataclasses import replace

import numpy as np
import pytest

from tomo.inference.misplaced import TURNS, Misplaced, find_misplaced
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
