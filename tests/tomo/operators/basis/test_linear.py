"""The linear basis against images of linear and of smooth emission, integrated by hand."""

import numpy as np
import pytest
import scipy.ndimage

import phantoms
import rigs
from tomo import LinearSystem, VoxelGrid, solvers
from tomo.grid import ActiveVoxels
from tomo.metrics import cosine_distance
from tomo.operators import LinearBasis, voxel_means
from tomo.rays import Rays

GRID = VoxelGrid((12, 10, 11), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))


def rig_of(footprint, views=2):
    """Cameras that look along no face of a voxel: its edges would fall on whole rows of pixels."""
    return rigs.ring(
        views,
        pitch_degrees=[20.0, -35.0, 5.0][:views],
        start_degrees=17.0,
        **at_the_grid(footprint),
    )


def at_the_grid(footprint):
    side = int(18 / footprint) // 2 * 2 + 1
    return {
        "distance": 400.0, "image_size": (side, side), "footprint": footprint,
        "center": GRID.center,
    }  # fmt: skip


def system_of(footprint, **how):
    return LinearSystem.from_rig(rig_of(footprint), GRID, skip=False, **how)


def integrated(emission, rig, rays_a_side=3):
    """The mean over each pixel of line integrals, by steps of a tenth of a voxel."""
    images = []
    for camera in rig:
        rays = Rays.from_camera(camera, None, rays_a_side)
        lengths = np.linspace(-9, 9, 181) + np.linalg.norm(camera.position - GRID.center)
        total = np.zeros(len(rays.origins))
        for s in lengths:
            total += emission(rays.origins + s * rays.directions)
        images.append(total.reshape(-1, rays_a_side**2).mean(axis=1) * (lengths[1] - lengths[0]))
    return np.concatenate(images)


def linear(coefficients):
    """The emission of coefficients, which falls to zero within a voxel beyond the outermost."""
    padded = np.pad(coefficients, 1)
    shape = np.array(coefficients.shape)

    def emission(points):
        places = np.clip((points - GRID.lower) / GRID.spacing + 0.5, 0, shape + 1)
        return scipy.ndimage.map_coordinates(padded, places.T, order=1, mode="nearest")

    return emission


def bump():
    """Coefficients of a smooth flame that is zero at the grid's faces."""
    axes = [np.linspace(-1, 1, n) for n in GRID.shape]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    return np.exp(-6 * ((x - 0.1) ** 2 + y**2 + (z + 0.2) ** 2)) * (
        1 + 0.5 * np.sin(5 * x + 3 * z)
    )


