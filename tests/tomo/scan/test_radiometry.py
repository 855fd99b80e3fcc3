"""Absolute light: counts become radiances by a factor, a sphere, exposures and f-numbers."""

import copy
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml

from rigs.recordings import FrameError, write_image
from tomo import Scan, load_scan
from tomo.scan import Calibration, Radiometry

FLOOR = 3.0e-7  # W/m^2/sr a count


@pytest.fixture
def raw(folder):
    """Return the counts of both cameras' first images, now integers of 12 bits in 16."""
    random = np.random.default_rng(3)
    found = {
        "left": random.integers(200, 4000, (5, 7)).astype(np.uint16),
        "right": random.integers(200, 4000, (8, 9)).astype(np.uint16),
    }
    for name, image in found.items():
        write_image(folder / f"images/{name}/first.tif", image)
    return found


@pytest.fixture
def lit(folder, edit):
    """Return a function: radiometry and corrections to the scan with them."""

    def make(radiometry, **corrections):
        def change(content):
            content["radiometry"] = radiometry
            content["corrections"] = corrections

        edit(folder, change)
        return load_scan(folder)

    return make


def sphere(folder, name, image):
    write_image(folder / name, np.asarray(image))
    return name


def test_a_factor_is_the_radiance_of_one_count_whatever_the_bits(lit, raw):
    """In millimetres the images are 1000 times the radiance, so that volumes are per m^3."""
    about = {"unit": "W/m^2/sr", "calibration": {"factor": {"left": FLOOR, "right": 2 * FLOOR}}}
    for corrections in ({}, {"bit_depth": 12}):
        scan = lit(about, **corrections)
        left, right = scan.images("first")
        np.testing.assert_allclose(left, raw["left"] * FLOOR * 1000, rtol=2e-7)
        np.testing.assert_allclose(right, raw["right"] * 2 * FLOOR * 1000, rtol=2e-7)
        assert scan.value_unit("first") == "W/m^3/sr"


def test_floating_point_numbers_are_counts_as_stored(lit, frames):
    scan = lit({"unit": "W/m^2/sr", "calibration": {"factor": 2.0}})
    np.testing.assert_allclose(scan.images("first")[0], frames["first"]["left"] * 2000, rtol=2e-7)


def test_dark_flat_and_gain_come_first(lit, raw):
    scan = lit(
        {"unit": "W/m^2/sr", "calibration": {"factor": FLOOR}},
        dark=100 / 65535,
        flat=0.8,
        gain=1.5,
    )
    expected = (raw["left"] - 100.0) / 0.8 * 1.5 * FLOOR * 1000
    np.testing.assert_allclose(scan.images("first")[0], expected, rtol=1e-6)


def test_a_sphere_at_another_exposure_f_number_and_filter(folder, lit, raw):
    """S = C L t T / N^2, with a camera whose C nobody knows."""
    known, then, now = 12.5, (2e-2, 8.0, 1.0), (1e-3, 2.8, 0.6)  # W/m^2/sr; s, f-number, -
    constant = 2.0e6

    def signal(radiance, t, f_number, transmission):
        return constant * radiance * t * transmission / f_number**2

    level = round(signal(known, *then))
    image = np.full((5, 7), 300, np.uint16)
    image[1:4, 2:6] = level + 50
    scan = lit(
        {
            "unit": "W/m^2/sr",
            "exposure": "1e-3",  # YAML 1.1 reads this as text
            "f_number": now[1],
            "transmission": {"left": now[2]},
            "calibration": {
                "image": {"left": sphere(folder, "sphere.tif", image)},
                "radiance": known,
                "region": {"left": [2, 1, 4, 3]},
                "dark": 50 / 65535,
                "exposure": then[0],
                "f_number": then[1],
                "transmission": {"left": then[2]},
            },
        },
        dark=100 / 65535,
        gain={"left": 1.25},  # a later drift: not of the sphere's image
    )
    (found,) = scan.only("left").images("first")
    exact = (raw["left"] - 100.0) / signal(1.0, *now) * 1.25
    rounded = signal(known, *then) / level  # the sphere's counts are whole numbers
    np.testing.assert_allclose(found, exact * rounded * 1000, rtol=1e-6)


def test_photons_in_place_of_watts(lit, raw):
    watts = lit({"unit": "W/m^2/sr", "calibration": {"factor": FLOOR}}).images("first")
    about = {
        "unit": "W",
        "calibration": {"factor": FLOOR},
        "wavelength": 500,
        "volume_unit": "photons",
    }
    scan = lit(about)
    assert scan.value_unit() == "photons/s/m^3/sr"
    for one, other in zip(scan.images("first"), watts, strict=True):
        np.testing.assert_allclose(one, other / 3.972891714e-19, rtol=1e-6)


