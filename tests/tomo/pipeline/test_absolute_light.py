"""A sphere of known emission comes back in W/m^3/sr, through cameras that differ in everything."""

from dataclasses import replace

import numpy as np
import pytest

import rigs
from tomo import Corrections, Options, Scan, VoxelGrid, reconstruct
from tomo.pipeline.view import peak_of
from tomo.scan import Calibration, Radiometry

EMISSION, RADIUS = 4.0e4, 8.0  # W/m^3/sr, mm
SPHERE = 12.5  # W/m^2/sr of the integrating sphere
DARK = 100  # counts
TRUE_TOTAL = EMISSION * 4 / 3 * np.pi * (RADIUS * 1e-3) ** 3  # W/sr
RIG = rigs.ring(12, distance=400.0, image_size=(64, 64), footprint=0.375, pitch_degrees=12.0)


def radiance(camera, along=8):
    """Return L in W/m^2/sr of every pixel: mean chord of along x along rays, in closed form."""
    width, height = camera.image_size
    parts = (np.arange(along) + 0.5) / along - 0.5
    u, v = np.meshgrid(*((np.arange(n)[:, None] + parts).ravel() for n in (width, height)))
    pixels = np.stack([u.ravel(), v.ravel(), np.ones(u.size)])
    ways = camera.R.T @ np.linalg.inv(camera.camera_matrix) @ pixels
    ways /= np.linalg.norm(ways, axis=0)
    eye = -camera.R.T @ camera.t
    halves = np.sqrt(np.maximum((eye @ ways) ** 2 - eye @ eye + RADIUS**2, 0))
    chords = 2e-3 * halves.reshape(height, along, width, along).mean(axis=(1, 3))
    return EMISSION * chords


@pytest.fixture(scope="module")
def lab():
    """Return images and spheres in counts of cameras of unknown sensitivity, and radiometry."""
    random = np.random.default_rng(0)
    images, spheres = {}, {}
    now = {name: {} for name in ("exposure", "f_number", "transmission")}
    then = {}
    for camera in RIG:
        t, f, transmission = random.uniform(0.5, 2), random.choice([2.8, 4, 5.6]), random.random()
        conditions = {"exposure": t * 1e-3, "f_number": f, "transmission": 0.5 + transmission / 2}
        for key, value in conditions.items():
            now[key][camera.name] = float(value)
        signal = conditions["exposure"] * conditions["transmission"] / f**2
        constant = random.uniform(0.6, 1.4) * 3.4e4 / (640 * signal)
        then[camera.name] = float(random.uniform(0.6, 1.4) * 3e4 * 64 / (constant * SPHERE))
        seen = constant * signal * radiance(camera)
        lamp = constant * then[camera.name] / 8**2 * SPHERE
        images[camera.name] = np.round(seen + DARK).astype(np.uint16)
        spheres[camera.name] = np.full(seen.shape, round(lamp + DARK), np.uint16)
    known = Calibration(
        image=spheres, radiance=SPHERE, exposure=then, f_number=8.0, transmission=1.0
    )
    return images, Radiometry("W/m^2/sr", known, **now)


def scan_of(lab, grid, **changes):
    images, radiometry = lab
    return Scan.from_arrays(
        RIG,
        images,
        grid,
        corrections=Corrections(dark=DARK / 65535),
        radiometry=replace(radiometry, **changes),
    )


def test_the_images_are_the_radiances(lab):
    """But for whole counts: 1 of 20 000 to 50 000 of the sphere, half of one in every pixel."""
    scan = scan_of(lab, None)
    for camera, image in zip(RIG, scan.images(), strict=True):
        expected = 1000 * radiance(camera)  # W/m^3/sr mm
        np.testing.assert_allclose(image, expected, rtol=5e-5, atol=5e-5 * expected.max())
    brightest = max(1000 * radiance(camera).max() for camera in RIG)
    peak = peak_of(scan, scan.frame_names[0], [scan.images()], scan.masks(), Options())
    assert peak.value == pytest.approx(brightest, rel=1e-4)
    assert peak.unit == "W/m^3/sr mm"


def test_a_sphere_of_known_emission_comes_back(lab, as_given):
    """Total power, and emission inside, within 0.1 %."""
    grid = VoxelGrid((48, 48, 48), 0.5)
    found = reconstruct(
        scan_of(lab, grid), options=Options(method="mlem", supersample=2, **as_given)
    )
    report = found.report()
    assert found.value_unit == report["emission"]["unit"] == "W/m^3/sr"
    emission = report["emission"]
    assert (emission["total_unit"], emission["power_unit"]) == ("W/sr", "W")
    assert emission["total"] == pytest.approx(TRUE_TOTAL, rel=1e-3)
    assert emission["power"] == pytest.approx(4 * np.pi * TRUE_TOTAL, rel=1e-3)
    # near the edge voxels and views do not resolve the jump from everything to nothing
    inside = np.linalg.norm(grid.centers(), axis=-1) < 0.75 * RADIUS
    assert found.volume[inside].mean() == pytest.approx(EMISSION, rel=1e-3)
    assert set(report["scan"]["radiometry"]["per_count"]) == set(RIG.names)


def test_calibrated_cameras_set_the_scale_of_all(lab, quick_solve):
    """Four of twelve are calibrated; the others record up to twice as much as these."""
    _, radiometry = lab
    names = RIG.names[:4]
    known = radiometry.calibration
    some = replace(
        known,
        image={name: known.image[name] for name in names},
        exposure={name: known.exposure[name] for name in names},
    )
    scan = scan_of(lab, VoxelGrid((16, 16, 16), 1.5), calibration=some)
    gains = {"fit_gain": True, "refine_cameras": "none", "uncertainty": 0}
    found = reconstruct(scan, options=Options(method="mlem", **gains))
    report = found.report()
    assert report["emission"]["total"] == pytest.approx(TRUE_TOTAL, rel=5e-3)
    assert report["scan"]["radiometry"]["calibrated"] == list(names)
    (line,) = [line for line in report["warnings"] if line.startswith("radiometry: ")]
    assert "no calibration of camera cam04, " in line
    assert "4 calibrated cameras" in line
    gains = np.array([report["gains"]["gain"][name] for name in names])
    assert np.median(np.log(gains)) == pytest.approx(0, abs=1e-9)
    # each camera's own gain is what one count of it is worth less than was taken
    full = scan_of(lab, None).per_count
    for name in RIG.names[4:]:
        expected = scan.per_count[name] / full[name]
        assert report["gains"]["gain"][name] == pytest.approx(expected, rel=0.01)
