"""Scans of extreme brightness, without a flame, with wrong pixels, from afar and from inside."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

import phantoms
import rigs
from rigs import Camera, Distortion, look_at
from tomo import VoxelGrid, load_scan
from tomo.metrics import nrmse
from tomo.pipeline import Options, reconstruct
from tomo.scan import Corrections
from tomo.simulation import simulate_images

pytestmark = pytest.mark.usefixtures("quick_choices", "quick_solves")

PLACE = (15, 9)
APART = np.zeros((30, 18), bool)
APART[4:-4:3, 4:-4:3] = True  # no two beside each other


def jet(rig, grid, noise=0.0):
    field = phantoms.create("jet", 1, grid.extent, grid.center)
    return simulate_images(rig, field, grid, supersample=2, refine=2, noise=noise)


@pytest.fixture(scope="module")
def seen():
    rig = rigs.ring(
        7, distance=300.0, image_size=(18, 30), footprint=0.53,
        pitch_degrees=[-10.0, 10.0] * 3 + [-10.0],
    )  # fmt: skip
    return jet(rig, VoxelGrid((10, 22, 10), 0.6), noise=0.02)


@pytest.fixture
def scan_of(seen, tmp_path):
    """Return a function: a change of every image to the scan with the images so changed."""

    def make(change, corrections=None):
        random = np.random.default_rng(0)
        images = {name: change(image.copy(), random) for name, image in seen.images.items()}
        changed = replace(seen, images=MappingProxyType(images))
        scan = load_scan(changed.save(tmp_path / f"scan {len(list(tmp_path.iterdir()))}"))
        return scan if corrections is None else replace(scan, corrections=corrections)

    return make


def volume_of(scan, **settings):
    return reconstruct(scan, options=Options(**{"uncertainty": 0, **settings})).solution.volume


@pytest.fixture(scope="module")
def clean(seen, tmp_path_factory):
    """Return the volume of the images as they are."""
    return volume_of(load_scan(seen.save(tmp_path_factory.mktemp("clean") / "scan")))


@pytest.fixture(scope="module")
def clean_error(seen, clean):
    return nrmse(clean, seen.truth)


@pytest.mark.parametrize("factor", [1e-30, 1e30])
def test_the_default_scales_with_intensities_through_files(scan_of, clean, factor):
    scaled = scan_of(lambda image, _: (factor * image.astype(np.float64)).astype(np.float32))
    found = volume_of(scaled).astype(np.float64) / factor
    assert np.linalg.norm(found - clean) < 1e-5 * np.linalg.norm(clean)


NO_FLAME = {
    "zero": lambda image, _: np.zeros_like(image),
    "constant": lambda image, _: np.full_like(image, 3.0),
    "negative": lambda image, _: -1 - image,
    "partly negative": lambda image, _: image - 0.2 * image.max(),
    "alternating 1e30 and -1e30": lambda image, _: np.where(
        np.arange(image.size).reshape(image.shape) % 2, np.float32(1e30), np.float32(-1e30)
    ),
    "white noise": lambda image, random: random.standard_normal(image.shape, np.float32),
}


@pytest.mark.parametrize("kind", NO_FLAME)
def test_images_without_a_flame_give_a_finite_volume_or_one_line(scan_of, kind):
    scan = scan_of(NO_FLAME[kind])
    try:
        volume = volume_of(scan)
    except ValueError as error:
        line = str(error)
    else:
        line = "read"
        assert np.isfinite(volume).all()
        assert volume.min() >= 0
    assert len(line.splitlines()) == 1


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_pixel_that_is_no_number_is_refused_without_a_mask(scan_of, value):
    def change(image, _):
        image[PLACE] = value
        return image

    with pytest.raises(ValueError, match="1 NaN or infinite pixels"):
        volume_of(scan_of(change))


def brightest(seen):
    return max(float(image.max()) for image in seen.images.values())


def test_saturated_pixels_that_are_named_cost_little(scan_of, seen, clean_error):
    limit = np.float32(0.9 * brightest(seen))
    named = Corrections(saturation=0.999 * limit)
    found = volume_of(scan_of(lambda image, _: np.minimum(image, limit), named))
    assert nrmse(found, seen.truth) < 1.25 * clean_error


def test_a_core_that_is_saturated_in_every_view_is_warned_of(scan_of, seen):
    limit = np.float32(0.5 * brightest(seen))
    named = Corrections(saturation=0.999 * limit)
    outcome = reconstruct(
        scan_of(lambda image, _: np.minimum(image, limit), named), options=Options(uncertainty=0)
    )
    assert any("seen by no camera" in warning for warning in outcome.warnings)


def test_dead_and_hot_pixels_without_a_mask_cost_little(scan_of, seen, clean_error):
    levels = [0.0] * 3 + [1e6 * brightest(seen)] * 3

    def change(image, random):
        at = random.choice(np.argwhere(APART), len(levels), replace=False)
        image[*at.T] = levels
        return image

    assert nrmse(volume_of(scan_of(change)), seen.truth) < 1.5 * clean_error


def test_cameras_inside_the_grid_prove_nothing_empty_that_lies_behind_them(tmp_path, as_given):
    grid, cameras = VoxelGrid((24, 24, 24), 1.0), []
    for number in range(10):
        turn, height = 2 * np.pi * number / 10, 5.5 if number % 2 else -5.5
        position = np.array([11 * np.cos(turn), height, 11 * np.sin(turn)])
        lens = Distortion() if number % 3 else Distortion("fisheye", (0.05, 0, 0, 0))
        R, t = look_at(position, (0, 0, 0))
        matrix = [[30, 0, 23.5], [0, 30, 23.5], [0, 0, 1]]
        cameras.append(Camera(f"cam{number:02}", (48, 48), matrix, lens, R, t))

    def cloud(points):
        away = np.linalg.norm((points - (1, 2, -1)) / (3, 3.5, 3), axis=1)
        return np.exp(-2 * away**2) * (away < 2.2)

    made = simulate_images(rigs.Rig(tuple(cameras)), cloud, grid, supersample=2, refine=2)
    scan = load_scan(made.save(tmp_path / "scan"))
    skipped, whole = (
        nrmse(volume_of(scan, method="mlem", skip=skip, **as_given), made.truth)
        for skip in (True, False)
    )
    assert skipped < 1.1 * whole


def test_elsewhere_and_in_other_units_the_error_is_the_same(tmp_path):
    errors = []
    for number, (off, unit) in enumerate(((0.0, 1.0), (1e7, 1e-9), (0.0, 1e9))):
        center = off * 0.5 * unit * np.array([1, -0.6, 0.4])
        grid = VoxelGrid((16, 24, 16), 0.5 * unit, tuple(center))
        rig = rigs.ring(
            7, distance=300 * unit, image_size=(24, 35), footprint=0.45 * unit, pitch_degrees=10
        ).transformed(np.eye(3), grid.center)
        made = jet(rig, grid)
        errors.append(nrmse(volume_of(load_scan(made.save(tmp_path / str(number)))), made.truth))
    assert errors[1:] == pytest.approx([errors[0]] * 2, rel=1e-3)
