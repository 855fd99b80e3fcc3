from dataclasses import replace

import numpy as np
import pytest
import torch

import tomo.wernet
from rigs import ring
from tomo import LinearSystem, Projector, Rays, VoxelGrid
from tomo.grid import ActiveVoxels
from tomo.rays.ray_box import enter_box
from tomo.trace import Segments, trace
from tomo.wernet import OPTICS, RayFeatures
from tomo.wernet.features import ray_directions

DIRECTION, IMAGE = slice(0, 3), slice(3, 7)
DEPTH, UPSTREAM = 7, 8


def _seen(projector, inputs):
    """Return what an encoder sees of every segment, ``(S, F)``."""
    rays = tomo.wernet.Rays.of(projector, inputs)
    batch = rays.take(torch.arange(len(rays)))
    return batch.features[batch.row].numpy()


def _optics(projector, volume=None, unit=1.0):
    """Return the numbers of optics of every segment, ``(S, 9)``, upstream emission as well."""
    rays = tomo.wernet.Rays.of(projector, "optics")
    volume = np.ones(projector.shape[1], np.float32) if volume is None else volume
    batch = rays.with_upstream(volume, unit).take(torch.arange(len(rays)))
    return batch.features[batch.row].numpy()


def _same(found, expected):
    """Check that features are equal, angles in the image to a fraction of the field of view."""
    others = np.setdiff1d(np.arange(len(OPTICS)), np.r_[IMAGE])
    np.testing.assert_allclose(found[:, others], expected[:, others], atol=1e-5)
    # a short ray's two middles, in single precision, give its angle to a millionth or so
    np.testing.assert_allclose(found[:, IMAGE], expected[:, IMAGE], atol=1e-4)


def _system(rig, grid):
    return LinearSystem.from_rig(rig, grid, midpoints=True).projector


@pytest.mark.parametrize("offset", [(7.3, -2.9, 31.1), (1e4, -3e4, 2e4)])
def test_where_rig_and_grid_stand_together_changes_no_feature(scene, offset):
    one = scene()
    moved = one.rig.transformed(np.eye(3), np.asarray(offset))
    grid = VoxelGrid(one.grid.shape, one.grid.spacing, np.add(one.grid.center, offset))
    here, there = one.projector, _system(moved, grid)
    assert np.array_equal(here.segments.voxel, there.segments.voxel)
    _same(_optics(there), _optics(here))


@pytest.mark.parametrize("factor", [1e-3, 25.4])
def test_the_unit_of_length_changes_no_feature(scene, factor):
    one = scene()
    cameras = tuple(replace(camera, t=factor * camera.t) for camera in one.rig)
    spacing, center = np.multiply(one.grid.spacing, factor), np.multiply(one.grid.center, factor)
    other = _system(replace(one.rig, cameras=cameras), VoxelGrid(one.grid.shape, spacing, center))
    assert np.array_equal(one.projector.segments.voxel, other.segments.voxel)
    # "unit" is a pixel's: of as much emission per length it grows with the unit of length
    _same(_optics(other, unit=factor), _optics(one.projector))


def test_depth_grows_along_a_ray_from_minus_one_where_it_enters(scene):
    one = scene()
    found = _optics(one.projector)
    rays = Rays.concatenate(
        [Rays.from_camera(c, p) for c, p in zip(one.rig, one.system.pixels, strict=True)]
    )
    segments = one.projector.segments
    inside = enter_box(rays, one.grid)
    assert len(inside.length) == len(rays) == segments.n_pixels
    starts, counts = segments.ptr[:-1], np.diff(segments.ptr)
    depth = (found[:, DEPTH] + 1) * one.grid.extent.min() / 2  # in lengths, from the entry
    long = np.flatnonzero(counts >= 8)
    assert len(long) > 1000
    for ray in long[::17]:
        own = depth[starts[ray] : starts[ray] + counts[ray]]
        length = segments.length[starts[ray] : starts[ray] + counts[ray]].astype(np.float64)
        # the sum of the segment lengths from the entry on, which needs neither direction nor box
        expected = np.cumsum(length) - length / 2
        np.testing.assert_allclose(own, expected, atol=2e-4)
        assert (np.diff(own) > 0).all()
        assert own[-1] + length[-1] / 2 == pytest.approx(inside.length[ray], abs=2e-4)
    # the first middle is half a length behind the face of the box
    first = depth[starts[long]] - segments.length[starts[long]] / 2
    np.testing.assert_allclose(first, 0, atol=2e-4)


