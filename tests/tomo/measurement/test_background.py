"""A uniform background is reported with its level; emission and noise are not."""

from dataclasses import replace

import numpy as np
import pytest

import phantoms
import rigs
from tomo import Scan, VoxelGrid, load_scan
from tomo.measurement import background, estimate_noise
from tomo.measurement.pixel_check import check_pixels
from tomo.pipeline import Options, reconstruct
from tomo.simulation import camera_noise, simulate_images

pytestmark = pytest.mark.usefixtures("quick_choices")

GRID = VoxelGrid((20, 40, 20), 1.0)


@pytest.fixture(scope="module", params=["jet", "turbulent", "homogeneous"])
def made(request):
    return _made(request.param)


def _made(phantom, coarser=1):
    size = {"image_size": (60 // coarser, 100 // coarser), "footprint": 0.5 * coarser}
    rig = rigs.ring(5, distance=200.0, pitch_degrees=15, **size)
    return simulate_images(rig, phantoms.create(phantom, 1, GRID.extent), GRID)


def levels(images):
    found = []
    for image in images:
        mask = np.ones(image.shape, bool)
        found.append(background(image, mask, estimate_noise(image, mask)))
    return found


def noisy(made, sigma, kind="gaussian"):
    random, images = np.random.default_rng(0), list(made.images.values())
    if kind == "poisson":
        return camera_noise.poisson(images, 300.0, 0.0, random)
    return camera_noise.gaussian(images, sigma, random) if sigma else images


@pytest.mark.parametrize("sigma", [0.0, 0.02, 0.1])
def test_emission_and_noise_are_no_background(made, sigma):
    images = noisy(made, sigma)
    assert levels(images) == [0.0] * 5
    assert levels([np.maximum(image, 0) for image in images]) == [0.0] * 5  # as cameras clip
    assert levels(noisy(made, 0, "poisson")) == [0.0] * 5


@pytest.mark.parametrize(("share", "sigma"), [(0.02, 0.0), (0.1, 0.02), (0.3, 0.1)])
def test_the_level_is_found(made, share, sigma):
    top = max(image.max() for image in made.images.values())
    lit = [image + np.float32(share * top) for image in noisy(made, sigma)]
    assert levels(lit) == pytest.approx([share * top] * 5, rel=0.1)


def test_emission_that_fills_the_image_is_none():
    """A plume wider than the image fades towards its edges."""
    rows, columns = np.mgrid[-50:50, -30:30]
    wide = np.exp(-(rows**2 + columns**2) / (2 * 40.0**2)).astype(np.float32)
    assert wide.min() > 0.1
    assert levels([wide, camera_noise.gaussian([wide], 0.02, np.random.default_rng(0))[0]]) == [
        0,
        0,
    ]


def test_a_background_is_reported_with_its_level():
    made = _made("jet")
    top = max(image.max() for image in made.images.values())
    images = [image + np.float32(0.1 * top) for image in made.images.values()]
    images[2] = images[2] + np.float32(0.1 * top)
    found = check_pixels(made.rig.names, images, [np.ones(i.shape, bool) for i in images])
    expected = dict.fromkeys(made.rig.names, 0.1 * top) | {"cam02": 0.2 * top}
    assert found.report()["background"] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("grid", [GRID, VoxelGrid((20, 25, 20), 4.0)])
def test_what_to_do_about_it_stands_first(tmp_path, grid):
    """Also where no line of sight misses the grid."""
    made = _made("jet", coarser=2)
    top = max(image.max() for image in made.images.values())
    lit = {name: image + np.float32(0.3 * top) for name, image in made.images.items()}
    folder = replace(made, images=lit).save(tmp_path / "scan")
    found = reconstruct(
        load_scan(folder), grid, Options(method="mlem", iterations=3, uncertainty=0)
    )
    assert found.findings[0].effect == "background"
    assert {one.camera for one in found.findings} == set(made.rig.names)
    assert "dark: " in found.findings[0].line


@pytest.mark.parametrize("phantom", ["jet", "homogeneous"])
def test_cameras_are_judged_without_it(phantom):
    """With it right images seemed to be of cameras that look elsewhere."""
    made = _made(phantom, coarser=2)
    top = max(image.max() for image in made.images.values())
    found = []
    for share in (0.0, 0.3):
        lit = {name: image + np.float32(share * top) for name, image in made.images.items()}
        scan = Scan.from_arrays(made.rig, lit, VoxelGrid((10, 20, 10), 2.0))
        options = Options(method="mlem", iterations=1, uncertainty=0, fit_absorption=False)
        findings = reconstruct(scan, options=options).findings
        found.append({(one.effect, one.camera) for one in findings})
    assert found[1] - found[0] == {("background", name) for name in made.rig.names}
    assert not found[0] - found[1]
