"""Operators of rays over an aperture: one matrix in every form, and the optics behind it."""

from dataclasses import replace

import numpy as np
import pytest

import rigs
from rigs.scene import Glass, Scene, SceneCamera, Window
from tomo import LinearSystem, VoxelGrid
from tomo.operators import Absorption, dot_test, estimate_memory
from tomo.operators.lens_blur import disc_kernel
from tomo.rays import Rays
from tomo.rays.pixel_rays import points_of_aperture, rays_of_pixel
from tomo.trace import merging, trace, tracing

LENS = rigs.Optics(focal_length=50, f_number=2.8, focus_distance=300)
GRID = VoxelGrid((14, 11, 17), (3.0, 4.0, 3.5), (2.0, -1.0, 1.0))
RIG = rigs.ring(3, distance=300.0, image_size=(15, 11), footprint=5.0, pitch_degrees=[0, 20, -50])
LENSES = {
    "pinhole": rigs.Distortion(),
    "brown": rigs.Distortion("brown", (-0.3, 0.1, 0, 0)),
    "fisheye": rigs.Distortion("fisheye", (0.1, 0, 0, 0)),
}


def lab(kind, optics=LENS):
    if kind == "table":
        return rigs.Rig([rigs.RayTable.of(camera) for camera in lab("pinhole", optics)])
    return rigs.Rig([replace(one, optics=optics, distortion=LENSES[kind]) for one in RIG])


@pytest.mark.parametrize(
    ("kind", "supersample", "count"),
    [("pinhole", 1, 7), ("brown", 2, 16), ("fisheye", 1, 7), ("table", 2, 9)],
)
def test_stored_and_on_the_fly_are_one_matrix(kind, supersample, count):
    rig = lab(kind)
    how = {"supersample": supersample, "aperture_rays": count, "skip": False}
    stored, flying = (
        LinearSystem.from_rig(rig, GRID, form=form, **how).projector
        for form in ("stored", "on-the-fly")
    )
    random = np.random.default_rng(1)
    x, y = random.random(GRID.size), random.random(stored.shape[0])
    for one, other in ((stored @ x, flying @ x), (stored.T @ y, flying.T @ y)):
        assert np.abs(one - other).max() < 1e-6 * one.max()
    for projector in (stored, flying):
        assert dot_test(projector) < 1e-12
        assert dot_test(projector, dtype=np.float32) < 1e-6
    every = Rays.concatenate(Rays.from_camera(c, None, supersample, count) for c in rig)
    assert flying.n_segments == pytest.approx(len(trace(every, GRID)), rel=1e-3)
    some = np.sort(random.choice(len(y), 60, replace=False))
    assert np.array_equal(flying.take(some) @ x, (flying @ x)[some])
    assert np.array_equal(flying.rows(20, 300).rows(5, 90) @ x, (flying @ x)[25:110])


def test_a_pixel_s_weights_sum_to_one_and_each_position_has_the_whole_aperture():
    for supersample, count in ((1, 2), (1, 30), (3, 4), (2, 50)):
        points, weights = points_of_aperture(supersample, count)
        assert points.shape == (supersample**2, len(weights), 2)
        assert supersample**2 * len(weights) == rays_of_pixel(supersample, count) >= count
        np.testing.assert_allclose(np.einsum("kmi,m->ki", points, weights), 0, atol=1e-14)
        rays = Rays.from_camera(lab("brown")[0], np.array([3, 50]), supersample, count)
        np.testing.assert_allclose(np.add.reduceat(rays.weight, rays.pixel_ptr[:-1]), 1)
    with pytest.raises(ValueError, match=r"aperture_rays: found 2\.5, expected a whole number"):
        rays_of_pixel(1, 2.5)


