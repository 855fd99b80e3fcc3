"""Registration finds known motions of images, with a realistic standard deviation."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from tomo.selfcal.registration import _Fit, register, shift_and_zoom_motions, shift_motions

SHAPE = (60, 44)
ROWS, COLUMNS = np.indices(SHAPE)


def scene():
    return sum(
        np.exp(-((ROWS - r) ** 2 + (COLUMNS - c) ** 2) / (2 * size**2))
        for r, c, size in ((15, 20, 5.0), (40, 14, 7.0), (30, 32, 4.0))
    )


def moved(image, amounts, motions):
    right, down = sum(a * motion for a, motion in zip(amounts, motions, strict=True))
    return map_coordinates(image, [ROWS - down, COLUMNS - right], order=3)


@pytest.mark.parametrize("amounts", [(0, 0, 0), (1.3, -0.6, 0), (0, 0, 2.5), (-1, 0.4, -1.5)])
def test_shift_and_zoom_are_found_at_any_gain(amounts):
    motions = shift_and_zoom_motions(SHAPE)
    image = 3.7 * moved(scene(), amounts, motions)
    found = register(scene(), image, np.ones(SHAPE, bool), motions)
    np.testing.assert_allclose(found.amounts, amounts, atol=0.05)
    assert found.after <= found.before


def test_masked_pixels_do_not_count():
    image = moved(scene(), (1.0, 0.5), shift_motions(SHAPE))
    mask = np.ones(SHAPE, bool)
    mask[:, :8] = False
    image[:, :8] = 1e9
    found = register(scene(), image, mask, shift_motions(SHAPE))
    np.testing.assert_allclose(found.amounts, (1.0, 0.5), atol=0.05)


def test_noise_scatters_amounts_as_the_covariance_says():
    motions, random = shift_and_zoom_motions(SHAPE), np.random.default_rng(0)
    mask = np.ones(SHAPE, bool)
    found = [
        register(scene(), scene() + 0.1 * random.standard_normal(SHAPE), mask, motions)
        for _ in range(60)
    ]
    scatter = np.std([one.amounts for one in found], axis=0)
    predicted = np.sqrt(np.mean([np.diag(one.covariance) for one in found], axis=0))
    assert np.all(scatter < 1.2 * predicted)
    assert np.all(
        scatter > 0.4 * predicted
    )  # a step too small to pay for interpolation is not made


def test_an_even_image_determines_no_shift():
    found = register(np.ones(SHAPE), np.ones(SHAPE), np.ones(SHAPE, bool), shift_motions(SHAPE))
    assert np.isinf(found.covariance).all()


@pytest.mark.parametrize("shape", [(1, 60), (60, 1)])
def test_a_single_row_is_shifted_along_itself_alone(shape):
    positions = np.arange(60.0)
    seen, image = (np.exp(-((positions - at) ** 2) / 50).reshape(shape) for at in (30, 31.2))
    along = np.array(shift_motions(shape)[[0 if shape[0] == 1 else 1]])
    found = register(seen, image, np.ones(shape, bool), along)
    np.testing.assert_allclose(found.amounts, [1.2], atol=0.05)
    both = register(seen, image, np.ones(shape, bool), shift_motions(shape))
    assert np.isinf(both.covariance).all()  # the position across is undetermined


@pytest.mark.parametrize("amounts", [(0.0, 0.0, 0.0), (1.3, -0.6, 2.5), (-60.0, 0.0, 0.0)])
def test_the_compiled_sums_are_those_of_plain_numpy(amounts):
    motions, random = shift_and_zoom_motions(SHAPE), np.random.default_rng(1)
    mask = random.random(SHAPE) < 0.9
    image = np.where(mask, 3.7 * scene() + 0.1 * random.standard_normal(SHAPE), 0)
    found = _Fit.of(scene(), image, mask, motions, np.array(amounts))

    right, down = np.tensordot(amounts, motions, 1)
    shown = map_coordinates(scene(), [ROWS - down, COLUMNS - right], order=1)
    shown = np.where(mask, shown, 0)
    gain = (shown * image).sum() / (shown**2).sum() if shown.any() else 1.0
    residual = image - gain * shown
    assert found.gain == pytest.approx(gain, rel=1e-12)
    assert found.error == pytest.approx((residual**2).sum(), rel=1e-12)
    slopes = np.stack(np.gradient(shown)[::-1]) * mask  # right, down
    change = np.stack([shown, *(-gain * (slopes * motions).sum(axis=1))]).reshape(4, -1)
    weight = (slopes**2).sum(axis=0)
    squares = np.einsum("ikrc,jkrc,rc->ij", motions, motions, weight) / (weight.sum() or 1.0)
    expected = change @ change.T, change @ residual.ravel(), squares
    for one, other in zip(found.normal_equations, expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-11 * np.abs(other).max(initial=1e-3))
