import math
from dataclasses import replace

import numpy as np
import pytest

from tomo.selection import Choice, choose_by_held_out_views
from tomo.simulation.effects import Effects
from tomo.wernet.default import ViewTokens
from tomo.wernet.default.linearised import Thinned
from tomo.wernet.default.patch_noise import ORDER, beyond_noise, noise_of_pixels
from tomo.wernet.default.patch_validation import residuals_of_left_out_patches
from tomo.wernet.default.variable_projection import LEVELS, OFF_AXIS, _step, first_guess

CHOICE = Choice("nnls", 0.0, 40, 0.1)
SIZE = (42, 60)


def _noisy(one, fraction, seed=5):
    random = np.random.default_rng(seed).standard_normal(len(one.measured))
    return (one.measured + fraction * one.measured.max() * random).astype(np.float32)


@pytest.mark.parametrize("fraction", [0.01, 0.02, 0.1])
def test_noise_is_told_from_what_flames_show(scene, fraction):
    one = scene(finer=2, image_size=SIZE)
    brightest = one.measured.max()
    assert noise_of_pixels(one.measured) < 2e-4 * brightest
    found = noise_of_pixels(_noisy(one, fraction))
    # some views look along voxels, whose edges show
    assert 0.98 < found / (fraction * brightest) < 1.2


def test_a_few_pixels_and_dark_ones_have_no_noise():
    random = np.random.default_rng(0).standard_normal(ORDER + 1).astype(np.float32)
    assert noise_of_pixels(random[:0]) == noise_of_pixels(random[:ORDER]) == 0
    assert noise_of_pixels(random) > 0
    assert noise_of_pixels(np.zeros(50, np.float32)) == 0


def test_what_is_beyond_noise_is_known_as_well_as_noise_varies():
    assert beyond_noise(9.0, 0.0, 100) == 3.0
    assert beyond_noise(0.0, 0.0, 0) == 0.0
    assert beyond_noise(25.0, 9.0, 10**9) == pytest.approx(4.0)
    # what no more than noise makes is one and the same: nothing has explained a share of it
    least = beyond_noise(100.0, 100.0, 100)
    assert 0 < least < math.sqrt(100)
    assert beyond_noise(90.0, 100.0, 100) == least


def test_what_noise_leaves_in_patches_is_known_from_a_sample(scene):
    one = scene(image_size=SIZE)

    def linearised(measured):
        return Thinned.of(one.projector, measured, 1, 1.0).at(ViewTokens(12, 1), CHOICE)

    # the voxels' edges look like noise; no more of it is taken off than what is left at all
    clean = linearised(one.measured)
    assert np.linalg.norm(clean.noise) < 1.5 * np.linalg.norm(clean.residual)
    made = []
    for seed in range(3):
        noisy = linearised(_noisy(one, 0.02, seed))
        made.append(np.linalg.norm(noisy.residual - clean.residual))
    assert np.linalg.norm(noisy.noise) == pytest.approx(np.mean(made), rel=0.05)


def test_a_step_in_noise_alone_explains_nothing(scene):
    one = scene(image_size=SIZE)
    some = Thinned.of(one.projector, _noisy(one, 0.05), 1, 1.0)
    tokens = ViewTokens(12, 1)
    now = some.at(tokens, CHOICE)
    without = _step(now, tokens, ()).after
    for parts in ((0,), (1,), (LEVELS,), (0, 1, LEVELS)):
        assert _step(now, tokens, parts).after > 0.97 * without


def test_what_a_lens_explains_is_not_hidden_by_noise(scene):
    one = scene(effects=Effects(vignetting=0.4), finer=2, image_size=SIZE)

    def left(measured, **changed):
        some = replace(Thinned.of(one.projector, measured, 1, 1.0), **changed)
        tokens = ViewTokens(12, 1)
        now = some.at(tokens, CHOICE)
        return _step(now, tokens, (OFF_AXIS,)).after / _step(now, tokens, ()).after

    noisy = _noisy(one, 0.02)
    clean, beyond, at_all = left(one.measured), left(noisy), left(noisy, noise=0.0)
    assert at_all > 1.05 * clean
    assert beyond == pytest.approx(clean, rel=0.08)


def test_more_noise_brings_no_trend_that_is_not_there(scene):
    one = scene(finer=2, image_size=SIZE)
    noisy = _noisy(one, 0.05, seed=1)
    choice = choose_by_held_out_views(one.projector, noisy)
    assert first_guess(one.projector, noisy, choice, 1.0) is None


def test_noise_of_the_views_left_out_is_not_taken_for_misfit(scene):
    one = scene(image_size=SIZE)
    noisy = _noisy(one, 0.02)
    some = Thinned.of(one.projector, noisy, 1, 1.0)
    blurred = Choice("tikhonov", 1.2, 30, 0.1)
    at_all, beyond = residuals_of_left_out_patches(some, one.projector, blurred)
    clean = replace(some, measured=one.measured, noise=0.0)
    least = residuals_of_left_out_patches(clean, one.projector, blurred)
    np.testing.assert_array_equal(least[0], least[1])
    assert (np.abs(beyond**2 - least[0] ** 2) < 0.3 * (at_all**2 - least[0] ** 2)).all()