def apart(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


@pytest.mark.parametrize(("footprint", "bound"), [(0.15, 0.001), (0.3, 0.003), (0.5, 0.004)])
def test_pixels_see_emission_that_is_linear_between_centres(footprint, bound):
    coefficients = bump()
    system = system_of(footprint)
    seen = integrated(linear(coefficients), system.rig)
    found = system.with_linear_basis().projector @ coefficients.ravel()
    voxels = system.projector @ voxel_means(coefficients).ravel()
    assert apart(found, seen) < bound
    assert apart(voxels, seen) > 0.04


@pytest.mark.parametrize(("footprint", "bound"), [(0.3, 0.35), (0.5, 0.49)])
def test_a_camera_that_looks_along_faces_sees_less_of_edges(footprint, bound):
    coefficients = bump()
    rig = rigs.ring(2, pitch_degrees=0.0, **at_the_grid(footprint))
    system = LinearSystem.from_rig(rig, GRID, skip=False)
    seen = integrated(linear(coefficients), rig)
    found = system.with_linear_basis().projector @ coefficients.ravel()
    voxels = system.projector @ voxel_means(coefficients).ravel()
    assert apart(found, seen) < bound * apart(voxels, seen)


def test_a_single_hat_has_its_light_and_its_size():
    coefficients = np.zeros(GRID.shape)
    coefficients[6, 5, 4] = 1.0
    system = system_of(0.3)
    seen = integrated(linear(coefficients), system.rig, 2)
    found = system.with_linear_basis().projector @ coefficients.ravel()
    assert found.sum() == pytest.approx(seen.sum(), rel=0.03)
    width = system.rig[0].image_size[0]
    place = np.stack(np.divmod(np.arange(width**2), width))
    for image in (slice(0, width**2), slice(width**2, 2 * width**2)):
        variance = [np.trace(np.cov(place, aweights=one[image])) for one in (found, seen)]
        assert variance[0] == pytest.approx(variance[1], rel=0.05)


def test_rays_of_one_pixel_divide_its_area():
    coefficients = bump()
    for supersample in (2, 3):
        system = system_of(0.8, supersample=supersample)
        seen = integrated(linear(coefficients), system.rig)
        found = system.with_linear_basis(supersample).projector @ coefficients.ravel()
        assert apart(found, seen) < 0.013


@pytest.mark.parametrize("masked", [False, True])
def test_a_volume_of_means_shows_what_its_coefficients_show(masked):
    mask = bump() > 0.1 if masked else np.ones(GRID.shape, bool)
    basis = system_of(0.7, active=ActiveVoxels.from_mask(GRID, mask)).with_linear_basis().projector
    coefficients = np.where(mask, bump(), 0)
    means = basis.voxel_means(coefficients)
    shown = basis.on_voxel_means @ basis.on_voxel_means.active.compress(means)
    np.testing.assert_allclose(
        shown, basis @ basis.active.compress(coefficients), atol=1e-6 * shown.max()
    )
    left = basis.on_voxel_means.active.expand(basis.on_voxel_means.active.compress(means))
    np.testing.assert_allclose(left.reshape(GRID.shape), means, atol=1e-12)


def test_parts_stay_in_the_linear_basis():
    basis = system_of(0.7).with_linear_basis().projector
    length = basis.without_blur.segments.length * 2
    for part in (basis.view(0), basis.take(np.arange(5, 90)), basis.with_lengths(length)):
        assert isinstance(part, LinearBasis)
    ones = np.ones(GRID.size)
    np.testing.assert_allclose(basis.with_lengths(length) @ ones, 2 * (basis @ ones), rtol=1e-6)


def test_rows_sum_to_one_at_the_images_edge_and_next_to_bad_pixels():
    rig = rig_of(0.7)
    masks = [
        np.random.default_rng(n).random(camera.image_size[::-1]) > 0.2
        for n, camera in enumerate(rig)
    ]
    system = LinearSystem.from_rig(rig, GRID, masks=masks, skip=False)
    blur = system.with_linear_basis().projector.projector.images
    sums = blur @ np.ones(blur.shape[1])
    np.testing.assert_allclose(sums, system.projector.row_sums > 0, rtol=1e-6)
    assert min(weight.min() for _, weight in blur.kernels) > 0
    assert blur.own.min() > -1e-6  # the rest to one, rounded


@pytest.mark.parametrize("footprint", [0.05, 0.3])
def test_the_kernel_has_the_variance_of_footprint_and_pixel_area(footprint):
    rig = (
        rig_of(footprint, views=1)
        if footprint > 0.1
        else rigs.ring(
            1, distance=400.0, image_size=(80, 80), footprint=footprint, center=GRID.center
        )
    )
    camera = rig[0]
    width, height = camera.image_size
    middle = height // 2 * width + width // 2
    system = LinearSystem.from_rig(rig, GRID, skip=False)
    (row,) = np.flatnonzero(system.pixels[0] == middle)
    blur = system.with_linear_basis().projector.projector.images
    weights = blur.T @ (np.arange(blur.shape[0]) == row)
    place = np.stack([system.pixels[0] % width, system.pixels[0] // width], 1) - [
        width // 2, height // 2
    ]  # fmt: skip
    np.testing.assert_allclose(weights @ place, 0, atol=1e-6)
    turned = camera.R @ np.diag(np.square(GRID.spacing)) @ camera.R.T
    expected = (np.trace(turned[:2, :2]) / footprint**2 + 2) / 12
    assert weights @ np.square(place).sum(axis=1) == pytest.approx(expected, rel=0.01)


def test_a_reconstructed_flame_is_nearer_to_the_truth():
    field = phantoms.GaussianBlobs(
        np.add(GRID.center, [[0.0, 0.0, 0.0], [1.5, -1.0, 0.5]]), [1.3, 1.1], [1.0, 0.7]
    )
    rig = rigs.ring(
        9, distance=400.0, image_size=(48, 48), footprint=0.4, center=GRID.center,
        pitch_degrees=[25.0, -25.0, 0.0] * 3,
    )  # fmt: skip
    rays = [Rays.from_camera(camera, None, 4) for camera in rig]
    measured = np.concatenate(
        [
            field.line_integral(some.origins, some.directions).reshape(-1, 16).mean(axis=1)
            for some in rays
        ]
    ).astype(np.float32)
    truth = GRID.average(field(GRID.refined(6).centers()), 6)
    system = LinearSystem.from_rig(rig, GRID, skip=False)
    basis = system.with_linear_basis().projector
    voxels = solvers.nnls(system.projector, measured, iterations=40).volume
    found = voxel_means(solvers.nnls(basis, measured, iterations=40).volume)
    assert cosine_distance(found, truth) < 0.2 * cosine_distance(voxels, truth)
    assert found.sum() == pytest.approx(truth.sum(), rel=2e-3)