def test_pixels_that_the_lens_does_not_reach_have_no_rays_over_the_aperture():
    folded = replace(
        lab("pinhole")[0],
        camera_matrix=[[5, 0, 7], [0, 5, 5], [0, 0, 1]],
        distortion=rigs.Distortion("brown", (-0.3, 0, 0, 0)),
    )
    chief, rays = Rays.from_camera(folded, None, 2), Rays.from_camera(folded, None, 2, 12)
    assert 0 in np.diff(chief.pixel_ptr)
    np.testing.assert_array_equal(rays.pixel_ptr, 3 * chief.pixel_ptr)
    sums = np.append(0, np.cumsum(rays.weight))[rays.pixel_ptr]
    np.testing.assert_allclose(np.diff(sums), np.diff(rays.pixel_ptr) > 0, atol=1e-12)


def test_merged_entries_add_up():
    rays = Rays.from_camera(lab("pinhole")[1], None, 1, 20)
    every, find = trace(rays, GRID), merging(tracing(GRID), GRID.size)
    for _ in range(2):  # the working memory is used again
        merged = find(rays)
        assert len(merged) < 0.6 * len(every)
        for pixel in (0, 82, 164):
            dense = []
            for segments in (every, merged):
                own = segments.rows(pixel, pixel + 1)
                dense.append(np.bincount(own.voxel, own.length, GRID.size))
                assert segments is every or len(np.unique(own.voxel)) == len(own)
            np.testing.assert_allclose(*dense, rtol=1e-6)


def test_the_memory_estimate_counts_rays_over_the_aperture():
    supersample, count = 2, 40
    rig, how = lab("pinhole"), {"supersample": supersample, "aperture_rays": count}
    for form in ("stored", "on-the-fly"):
        need = estimate_memory(tuple(rig), GRID, form=form, **how)
        system = LinearSystem.from_rig(rig, GRID, form=form, **how)
        assert need.segments == pytest.approx(system.projector.n_segments, rel=0.2)
    without = estimate_memory(tuple(rig), GRID, form=form, supersample=supersample)
    assert need.nbytes < 1.2 * without.nbytes  # rays over the aperture are not kept


def test_gas_absorbs_along_every_ray():
    how = {"aperture_rays": 12}
    systems = [
        LinearSystem.from_rig(lab("pinhole"), GRID, form=form, skip=False, **how).with_absorption(
            Absorption(medium=0.01), **how
        )
        for form in ("stored", "on-the-fly")
    ]
    x = np.random.default_rng(2).random(GRID.size)
    one, other = (system.projector @ x for system in systems)
    assert np.abs(one - other).max() < 1e-3 * one.max()
    clear = LinearSystem.from_rig(lab("pinhole"), GRID, skip=False, **how).projector @ x
    assert one.sum() < 0.9 * clear.sum()


DEPTH, FOCAL = 330.0, 900.0
DISC = 50 / 2.8 * (DEPTH / 300 - 1) * FOCAL / DEPTH  # diameter in pixels


def image_of(volume, grid, supersample, count):
    """Return what a camera at `DEPTH` sees of voxels, ``(41, 41)``."""
    matrix = [[FOCAL, 0, 20], [0, FOCAL, 20], [0, 0, 1]]
    rig = rigs.Rig([rigs.Camera("front", (41, 41), matrix, t=[0, 0, DEPTH], optics=LENS)])
    how = {"supersample": supersample, "aperture_rays": count, "skip": False}
    system = LinearSystem.from_rig(rig, grid, form="on-the-fly", **how)
    return (system.projector @ volume.ravel()).reshape(41, 41)


def test_a_small_sphere_out_of_focus_is_as_wide_as_its_circle_of_confusion():
    grid = VoxelGrid((25, 25, 25), 0.1)
    volume = np.linalg.norm(grid.centers(), axis=-1).reshape(grid.shape) < 1
    image, scale = image_of(volume.astype(float), grid, 4, 400), FOCAL / DEPTH
    steps = np.arange(41) - 20.0
    assert image.sum() == pytest.approx(volume.sum() * 0.1**3 * scale**2, rel=5e-3)
    found = (image.sum(axis=0) * steps**2).sum() / image.sum()
    of_sphere, of_pixel = scale**2 / 5, 1 / 12
    assert 4 * np.sqrt(found - of_sphere - of_pixel) == pytest.approx(DISC, rel=0.01)