def test_a_ray_through_a_box_of_one_voxel_has_its_depth():
    grid = VoxelGrid((1, 1, 1), 2.0)
    origins = np.array([[-10.0, 0.0, 0.0], [-10.0, 0.5, 0.0]])
    segments = trace(Rays.from_lines(origins, np.array([[1.0, 0, 0]] * 2)), grid, midpoints=True)
    found = _optics(Projector(segments, grid))
    # a single segment each gives no direction: depth is then that of the box's middle
    assert not found[:, DIRECTION].any()
    assert np.isfinite(found).all()


def test_a_single_segment_takes_the_direction_and_depth_of_its_neighbour():
    grid = VoxelGrid((4, 4, 4), 1.0)
    # along x through the grid, and through one voxel at its corner in nearly the same direction
    origins = np.array([[-50.0, 0.3, 0.2], [-50.0, 1.9, 1.9]])
    directions = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    segments = trace(Rays.from_lines(origins, directions), grid, midpoints=True)
    one = Segments(
        np.array([0, 4, 5]), segments.voxel[:5], segments.length[:5], segments.midpoint[:5]
    )
    found = _optics(Projector(one, grid))
    np.testing.assert_allclose(found[:, DIRECTION], [[1, 0, 0]] * 5, atol=1e-6)
    np.testing.assert_allclose(found[:, DEPTH], [-0.75, -0.25, 0.25, 0.75, -0.75], atol=1e-6)


def test_active_voxels_give_the_features_of_the_whole_grid(scene):
    one = scene()
    alive = np.zeros(one.grid.size, bool)
    alive[np.flatnonzero(one.truth.ravel() > 0.05)] = True
    active = ActiveVoxels.from_mask(one.grid, alive)
    s = one.projector.segments
    part = Projector(s.renumbered(active.number), one.grid, one.projector.view_ptr, active)
    whole = _optics(one.projector, volume=(one.truth.ravel() * alive).astype(np.float32))
    found = _optics(part, volume=active.compress(one.truth).astype(np.float32))
    kept = alive[s.voxel]
    assert 0 < kept.sum() < len(kept)
    np.testing.assert_allclose(found[:, UPSTREAM], whole[kept][:, UPSTREAM], atol=1e-5)
    # fewer segments leave a direction less well known, but hardly
    same = (found[:, DIRECTION] * whole[kept][:, DIRECTION]).sum(axis=1)
    assert np.median(np.abs(1 - same)) < 1e-6
    near = np.repeat(np.diff(part.segments.ptr) >= 4, np.diff(part.segments.ptr))
    np.testing.assert_allclose(found[near][:, DEPTH], whole[kept][near][:, DEPTH], atol=1e-3)


def test_the_position_in_the_image_is_symmetric_and_one_at_most(scene):
    one = scene()
    found = _optics(one.projector)
    across, up = found[:, IMAGE.start], found[:, IMAGE.start + 1]
    assert max(np.abs(across).max(), np.abs(up).max()) == pytest.approx(1)
    np.testing.assert_allclose(found[:, 5:7], found[:, 3:5] ** 2, atol=1e-6)
    # columns of the image are distinguished by "across" alone, rows by "up"
    first = one.projector.view_ptr[1]
    pixels = one.system.pixels[0]
    width = one.rig[0].image_size[0]
    starts = one.projector.segments.ptr[:first]
    column, row = pixels % width, pixels // width
    np.testing.assert_allclose(np.abs(np.corrcoef(column, across[starts])[0, 1]), 1, atol=1e-3)
    np.testing.assert_allclose(np.abs(np.corrcoef(row, up[starts])[0, 1]), 1, atol=1e-3)


def test_directions_are_those_of_the_view_s_own_rays():
    """A pixel that crosses one voxel has the direction of a near one, but of no other camera."""
    rig = ring(2, 180.0, 300.0, image_size=(30, 30), footprint=0.5, pitch_degrees=[40.0, -40.0])
    projector = _system(rig, VoxelGrid((8, 8, 8), 1.0))
    assert (np.diff(projector.segments.ptr) == 1).any()
    for inputs in ("relative", "optics"):
        direction = RayFeatures.of(projector, inputs).of_ray.numpy()[:, :3]
        for view, camera in enumerate(rig):
            own = slice(*projector.view_ptr[view : view + 2])
            assert (direction[own] @ camera.R[2]).min() > 0.999


def test_rays_of_the_linear_basis_have_the_features_of_their_voxels(scene):
    one = scene()
    linear = one.system.with_linear_basis().projector.without_blur
    for inputs in ("absolute", "relative", "optics"):
        assert np.array_equal(_seen(linear, inputs), _seen(one.projector, inputs))


