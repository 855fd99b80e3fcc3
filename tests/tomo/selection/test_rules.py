"""Which strength predicts left-out views best, between those that were tried."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from tomo.operators import LINEAR
from tomo.selection.candidates import Candidate, Fit
from tomo.selection.rules import (
    SEVERAL_VIEWS,
    STRENGTHS,
    STRONGER,
    _best_strength,
    of_many_views,
)


def tried(square):
    """Return candidates of all strengths with the squared residuals that ``square(log)`` gives."""
    return [
        Candidate("curvature", 0.0, 20, math.sqrt(square(math.log10(each))), each)
        for each in STRENGTHS
    ]


@pytest.mark.parametrize("best", [2.2e-4, 5e-4, 1e-3, 8e-3])
def test_a_parabola_is_found_between_the_strengths_tried(best):
    found = _best_strength(tried(lambda log: 0.1 + 0.01 * (log - math.log10(best)) ** 2))
    assert found == pytest.approx(best, rel=1e-6)


def test_what_lies_beside_tells_to_which_side_the_best_is():
    found = _best_strength(tried(lambda log: 0.1 + abs(math.exp(log + 3) - 1)))
    assert 3e-4 < found < 1e-3  # it rises faster beyond


@pytest.mark.parametrize("sign", [1, -1])
def test_of_the_faintest_and_the_strongest_nothing_is_guessed(sign):
    found = _best_strength(tried(lambda log: 1 + 0.1 * sign * log))
    assert found == (STRENGTHS[0] if sign > 0 else STRENGTHS[-1])


@pytest.mark.parametrize(
    ("views", "best", "weighted", "stronger"),
    [
        (SEVERAL_VIEWS, 1e-3, False, True),
        (SEVERAL_VIEWS + 1, 1e-3, True, False),
        (SEVERAL_VIEWS, STRENGTHS[0], False, False),  # clean images
        (SEVERAL_VIEWS, STRENGTHS[0], True, True),
    ],
)
def test_of_several_noisy_views_the_penalty_is_stronger_than_they_ask_for(
    views, best, weighted, stronger
):
    def fit(method, width, *, strength):
        return Fit(method, width, 20, 1.0, 0.0, [1.0], strength)

    candidates = SimpleNamespace(
        tried=tried(lambda log: 0.1 + 0.01 * (log - math.log10(best)) ** 2),
        smoothed=lambda method, strengths: [fit(method, 0.0, strength=best)],
        fit=fit,
        weighted=weighted,
    )
    # A view without pixels does not count.
    view_ptr = np.concatenate([[0], np.arange(views + 1)]) * 10
    found = of_many_views(candidates, SimpleNamespace(basis=LINEAR, view_ptr=view_ptr))
    assert (found.method, found.width) == ("curvature", 0.0)
    assert found.strength == pytest.approx(best * STRONGER if stronger else best)