def test_a_thin_object_is_blurred_by_one_disc():
    grid = VoxelGrid((320, 320, 1), 0.03125)
    x, y = np.moveaxis(grid.centers().reshape(320, 320, 1, 3)[..., :2], -1, 0)
    volume = np.exp(-((x - 1) ** 2 + y**2) / 2) + np.exp(-((x + 2) ** 2 + (y - 1) ** 2) / 4)
    # a disc's fraction in each pixel holds the pixel's area: sharp images must not
    sharp, blurred = image_of(volume, grid, 1, 1), image_of(volume, grid, 4, 400)
    offsets, weight = disc_kernel(DISC)
    expected = sum(
        w * np.roll(sharp, (row, column), axis=(0, 1))
        for (column, row), w in zip(offsets, weight, strict=True)
    )
    assert np.abs(blurred - expected).max() < 0.006 * blurred.max()
    assert np.abs(sharp - expected).max() > 0.1 * blurred.max()


def test_a_closed_aperture_is_a_pinhole():
    x = np.random.default_rng(3).random(GRID.size)
    closed = lab("brown", replace(LENS, f_number=1e7))
    one, other = (
        LinearSystem.from_rig(closed, GRID, skip=False, aperture_rays=n).projector @ x
        for n in (1, 5)
    )
    np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5)


def through_window(thickness, index, kind="pinhole"):
    """Return the rig behind plane-parallel windows across its optical axes."""
    cameras = []
    for one in lab(kind):
        point = one.position + 100 * one.R[2]
        window = Window("w", point, -one.R[2], thickness, Glass(index))
        cameras.append(SceneCamera(one, Scene((window,)), GRID.center))
    return rigs.Rig(cameras)


def test_a_window_shifts_the_plane_in_focus():
    """A plate moves the crossing of rays near the axis by ``t (1 - 1 / n)``."""
    rig = through_window(20.0, 1.5)
    slow = replace(LENS, f_number=40)
    camera = replace(rig[0], camera=replace(rig[0].camera, optics=slow))
    own, middle = camera.camera, np.array([5 * 15 + 7])
    rays = Rays.from_camera(camera, middle, 1, 24, GRID)
    assert len(rays) == 24  # the pieces in front of the window and in it miss the grid
    start = (rays.origins - own.position) @ own.R.T
    ahead = rays.directions @ own.R.T
    depth = 300 + 20 * (1 - 1 / 1.5)
    crossing = start + ahead * ((depth - start[:, 2]) / ahead[:, 2])[:, None]
    assert np.ptp(crossing, axis=0).max() < 1e-4
    at_300 = start + ahead * ((300 - start[:, 2]) / ahead[:, 2])[:, None]
    assert np.ptp(at_300, axis=0).max() > 0.02


def test_rays_over_the_aperture_are_one_matrix_through_a_scene_too():
    rig, how = through_window(20.0, 1.5, "brown"), {"aperture_rays": 8, "skip": False}
    stored, flying = (
        LinearSystem.from_rig(rig, GRID, form=form, **how).projector
        for form in ("stored", "on-the-fly")
    )
    x = np.random.default_rng(4).random(GRID.size)
    assert np.abs(stored @ x - flying @ x).max() < 1e-6 * (stored @ x).max()
    assert dot_test(flying) < 1e-12
    thin = LinearSystem.from_rig(through_window(1.0, 1.000001), GRID, **how).projector @ x
    none = LinearSystem.from_rig(lab("pinhole"), GRID, **how).projector @ x
    np.testing.assert_allclose(thin, none, rtol=1e-4, atol=1e-3)
