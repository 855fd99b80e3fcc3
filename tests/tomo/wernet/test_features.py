from dataclasses import replace

import numpy as np
import pytest
import torch

from rigs import ring
from tomo import LinearSystem, Projector, Rays, VoxelGrid
from tomo.grid import ActiveVoxels
from tomo.rays.ray_box import enter_box
from tomo.trace import Segments, trace
from tomo.wernet.default import RayFeatures
from tomo.wernet.default.ray_features import FEATURES

DIRECTION, IMAGE = slice(0, 3), slice(3, 7)
DEPTH, UPSTREAM = 7, 8


def _all(projector, volume=None, unit=1.0):
    """Return packing and features of every ray that crosses the grid."""
    features = RayFeatures.of(projector)
    volume = np.ones(projector.shape[1], np.float32) if volume is None else volume
    upstream = features.upstream_emission(volume, unit)
    packing, described = features.packed(features.count.nonzero()[:, 0], upstream)
    return packing, described.numpy()


def _same(found, expected):
    """Check that features are equal, angles in the image to a fraction of the field of view."""
    others = np.setdiff1d(np.arange(len(FEATURES)), np.r_[IMAGE])
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
    _same(_all(there)[1], _all(here)[1])


@pytest.mark.parametrize("factor", [1e-3, 25.4])
def test_the_unit_of_length_changes_no_feature(scene, factor):
    one = scene()
    cameras = tuple(replace(camera, t=factor * camera.t) for camera in one.rig)
    spacing, center = np.multiply(one.grid.spacing, factor), np.multiply(one.grid.center, factor)
    other = _system(replace(one.rig, cameras=cameras), VoxelGrid(one.grid.shape, spacing, center))
    assert np.array_equal(one.projector.segments.voxel, other.segments.voxel)
    # "unit" is a pixel's: of as much emission per length it grows with the unit of length
    _same(_all(other, unit=factor)[1], _all(one.projector)[1])


def test_the_order_of_the_views_changes_no_ray_s_features(scene):
    one = scene()
    order = [5, 0, 11, 3]
    _, together = _all(one.projector)
    _, other = _all(one.projector.subset(order))
    counts = [one.projector.view(v).n_segments for v in range(one.projector.n_views)]
    first = np.cumsum([0, *counts])
    expected = np.concatenate([together[first[v] : first[v + 1]] for v in order])
    _same(other, expected)


def test_depth_grows_along_a_ray_from_minus_one_where_it_enters(scene):
    one = scene()
    packing, found = _all(one.projector)
    rays = Rays.concatenate(
        [Rays.from_camera(c, p) for c, p in zip(one.rig, one.system.pixels, strict=True)]
    )
    segments = one.projector.segments
    inside = enter_box(rays, one.grid)
    assert len(inside.length) == len(rays) == segments.n_pixels
    starts = np.cumsum(packing.count.numpy()) - packing.count.numpy()
    depth = (found[:, DEPTH] + 1) * one.grid.extent.min() / 2  # in lengths, from the entry
    counts = packing.count.numpy()
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
    _, found = _all(Projector(segments, grid))
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
        np.array([0, 4, 5]),
        segments.voxel[:5],
        segments.length[:5],
        segments.midpoint[:5],
    )
    _, found = _all(Projector(one, grid))
    np.testing.assert_allclose(found[:, DIRECTION], [[1, 0, 0]] * 5, atol=1e-6)
    np.testing.assert_allclose(found[:, DEPTH], [-0.75, -0.25, 0.25, 0.75, -0.75], atol=1e-6)


@pytest.mark.parametrize("weighted", [False, True])
def test_upstream_emission_is_the_sum_of_a_loop(scene, weighted):
    one = scene(views=3)
    segments = one.projector.segments
    random = np.random.default_rng(0)
    volume = random.random(one.grid.size).astype(np.float32)
    weight = random.random(len(segments)).astype(np.float32)
    features = RayFeatures.of(one.projector)
    if weighted:
        features = replace(features, length=torch.from_numpy(weight))
    found = features.upstream_emission(volume, 2.5).numpy()
    assert found.dtype == np.float32
    length = weight if weighted else segments.length
    for pixel in range(0, segments.n_pixels, 13):
        light = 0.0
        for entry in range(segments.ptr[pixel], segments.ptr[pixel + 1]):
            own = float(length[entry]) * float(volume[segments.voxel[entry]])
            assert found[entry] == pytest.approx((light + own / 2) / 2.5, rel=1e-5)
            light += own


def test_active_voxels_give_the_features_of_the_whole_grid(scene):
    one = scene()
    alive = np.zeros(one.grid.size, bool)
    alive[np.flatnonzero(one.truth.ravel() > 0.05)] = True
    active = ActiveVoxels.from_mask(one.grid, alive)
    s = one.projector.segments
    part = Projector(s.renumbered(active.number), one.grid, one.projector.view_ptr, active)
    _, whole = _all(one.projector, volume=one.truth.ravel() * alive)
    _, found = _all(part, volume=active.compress(one.truth).astype(np.float32))
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
    packing, found = _all(one.projector)
    across, up = found[:, IMAGE.start], found[:, IMAGE.start + 1]
    assert max(np.abs(across).max(), np.abs(up).max()) == pytest.approx(1)
    np.testing.assert_allclose(found[:, 5:7], found[:, 3:5] ** 2, atol=1e-6)
    # columns of the image are distinguished by "across" alone, rows by "up"
    first = one.projector.view_ptr[1]
    pixels = one.system.pixels[0]
    width = one.rig[0].image_size[0]
    starts = (torch.cumsum(packing.count, 0) - packing.count).numpy()[:first]
    column, row = pixels % width, pixels // width
    np.testing.assert_allclose(np.abs(np.corrcoef(column, across[starts])[0, 1]), 1, atol=1e-3)
    np.testing.assert_allclose(np.abs(np.corrcoef(row, up[starts])[0, 1]), 1, atol=1e-3)


def test_directions_are_those_of_the_view_s_own_rays():
    """A pixel that crosses one voxel has the direction of a near one, but of no other camera."""
    rig = ring(2, 180.0, 300.0, image_size=(30, 30), footprint=0.5, pitch_degrees=[40.0, -40.0])
    features = RayFeatures.of(_system(rig, VoxelGrid((8, 8, 8), 1.0)))
    ptr = _system(rig, VoxelGrid((8, 8, 8), 1.0)).view_ptr
    for camera, (start, stop) in zip(rig, np.stack([ptr[:-1], ptr[1:]], axis=1), strict=True):
        cosine = features.of_ray.numpy()[start:stop, :3] @ camera.R[2]
        assert cosine.min() > 0.999
    assert (features.count == 1).any()


def test_rays_of_the_linear_basis_have_the_features_of_their_voxels(scene):
    one = scene()
    linear = RayFeatures.of(one.system.with_linear_basis().projector)
    voxels = RayFeatures.of(one.projector)
    for name in ("of_ray", "depth", "length", "voxel"):
        assert torch.equal(getattr(linear, name), getattr(voxels, name))


def test_segments_without_midpoints_are_refused(scene):
    one = scene()
    s = one.projector.segments
    with pytest.raises(ValueError, match=r"midpoint: found none.*midpoints=True"):
        RayFeatures.of(Projector(Segments(s.ptr, s.voxel, s.length), one.grid))


def test_repr_names_the_sizes(scene):
    rays, segments = scene().projector.shape[0], scene().projector.n_segments
    text = repr(RayFeatures.of(scene().projector))
    assert text == f"<RayFeatures: {rays} rays, {segments} segments>"
