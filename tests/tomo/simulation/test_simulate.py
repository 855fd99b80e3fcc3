import sys

import numpy as np
import pytest

from phantoms import GaussianBlobs, SampledField, sample
from rigs import Camera, Rig
from rigs.camera import look_at
from tomo import Rays, VoxelGrid
from tomo.rays.ray_box import enter_box, pixels_that_see
from tomo.simulation import simulate_images
from tomo.simulation.effects import Effects

GRID = VoxelGrid((6, 8, 6), 1.0, (0.5, -1.0, 2.0))
BLOBS = GaussianBlobs([[0.9, -1.4, 2.2], [0.1, 0.3, 1.6]], [0.7, 0.6], [1.0, 2.0])


def camera(name, position, focal=900.0, size=(30, 40)):
    R, t = look_at(position, GRID.center)
    middle = [(side - 1) / 2 for side in size]
    K = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]])
    return Camera(name, size, K, R=R, t=t)


RIG = Rig((camera("side", (310.0, 43.0, 17.0)), camera("slant", (-120.0, 150.0, 250.0))))


def analytic(one_camera, supersample):
    """Return the mean over each pixel's rays of the exact integral."""
    rays = Rays.from_camera(one_camera, supersample=supersample)
    exact = BLOBS.line_integral(rays.origins, rays.directions).reshape(-1, supersample**2)
    width, height = one_camera.image_size
    return exact.mean(axis=1).reshape(height, width)


def test_projections_converge_to_the_analytic_integral_at_second_order():
    """Averaged over a pixel as wide as a voxel, first-order errors inside voxels cancel."""
    exact = {c.name: analytic(c, 4) for c in RIG}
    errors = []
    for refine in (2, 4, 8):
        scan = simulate_images(RIG, BLOBS, GRID, supersample=4, refine=refine)
        difference = [scan.images[name] - exact[name] for name in exact]
        errors.append(np.sqrt(np.mean(np.square(difference))))
    peak = max(image.max() for image in exact.values())
    assert errors[-1] < 2e-3 * peak
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (orders > 1.7).all(), (errors, orders)


def test_more_rays_a_pixel_approach_the_mean_over_its_area():
    fine = simulate_images(RIG, BLOBS, GRID, supersample=12, refine=4)
    errors = []
    for supersample in (1, 3):
        scan = simulate_images(RIG, BLOBS, GRID, supersample=supersample, refine=4)
        difference = [scan.images[name] - fine.images[name] for name in fine.images]
        errors.append(np.sqrt(np.mean(np.square(difference))))
    assert errors[1] < errors[0] / 3


def test_the_truth_is_the_mean_over_the_coarse_voxels():
    scan = simulate_images(RIG, BLOBS, GRID, refine=3)
    np.testing.assert_allclose(scan.truth, sample(BLOBS, GRID, refine=6), rtol=1e-5)
    assert scan.grid == GRID
    assert scan.truth.shape == GRID.shape
    assert scan.truth.dtype == np.float32


def test_a_stored_volume_projects_to_itself():
    volume = np.random.default_rng(0).random(GRID.shape).astype(np.float32)
    scan = simulate_images(RIG, SampledField(volume, GRID), GRID, refine=2)
    np.testing.assert_allclose(scan.truth, volume, rtol=1e-6)
    # brightness of a ray through an even volume is its length in the box
    even = simulate_images(RIG, SampledField(np.ones(GRID.shape), GRID), GRID)
    for one in RIG:
        length = enter_box(Rays.from_camera(one), GRID).length
        np.testing.assert_allclose(even.images[one.name].ravel(), length, rtol=1e-5, atol=1e-5)


