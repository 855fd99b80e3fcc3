"""Lenses stronger than any that was ever ground: there and back, or refused."""

import numpy as np
import pytest

from rigs import Distortion

COUNTS = {"brown": 5, "rational": 8, "thin_prism": 12, "tilted": 14, "fisheye": 4}
MOST_ERROR = 1e-6  # radians; a fold of the lens is where an inverse would jump by far more
MOST_LOST = 1e-3  # of the directions that have an image


def random_lens(model, power, random):
    """Return a lens with coefficients from 1e-3 to ten to the ``power``, of either sign."""
    n = COUNTS[model]
    size = 10.0 ** random.uniform(-3, power, n) * (random.random(n) < 0.7)
    coefficients = random.choice([-1.0, 1.0], n) * size
    if model == "tilted":
        coefficients[12:] = random.uniform(-1.5, 1.5, 2)
    return Distortion(model, tuple(coefficients))


def directions(n, random):
    """Return directions (n, 3) up to 86 degrees off the axis, many near it."""
    angle = np.arccos(random.uniform(np.cos(1.5), 1, n))
    angle *= np.where(random.random(n) < 0.5, 1.0, 10.0 ** random.uniform(-5, 0, n))
    turn = random.uniform(0, 2 * np.pi, n)
    return np.stack(
        [np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], axis=1
    )


@pytest.mark.parametrize("model", COUNTS)
@pytest.mark.parametrize("power", [0, 1, 3, 6])
def test_directions_that_have_an_image_are_found_again(model, power):
    random = np.random.default_rng([power, len(model)])
    lost = seen = 0
    for _ in range(2):
        lens, points = random_lens(model, power, random), directions(300, random)
        plane, valid = lens.project(points)  # (N, 2)
        back = lens.unproject(plane[valid])
        refused = np.isnan(back[:, 0])
        lost, seen = lost + refused.sum(), seen + valid.sum()
        if refused.all():
            continue
        plane = plane[valid][~refused]
        again, again_valid = lens.project(back[~refused])
        assert again_valid.all()
        # where the image hardly moves with the direction, its rounding is what can be found again
        off = np.linalg.norm(again - plane, axis=1) / (1 + np.linalg.norm(plane, axis=1))
        assert off.max() < 1e-11
        apart = np.linalg.norm(back - points[valid], axis=1)[~refused]
        assert apart.max() < MOST_ERROR
    assert lost <= max(MOST_LOST * seen, 1)  # rounding, which processors differ in, may cost one
