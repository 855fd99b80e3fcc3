"""Units of light: their sizes, what becomes of images in them, and the unit of a total."""

import itertools

import pytest

from tomo.radiometry import LightUnit, images_to_volume, photon_energy, unit_of_total

PHOTON_500_NM = 3.972891714e-19  # J; h c / (500 nm), by hand


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("W", 1.0),
        ("W/m^2/sr", 1.0),
        ("W/m2/sr", 1.0),
        ("mW/cm^2/sr", 10.0),
        ("µW/mm^2/sr", 1.0),
        ("mW/cm2/sr/um", 0.01),  # as integrating spheres are certified
        ("W/m^2/sr/nm", 1.0),
        ("photons", 1.0),
        ("photons/s/cm^2/sr", 1e4),
    ],
)
def test_units_of_radiance_have_their_size(text, size):
    unit = LightUnit.of_radiance(text)
    assert unit.in_si == pytest.approx(size, rel=1e-14)
    assert LightUnit.of_radiance(str(unit)) == unit


@pytest.mark.parametrize("text", ["lux", "W/m^3/sr", "W/m^2", "w/m^2/sr", "W/m^2/sr/ m", "", "cd"])
def test_other_texts_are_no_radiance(text):
    with pytest.raises(ValueError, match=r"^found '.*', expected a unit of radiance like W/m\^2"):
        LightUnit.of_radiance(text)


def test_an_emission_is_per_volume():
    assert str(LightUnit.of_radiance("mW/cm^2/sr/um").emission) == "W/m^3/sr/nm"
    assert str(LightUnit.of_radiance("photons").emission) == "photons/s/m^3/sr"
    with pytest.raises(ValueError, match="of emission"):
        LightUnit.of_emission("W/m^2/sr")


def test_a_uniform_slab_has_the_radiance_of_its_depth():
    """5 cm of 7 W/m^3/sr are 0.35 W/m^2/sr, whatever the units."""
    lengths = {"m": 0.05, "cm": 5.0, "mm": 50.0, "um": 5e4}
    radiances = {"W/m^2/sr": 0.35, "mW/cm^2/sr": 0.035, "uW/mm^2/sr": 0.35}
    emissions = {"W/m^3/sr": 7.0, "mW/cm^3/sr": 7e-3, "kW/m^3/sr": 7e-3}
    for (length, depth), (radiance, L), (emission, j) in itertools.product(
        lengths.items(), radiances.items(), emissions.items()
    ):
        factor = images_to_volume(
            LightUnit.of_radiance(radiance), LightUnit.of_emission(emission), length
        )
        assert factor * L == pytest.approx(j * depth, rel=1e-12)


def test_watts_become_photons_and_back():
    watts, photons = LightUnit.of_radiance("W"), LightUnit.of_emission("photons")
    assert photon_energy(500.0) == pytest.approx(PHOTON_500_NM, rel=1e-9)
    there = images_to_volume(watts, photons, "m", 500.0)
    assert there == pytest.approx(1 / PHOTON_500_NM, rel=1e-9)
    back = images_to_volume(LightUnit.of_radiance("photons"), watts.emission, "m", 500.0)
    assert there * back == pytest.approx(1, rel=1e-14)
    with pytest.raises(ValueError, match="wavelength: missing"):
        images_to_volume(watts, photons, "m")


def test_a_band_is_no_spectral_density():
    with pytest.raises(ValueError, match=r"volume_unit: found W/m.3/sr from images in W"):
        images_to_volume(LightUnit.of_radiance("W/m^2/sr/nm"), LightUnit.of_emission("W"), "m")


def test_lengths_of_unknown_size_are_refused():
    watts = LightUnit.of_radiance("W")
    with pytest.raises(ValueError, match="length_unit: found 'unit'"):
        images_to_volume(watts, watts.emission, "unit")


@pytest.mark.parametrize(
    ("value", "length", "total", "factor"),
    [
        ("W/m^3/sr", "mm", "W/sr", 1e-9),
        ("mW/cm^3/sr", "mm", "mW/sr", 1e-3),
        ("photons/s/m^3/sr/nm", "m", "photons/s/sr/nm", 1.0),
        ("counts per mm", "mm", "counts per mm mm^3", 1.0),
    ],
)
def test_totals_have_a_unit(value, length, total, factor):
    assert unit_of_total(value, length) == (total, factor)
