"""Planck's law, and temperatures from the ratio of two colours."""

import numpy as np
import pytest
from scipy.integrate import quad

from tomo.radiometry import planck_radiance, temperature_from_ratio, temperature_of_volumes

STEFAN_BOLTZMANN = 5.670374419e-8  # W/m^2/K^4, CODATA
WIEN = 2.897771955e6  # nm K, CODATA


def test_the_law_holds_all_the_light_and_its_peak():
    """Independent of the formula: its integral is Stefan and Boltzmann's, its peak Wien's."""
    kelvin = 1800.0
    logs = np.log(50.0), np.log(5e6)
    whole, _ = quad(
        lambda log: planck_radiance(np.exp(log), kelvin) * np.exp(log), *logs, epsrel=1e-10
    )
    assert np.pi * whole == pytest.approx(STEFAN_BOLTZMANN * kelvin**4, rel=1e-8)
    around = np.linspace(0.999, 1.001, 2001) * WIEN / kelvin
    brightest = around[np.argmax(planck_radiance(around, kelvin))]
    assert brightest * kelvin == pytest.approx(WIEN, rel=1e-5)


@pytest.mark.parametrize("wavelengths", [(450.0, 650.0), (650.0, 450.0), (900.0, 1550.0)])
@pytest.mark.parametrize("exponent", [0.0, 1.0, 1.39])
def test_the_ratio_gives_the_temperature_back(wavelengths, exponent):
    """From a candle to a star, where Wien's approximation is off by thousands of kelvin."""
    kelvin = np.array([300.0, 1000.0, 1800.0, 3000.0, 6000.0, 30_000.0])
    first, second = (planck_radiance(w, kelvin) * w**-exponent for w in wavelengths)
    found, _ = temperature_from_ratio(first / second, wavelengths, exponent=exponent)
    np.testing.assert_allclose(found, kelvin, rtol=1e-11)


def test_the_deviation_is_that_of_noisy_ratios():
    """By trial: the temperatures of 20 000 ratios with 1 % noise."""
    wavelengths, kelvin = (550.0, 700.0), 1700.0
    ratio = planck_radiance(550.0, kelvin) / planck_radiance(700.0, kelvin)
    noisy = ratio * (1 + 0.01 * np.random.default_rng(1).standard_normal(20_000))
    _, predicted = temperature_from_ratio(ratio, wavelengths, relative_deviation=0.01)
    assert temperature_from_ratio(noisy, wavelengths)[0].std() == pytest.approx(
        predicted, rel=0.03
    )


def test_ratios_of_no_hot_body_have_no_temperature():
    hottest = (700 / 550) ** 4  # Rayleigh and Jeans
    ratios = [0.0, -1.0, np.nan, np.inf, hottest * 1.0001, hottest * 0.999]
    found, deviation = temperature_from_ratio(ratios, (550.0, 700.0), relative_deviation=0.1)
    assert np.isnan(found).tolist() == np.isnan(deviation).tolist() == [True] * 5 + [False]
    assert found[-1] > 1e6


def test_volumes_give_temperatures_where_both_are_bright():
    kelvin = np.full((2, 3, 4), 1650.0)
    first, second = (5e-9 * planck_radiance(w, kelvin) for w in (550.0, 700.0))
    first[0, 0, 0] = second[1, 2, 3] = 0.0
    second[0, 1, 0] = np.nan
    found, deviation = temperature_of_volumes(
        first, second, (550.0, 700.0), deviations=(0.03 * first, 0.04 * second), calibration=0.12
    )
    dark = np.zeros(kelvin.shape, bool)
    dark[0, 0, 0] = dark[1, 2, 3] = dark[0, 1, 0] = True
    np.testing.assert_array_equal(np.isnan(found), dark)
    np.testing.assert_allclose(found[~dark], 1650, rtol=1e-11)
    _, expected = temperature_from_ratio(
        first[1, 1, 1] / second[1, 1, 1], (550.0, 700.0), relative_deviation=0.13
    )
    np.testing.assert_allclose(deviation[~dark], expected, rtol=1e-10)


def test_input_without_a_meaning_is_refused():
    with pytest.raises(ValueError, match="wavelengths: found 550 and 550"):
        temperature_from_ratio(1.0, (550.0, 550.0))
    with pytest.raises(ValueError, match="relative_deviation: found -0"):
        temperature_from_ratio(1.0, (550.0, 700.0), relative_deviation=-0.1)
    with pytest.raises(ValueError, match="second: found shape"):
        temperature_of_volumes(np.ones((2, 2, 2)), np.ones((2, 2, 1)), (550.0, 700.0))