def test_one_colour_of_a_mosaic_takes_that_colour_of_the_sphere(lit, folder):
    """The region is in pixels of the sensor."""
    seen = np.full((8, 9), 1000, np.uint16)
    seen[::2, ::2] = 4000  # red
    write_image(folder / "images/right/first.tif", seen)
    image = np.full((8, 9), 65000, np.uint16)
    image[2:6, 2:6] = 500
    image[2:6:2, 2:6:2] = 2000
    known = {
        "image": {"right": sphere(folder, "sphere.tif", image)}, "radiance": 3.0,
        "region": {"right": [2, 2, 4, 4]},
    }  # fmt: skip
    scan = lit(
        {"unit": "W/m^2/sr", "calibration": known}, bayer={"right": "RGGB"}, channel={"right": "r"}
    )
    (found,) = scan.only("right").images("first")
    np.testing.assert_allclose(found, 6000, rtol=1e-6)


def test_scans_survive_their_file(tmp_path, rig, grid):
    random = np.random.default_rng(0)
    images = {
        n: random.integers(0, 4000, rig[n].image_size[::-1]).astype(np.uint16) for n in rig.names
    }
    lamp = {n: np.full(rig[n].image_size[::-1], 900, np.uint16) for n in rig.names}
    known = Calibration(image=lamp, radiance=3.0, region=(1, 1, 4, 3), exposure=0.1)
    scan = Scan.from_arrays(
        rig,
        images,
        grid,
        radiometry=Radiometry("mW/cm^2/sr", known, exposure={"left": 0.2, "right": 0.1}),
    )
    scan.save(tmp_path / "saved")
    again = load_scan(tmp_path / "saved")
    assert again.value_unit() == scan.value_unit() == "W/m^3/sr"
    for one, other in zip(again.images(), scan.images(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert again.per_count["left"] == pytest.approx(10 * 3 / 900 / 2 * 1000)
    assert (
        yaml.safe_load((tmp_path / "saved/scan.yaml").read_text())["radiometry"]["unit"]
        == "mW/cm^2/sr"
    )


def test_a_camera_without_a_calibration_takes_the_others_mean(lit, raw):
    about = {"unit": "W/m^2/sr", "calibration": {"factor": {"left": FLOOR}}}
    scan = lit(about)
    assert scan.per_count == {
        "left": pytest.approx(FLOOR * 1000),
        "right": pytest.approx(FLOOR * 1000),
    }
    assert scan.sets_scale == (True, False)
    (line,) = scan.remarks
    assert line.startswith("radiometry: found no calibration of camera right: ")
    assert "scale is that of 1 calibrated camera" in line
    assert scan.only("left").remarks == ()
    # twice as long exposed: half the radiance a count
    timed = about | {"exposure": {"left": 1e-3, "right": 2e-3}}
    timed["calibration"] = about["calibration"] | {"exposure": 1e-3}
    assert lit(timed).per_count["right"] == pytest.approx(FLOOR * 500)
    assert lit({"unit": "W", "calibration": {"factor": FLOOR}}).sets_scale is None


GOOD = {
    "unit": "W/m^2/sr",
    "exposure": 1e-3,
    "calibration": {
        "image": {"left": "sphere.tif"}, "radiance": 12.5, "region": [1, 1, 5, 4],
        "exposure": 1e-2,
    },
}  # fmt: skip


def changed(**steps):
    """Return good content with values at dotted places; None removes."""
    content = copy.deepcopy(GOOD)
    for place, value in steps.items():
        here, *rest = place.split("__")
        inner = content[here] if rest else content
        name = rest[0] if rest else here
        inner.pop(name, None) if value is None else inner.__setitem__(name, value)
    return content


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (changed(unit="lux"), ["scan.yaml: radiometry.unit: found 'lux', expected a unit of"]),
        (changed(unit=None), ["radiometry.unit: missing"]),
        (changed(volume_unit="W/m^2/sr"), ["radiometry.volume_unit: found 'W/m^2/sr', expected"]),
        (changed(volume_unit="photons"), ["radiometry.wavelength: missing"]),
        (changed(volume_unit="W/m^3/sr/nm"), ["radiometry.volume_unit: found W/m^3/sr/nm"]),
        (changed(exposure=-1), ["radiometry.exposure: found -1, expected a positive number"]),
        (changed(f_number={"left": 0}), ["radiometry.f_number: camera left: found 0"]),
        (changed(transmission=1.2), ["radiometry.transmission: found 1.2", "up to 1"]),
        (changed(exposure={"middle": 1}), ["radiometry.exposure", "'middle'", "left, right"]),
        (changed(calibration=None), ["radiometry.calibration: missing"]),
        (changed(calibration={}), ["radiometry.calibration: found neither factor nor image"]),
        (changed(calibration__region=[1, 2, 3]), ["calibration.region: found [1, 2, 3]"]),
        (changed(calibration__image={"left": "../a.tif"}), ["inside the scan folder"]),
        (changed(colour=3), ["radiometry.colour: unknown field"]),
    ],
)  # fmt: skip
def test_what_no_experiment_has_is_refused_when_loaded(
    folder, raw, lit, content, parts, assert_refused
):
    sphere(folder, "sphere.tif", np.full((5, 7), 3000, np.uint16))
    assert_refused(lambda: lit(content), *parts)