@pytest.mark.parametrize("moved", [0.0, 1000.0])
def test_absolute_inputs_are_indices_and_midpoints_on_one_scale(moved):
    """A midpoint at a voxel's centre has its index's value, wherever in the world the grid is."""
    grid = VoxelGrid((2, 4, 3), (0.5, 1.0, 2.0), (moved, -3.0, 7.0))
    middle = (grid.centers().reshape(-1, 3) - grid.center)[[0, 13, 23]]  # as tracers do
    some = Segments(
        np.array([0, 3]), np.array([0, 13, 23], np.int32), np.ones(3, np.float32), middle
    )
    found = _seen(Projector(some, grid), "absolute")
    np.testing.assert_allclose(found[:, :3], found[:, 3:], atol=1e-6)
    # Voxel 23 is (1, 3, 2): half a step, one and a half and one from the middle, over 4 / 2.
    np.testing.assert_allclose(found[2, :3], [0.25, 0.75, 0.5])


def test_relative_inputs_are_the_place_in_the_voxel_and_the_direction(scene):
    one = scene()
    segments, found = one.projector.segments, _seen(one.projector, "relative")
    centre = one.grid.centers().reshape(-1, 3)[segments.voxel] - one.grid.center
    place = 2 * (segments.midpoint.astype(np.float64) - centre) / one.grid.spacing
    np.testing.assert_allclose(found[:, 3:], place, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found[:, :3], axis=1), 1, rtol=1e-5)
    # and a linear function of the absolute ones
    absolute = _seen(one.projector, "absolute")
    linear = (absolute[:, 3:] - absolute[:, :3]) * max(one.grid.shape)
    np.testing.assert_allclose(found[:, 3:], linear, atol=1e-5)


@pytest.mark.parametrize(
    ("inputs", "columns"), [("absolute", slice(0, 6)), ("relative", slice(3, 6))]
)
def test_active_voxels_are_seen_as_on_the_whole_grid(scene, inputs, columns):
    one = scene()
    alive = np.zeros(one.grid.shape, bool)
    alive[2:7, 3:, ::2] = True
    active = ActiveVoxels(one.grid, np.flatnonzero(alive))
    segments = one.projector.segments
    part = Projector(segments.renumbered(active.number), one.grid, one.projector.view_ptr, active)
    kept = alive.ravel()[segments.voxel]
    found, whole = (_seen(each, inputs)[:, columns] for each in (part, one.projector))
    assert np.array_equal(found, whole[kept])


def _segments(*rays):
    """Return segments of rays given by their midpoints."""
    counts = [len(ray) for ray in rays]
    midpoint = np.array([m for ray in rays for m in ray], np.float32).reshape(-1, 3)
    ptr = np.cumsum([0, *counts])
    return Segments(ptr, np.zeros(ptr[-1], np.int32), np.ones(ptr[-1], np.float32), midpoint)


ALONG_X, ALONG_Z = [(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 0, 3), (0, 0, 1)]


def test_directions_are_those_of_the_cameras_rays(scene):
    one = scene()
    views = [one.projector.view(number) for number in range(len(one.rig))]
    found = np.concatenate([ray_directions(view.segments) for view in views])
    true = np.concatenate(
        [
            Rays.from_camera(c, p).directions
            for c, p in zip(one.rig, one.system.pixels, strict=True)
        ]
    )
    count = np.diff(one.projector.segments.ptr)
    many = count >= 8
    assert many.sum() > 1000
    np.testing.assert_allclose(found[many], true[many], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=1e-12)
    # a pixel with a single crossing has that of one near in number: in the image, at least
    across = one.rig[0].image_size[0] / one.rig[0].camera_matrix[0, 0]
    assert np.linalg.norm(found - true, axis=1).max() < across


@pytest.mark.parametrize(
    "short",
    [[(5, 5, 5)], [], [(5, 5, 5), (5, 5, 5)], [(5, 5, 5), (5, 5.0001, 5)]],
    ids=["one crossing", "none", "twice the same", "too near"],
)
def test_what_gives_no_direction_takes_the_nearest_pixel_s(short):
    found = ray_directions(_segments(ALONG_X, short, short, short, ALONG_Z, short))
    x, z = [1, 0, 0], [0, 0, -1]
    assert found[1].tolist() == x
    assert found[2].tolist() in (x, z)  # half way
    assert [row.tolist() for row in found[3:]] == [z, z, z]
    found = ray_directions(_segments(short, ALONG_Z))
    assert found.tolist() == [z, z]


def test_without_any_direction_all_are_zero():
    for rays in ([[(1, 2, 3)], [(4, 5, 6)]], [[], []], [[(0, 0, 0), (0, 0, 0)]]):
        assert not ray_directions(_segments(*rays)).any()
