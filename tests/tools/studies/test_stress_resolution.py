"""Waves come back from six rigs down to the wavelengths that the criterion predicts."""

from dataclasses import replace

import numpy as np
import pytest
from studies.stress import resolution

from rigs.check.resolved_wavelength import half_sphere

DIRECTIONS = half_sphere(8)


@pytest.fixture(scope="module")
def scenes():
    rigs = resolution.six_rigs(resolution.QUICK_SIDE)
    assert len(rigs) == 6
    return {name: resolution.WaveScene.of(rigs[name], 16) for name in ("ring of 5", "ring of 8")}


@pytest.mark.parametrize("name", ["ring of 5", "ring of 8"])
def test_waves_come_back_down_to_what_is_predicted(scenes, name):
    row = resolution.wave_row(name, scenes[name], DIRECTIONS)
    assert row.holds, row.note


def test_a_criterion_twice_as_coarse_or_as_fine_would_show(scenes):
    scene = scenes["ring of 5"]
    for factor in (0.4, 2.5):
        wrong = replace(scene)
        object.__setattr__(wrong, "predicted", lambda n, f=factor: f * scene.predicted(n))
        assert not resolution.wave_row("wrong", wrong, DIRECTIONS).holds


def test_waves_across_a_view_come_back_and_those_along_all_views_do_not(scenes):
    scene = scenes["ring of 5"]
    up = np.array([0.0, 1.0, 0.0])
    assert scene.returned(up, 3.0) > 0.85  # every camera looks across it
    assert scene.measured(up) == resolution.FINEST
    upright = np.radians(np.arange(0.0, 180.0, 3.0))
    level = np.stack([np.sin(upright), 0 * upright, np.cos(upright)], axis=-1)
    predicted = scene.predicted(level)
    assert scene.returned(level[predicted.argmax()], 3.0) < 0.4  # between two of them
    assert scene.returned(level[predicted.argmin()], 3.0) > 0.7
