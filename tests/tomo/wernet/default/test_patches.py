import math
from dataclasses import replace

import numpy as np
import pytest

from tomo.selection import Choice
from tomo.simulation.effects import Effects
from tomo.wernet.default import ViewParameters, wernet
from tomo.wernet.default.linearisation import PixelSubset
from tomo.wernet.default.patches import beyond_noise
from tomo.wernet.default.variable_projection import GAINS, VIGNETTING, _step

CHOICE = Choice(0.0, 1e-5, 40, 0.1)
SIZE = (42, 60)


def _noisy(one, fraction, seed=5):
    random = np.random.default_rng(seed).standard_normal(len(one.measured))
    return (one.measured + fraction * one.measured.max() * random).astype(np.float32)


def test_a_misfit_beyond_noise_is_known_as_well_as_noise_varies():
    assert beyond_noise(9.0, 0.0, 100) == 3.0
    assert beyond_noise(0.0, 0.0, 0) == 0.0
    assert beyond_noise(25.0, 9.0, 10**9) == pytest.approx(4.0)
    # misfits no larger than noise give the same least value: no term explains a fraction of it
    least = beyond_noise(100.0, 100.0, 100)
    assert 0 < least < math.sqrt(100)
    assert beyond_noise(90.0, 100.0, 100) == least


def test_the_noise_left_in_patches_is_known_from_a_sample(scene):
    one = scene(image_size=SIZE)

    def linearised(measured):
        return PixelSubset.of(one.projector, measured, 1, 1.0).linearise(
            ViewParameters(12, 1), CHOICE
        )

    # the voxels' edges look like noise; at most the whole residual counts as noise
    clean = linearised(one.measured)
    assert np.linalg.norm(clean.noise) < 1.5 * np.linalg.norm(clean.residual)
    made = []
    for seed in range(3):
        noisy = linearised(_noisy(one, 0.02, seed))
        made.append(np.linalg.norm(noisy.residual - clean.residual))
    assert np.linalg.norm(noisy.noise) == pytest.approx(np.mean(made), rel=0.05)


def test_a_step_in_noise_alone_explains_nothing(scene):
    one = scene(image_size=SIZE)
    some = PixelSubset.of(one.projector, _noisy(one, 0.05), 1, 1.0)
    view_parameters = ViewParameters(12, 1)
    now = some.linearise(view_parameters, CHOICE)
    without = _step(now, view_parameters, ()).after
    for parts in ((0,), (1,), (GAINS,), (0, 1, GAINS)):
        assert _step(now, view_parameters, parts).after > 0.97 * without


def test_noise_does_not_hide_vignetting(scene):
    one = scene(effects=Effects(vignetting=0.4), finer=2, image_size=SIZE)

    def left(measured, **changed):
        some = replace(PixelSubset.of(one.projector, measured, 1, 1.0), **changed)
        view_parameters = ViewParameters(12, 1)
        now = some.linearise(view_parameters, CHOICE)
        return (
            _step(now, view_parameters, (VIGNETTING,)).after
            / _step(now, view_parameters, ()).after
        )

    noisy = _noisy(one, 0.02)
    clean, beyond, at_all = left(one.measured), left(noisy), left(noisy, noise=0.0)
    assert at_all > 1.05 * clean
    assert beyond == pytest.approx(clean, rel=0.08)


def test_more_noise_brings_no_term_that_is_not_there(scene):
    one = scene(finer=2, image_size=SIZE)
    noisy = _noisy(one, 0.05, seed=1)
    found = wernet(one.projector, noisy, iterations=1)
    assert found.weights is None