def test_no_pixel_that_sees_the_box_is_left_out():
    for distance in (20.0, 300.0):
        one = camera("near", (distance, 5.0, 9.0), focal=40 * distance / 8, size=(60, 50))
        rays = Rays.from_camera(one, supersample=5)
        hits = (enter_box(rays, GRID).length > 0).reshape(-1, 25).any(axis=1)
        seen = pixels_that_see(one, GRID)
        assert set(np.flatnonzero(hits)) <= set(seen.tolist())
        assert hits.sum() < hits.size  # else the test shows nothing
        assert len(seen) < 1.7 * hits.sum() + 100
        assert (np.diff(seen) > 0).all()


def test_chunks_do_not_show(monkeypatch):
    effects = Effects(absorption=0.1, self_absorption=0.2, aperture=9.0, focus_distance=290.0)
    whole = simulate_images(RIG, BLOBS, GRID, supersample=2, effects=effects)
    monkeypatch.setattr(sys.modules["tomo.simulation.project"], "_SEGMENTS_AT_ONCE", 5000)
    calls = []
    parts = simulate_images(
        RIG, BLOBS, GRID, supersample=2, effects=effects, progress=lambda *a: calls.append(a)
    )
    for name in whole.images:
        np.testing.assert_array_equal(parts.images[name], whole.images[name])
    assert len(calls) > 10
    assert calls[-1][0] == calls[-1][1]
    assert {name for _, _, name in calls} == {"side", "slant"}


@pytest.mark.parametrize(
    "settings", [{"noise": 0.05}, {"photons": 500.0, "read_noise": 2.0}, {"noise": 0.1, "bits": 8}]
)
def test_seeds_are_reproducible_and_matter(settings):
    clean = simulate_images(RIG, BLOBS, GRID)
    first, again = (simulate_images(RIG, BLOBS, GRID, seed=3, **settings) for _ in range(2))
    other = simulate_images(RIG, BLOBS, GRID, seed=4, **settings)
    for name in clean.images:
        np.testing.assert_array_equal(first.images[name], again.images[name])
        assert np.abs(first.images[name] - other.images[name]).max() > 0
        assert np.abs(first.images[name] - clean.images[name]).max() > 0


@pytest.mark.parametrize("bits", [None, 8, 12])
def test_a_saved_scan_gives_back_images_and_truth(tmp_path, bits):
    from tomo import load_scan
    from tomo.io import read_volume

    simulated = simulate_images(RIG, BLOBS, GRID, bits=bits)
    simulated.save(tmp_path / "scan")
    scan = load_scan(tmp_path / "scan")
    assert scan.rig == RIG
    assert scan.grid == GRID
    for name, image in zip(RIG.names, scan.images(), strict=True):
        np.testing.assert_allclose(image, simulated.images[name], rtol=2e-6, atol=1e-7)
    truth, grid, unit = read_volume(scan.truth)
    np.testing.assert_array_equal(truth, simulated.truth)
    assert grid == GRID
    assert unit == "mm"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"noise": -1}, "noise: found -1"),
        ({"seed": -1}, "seed: found -1"),
        ({"photons": 0}, "photons: found 0"),
        ({"read_noise": 1}, "read_noise: found it without photons"),
        ({"bits": 17}, "bits: found 17"),
        ({"tracer": "foo"}, "tracer: found 'foo'"),
        ({"supersample": 0}, "supersample: found 0"),
        ({"refine": 0}, "refinement: found 0"),
    ],
)
def test_bad_arguments(settings, message):
    with pytest.raises(ValueError, match=message):
        simulate_images(RIG, BLOBS, GRID, **settings)


def test_a_volume_that_no_camera_sees_is_refused():
    elsewhere = VoxelGrid((3, 3, 3), 1.0, (0.0, 5000.0, 0.0))
    with pytest.raises(ValueError, match="no camera that sees the grid"):
        simulate_images(RIG, BLOBS, elsewhere)


def test_a_grid_that_does_not_fit_says_what_would():
    huge = VoxelGrid((30_000, 140_000, 30_000), 1e-4)
    with pytest.raises(ValueError, match=r"60000x280000x60000.* GB.* free; \d+x\d+x\d+ voxels"):
        simulate_images(RIG, BLOBS, huge, refine=2)