def saturated(image):
    image[2, 2:4] = 65535


def sloped(image):
    image += (200 * np.arange(7)).astype(np.uint16)


def dark(image):
    image[:] = 0


@pytest.mark.parametrize(
    ("content", "spoil", "parts"),
    [
        (GOOD, saturated, ["found 2 of 20 pixels of its region saturated", "shorter time"]),
        (GOOD, sloped, ["differ by ", "expected at most 5%", "flat"]),
        (GOOD, dark, ["found 0 counts on average, expected light"]),
        (changed(calibration__region=[3, 2, 5, 3]), None, ["[3, 2, 5, 3]", "7 x 5 pixels"]),
        (changed(calibration__radiance=None), None, ["calibration.radiance", "missing"]),
        (changed(calibration__factor=1.0), None, ["found factor and image"]),
        (changed(calibration__exposure=None), None,
         ["radiometry.calibration.exposure: camera left: missing", "the scan has exposure 0.001"]),
        (changed(exposure=None), None, ["radiometry.exposure: camera left: missing"]),
        (changed(calibration__dark=100), None, ["calibration.dark", "found 100", "at most 1"]),
        (changed(calibration__image={"left": "images/right/first.tif"}), None, ["9 x 8", "7 x 5"]),
    ],
)  # fmt: skip
def test_bad_images_of_a_sphere_are_refused(
    folder, raw, lit, content, spoil, parts, assert_refused
):
    image = np.full((5, 7), 3000, np.uint16)
    if spoil:
        spoil(image)
    sphere(folder, "sphere.tif", image)
    scan = lit(content)
    assert_refused(lambda: scan.images("first"), "scan.yaml: radiometry.", "camera left", *parts)


def test_a_missing_sphere_is_named(folder, raw, lit, assert_refused):
    scan = lit(GOOD)
    parts = "scan.yaml: radiometry.calibration.image", "camera left", "sphere.tif"
    assert_refused(lambda: scan.images("first"), *parts, error=FileNotFoundError)


def test_a_masked_pixel_and_noise_do_not_spoil_a_sphere(folder, raw, lit):
    random = np.random.default_rng(2)
    image = (3000 + 30 * random.standard_normal((5, 7))).astype(np.uint16)
    image[2, 2:4] = 65535
    usable = np.full((5, 7), 255, np.uint8)
    usable[2, 2:4] = 0
    sphere(folder, "sphere.tif", image)
    write_image(folder / "mask.png", usable)
    found = lit(GOOD, mask={"left": "mask.png"}).per_count["left"]
    assert found == pytest.approx(12.5 / 3000 * 10 * 1000, rel=0.01)


def test_a_rig_without_a_known_unit_has_no_radiances(rig):
    images = {n: np.ones(rig[n].image_size[::-1], np.uint16) for n in rig.names}
    scan = Scan.from_arrays(
        replace(rig, length_unit="unit"),
        images,
        radiometry=Radiometry("W", Calibration(factor=1.0)),
    )
    with pytest.raises(ValueError, match=r"^radiometry.length_unit: found 'unit'"):
        scan.images()


def test_a_damaged_sphere_is_no_bad_frame_to_skip(folder, raw, lit):
    """A film goes on without a bad frame; without a calibration none is good."""
    (folder / "sphere.tif").write_bytes(b"II*\0 damaged")
    with pytest.raises(ValueError, match=r"calibration\.image: .*sphere\.tif") as caught:
        lit(GOOD).images("first")
    assert not isinstance(caught.value, FrameError)


@pytest.mark.parametrize(
    "wrong", [{"exposure": -1.0}, {"f_number": {"left": 0.0}}, {"unit": "W/m"}]
)
def test_the_library_refuses_what_files_may_not_say(wrong):
    with pytest.raises(ValueError, match=re.escape(next(iter(wrong)))):
        Radiometry(**{"unit": "W", "calibration": Calibration(factor=1.0)} | wrong)
