"""Images that show no flame, one voxel, twelve decades, or hardly any of a voxel: every method."""

from dataclasses import replace

import numpy as np
import pytest

import phantoms
import rigs
from tomo import LinearSystem, VoxelGrid, solvers
from tomo.hull import carve
from tomo.metrics import nrmse
from tomo.operators.on_the_fly import OnTheFlyProjector
from tomo.operators.on_the_fly.camera_sources import pixel_source
from tomo.simulation import simulate_images

BY_PIXEL = ("art", "mart")
SMOOTHING = ("curvature", "tikhonov", "tv")
SIGNED = ("art", "cgls", "curvature", "nnls", "sart", "sirt", "tikhonov", "tv")
ITERATIONS = 10
SETTLED = 100  # iterations that gather one voxel's light

every_method = pytest.mark.parametrize("method", solvers.METHODS)
CASES = [(m, f) for m in solvers.METHODS for f in ("stored", "on the fly") if m not in BY_PIXEL]
every_case = pytest.mark.parametrize(
    ("method", "form"), [*CASES, *((method, "stored") for method in BY_PIXEL)]
)


def jet(views, seed=1, noise=0.0, noise_seed=0, grid=None, **camera):
    """Return what so many cameras of 24 x 40 pixels see of a jet."""
    grid = VoxelGrid((12, 28, 12), 0.5) if grid is None else grid
    camera = {"distance": 300.0, "image_size": (24, 40), "footprint": 0.4} | camera
    rig = rigs.ring(
        views, pitch_degrees=[-10.0 if n % 2 else 10.0 for n in range(views)], **camera
    )
    field = phantoms.create("jet", seed, grid.extent, grid.center)
    return simulate_images(rig, field, grid, supersample=2, refine=2, noise=noise, seed=noise_seed)


@pytest.fixture(scope="module")
def seen():
    return jet(9, noise=0.02)


@pytest.fixture(scope="module")
def forms(seen):
    """Return the same matrix stored and on the fly."""
    system = LinearSystem.from_rig(seen.rig, seen.grid, form="stored")
    flying = OnTheFlyProjector(list(map(pixel_source, seen.rig, system.pixels)), seen.grid)
    return {"stored": system.projector, "on the fly": flying}


@pytest.fixture(scope="module")
def measured(seen):
    system = LinearSystem.from_rig(seen.rig, seen.grid, form="stored")
    return system.flatten(list(seen.images.values()))


def run(method, projector, measured, iterations=ITERATIONS, **settings):
    return getattr(solvers, method)(projector, measured, iterations=iterations, **settings)


def without_flame(pixels):
    """Return what may stand where a flame was measured: arrays like ``pixels``."""
    odd = np.arange(pixels.size).reshape(pixels.shape) % 2
    return {
        "constant": np.full(pixels.shape, 3.0),
        "negative": -1 - pixels,
        "partly negative": pixels - 0.2 * pixels.max(),
        "alternating 1e12 and 1": np.where(odd, 1e12, 1.0),
        "alternating 1e30 and -1e30": np.where(odd, 1e30, -1e30),
        "white noise": np.random.default_rng(0).standard_normal(pixels.shape),
    }


@every_case
def test_images_without_a_flame_give_a_finite_volume_that_is_not_negative(
    forms, measured, method, form
):
    for name, pixels in without_flame(measured).items():
        volume = run(method, forms[form], pixels).volume
        assert np.isfinite(volume).all(), name
        assert volume.min() >= 0, name


@pytest.mark.parametrize("method", SIGNED)
def test_without_the_bound_negative_images_give_the_negative_volume(forms, measured, method):
    found, mirrored = (
        run(method, forms["stored"], sign * measured, nonnegative=False).volume for sign in (1, -1)
    )
    np.testing.assert_array_equal(mirrored, -found)


@every_method
def test_the_brightest_pixels_of_single_precision_are_solved_or_refused(forms, measured, method):
    try:
        volume = run(method, forms["stored"], np.full(len(measured), 3e38)).volume
    except ValueError:
        return
    assert np.isfinite(volume).all()
    assert volume.min() >= 0


@every_method
def test_a_half_a_million_million_times_as_dim_costs_the_bright_half_nothing(forms, seen, method):
    projector, truth = forms["stored"], seen.truth
    upper = truth.copy()
    upper[:, : truth.shape[1] // 2] = 0
    both = upper + np.float32(1e-12) * (truth - upper)
    alone, uneven = (
        nrmse(run(method, projector, projector @ volume.ravel()).volume, volume)
        for volume in (upper, both)
    )
    assert uneven < 1.05 * alone


@every_method
def test_one_bright_voxel_is_found_at_its_place_with_its_emission(forms, seen, method):
    projector, volume = forms["stored"], np.zeros(seen.grid.shape, np.float32)
    place = tuple(n // 2 + 1 for n in seen.grid.shape)
    volume[place] = 1e6
    plain = {"strength": 0.0} if method in SMOOTHING else {}
    found = run(method, projector, projector @ volume.ravel(), SETTLED, **plain).volume
    assert np.unravel_index(np.argmax(found), found.shape) == place
    assert found[place] == pytest.approx(1e6, rel=0.03)


@pytest.fixture(scope="module", params=[1, 2])
def grazed(request):
    """Return noisy images and what carving left of voxels that some rays hardly meet."""
    seen = jet(5, request.param, noise=0.1, noise_seed=request.param)
    images = list(seen.images.values())
    carving = carve(tuple(seen.rig), images, None, seen.grid)
    system = LinearSystem.from_rig(
        seen.rig, seen.grid, masks=carving.pixels, active=carving.active, form="stored"
    )
    rows = system.projector.row_sums
    assert rows[rows > 0].min() < 0.05 * np.median(rows)
    return system.projector, system.flatten(images), seen.truth


@pytest.mark.parametrize(
    ("method", "settings"),
    [*((m, {}) for m in solvers.METHODS), ("sirt", {"subsets": 8}), ("mlem", {"subsets": 8})],
)
def test_the_noise_of_rays_that_graze_what_carving_left_throws_no_voxel_off(
    grazed, method, settings
):
    projector, measured, truth = grazed
    assert run(method, projector, measured, **settings).volume.max() < 5 * truth.max()


@pytest.mark.parametrize("method", [m for m in solvers.METHODS if m not in (*BY_PIXEL, "sart")])
def test_every_camera_twice_at_its_place_changes_nothing(method):
    """SART goes view by view: the order of views matters to it."""
    seen = jet(5, noise=0.02)
    cameras = [c for camera in seen.rig for c in (camera, replace(camera, name=f"{camera.name}b"))]
    once, twice = (
        LinearSystem.from_rig(rig, seen.grid, form="stored")
        for rig in (seen.rig, replace(seen.rig, cameras=tuple(cameras)))
    )
    images = list(seen.images.values())
    doubled = [image for image in images for _ in range(2)]
    found = run(method, twice.projector, twice.flatten(doubled)).volume
    expected = run(method, once.projector, once.flatten(images)).volume
    assert np.linalg.norm(found - expected) < 1e-5 * np.linalg.norm(expected)
