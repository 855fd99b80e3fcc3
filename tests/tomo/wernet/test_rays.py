"""Rays as tensors, and some of them packed."""

from dataclasses import fields

import numpy as np
import pytest
import torch

from tomo import Projector, VoxelGrid
from tomo.grid import ActiveVoxels
from tomo.trace import Segments
from tomo.wernet import RayFeatures, Rays

START, COUNT = torch.tensor([7, 0, 3, 20]), torch.tensor([2, 3, 1, 4])


@pytest.fixture
def batch():
    """Return four rays whose segments lie apart, each numbered by its features."""
    number = torch.arange(24.0)[:, None]
    rays = Rays(
        START, COUNT, torch.arange(24), torch.ones(24), torch.tensor([0, 0, 1, 1]),
        RayFeatures(torch.zeros(4, 0), 1 + number), unknowns=24,
    )  # fmt: skip
    return rays.take(torch.arange(4))


def segments_of_three_pixels(midpoints=True):
    """Return two voxels, nothing and three voxels, and the grid."""
    grid = VoxelGrid((2, 4, 3), (0.5, 1.0, 2.0), (1000.0, -3.0, 7.0))
    voxel = np.array([0, 13, 5, 17, 23], np.int32)
    centres = (grid.centers().reshape(-1, 3) - grid.center)[voxel] if midpoints else None
    return Segments(np.array([0, 2, 2, 5]), voxel, np.ones(5, np.float32), centres), grid


def test_segments_rows_and_empty_rows(batch):
    assert batch.voxel.tolist() == [7, 8, 0, 1, 2, 3, 20, 21, 22, 23]
    assert batch.row.tolist() == [1, 2, 4, 5, 6, 8, 10, 11, 12, 13]
    assert batch.mask[:, 0].tolist() == [0, 1, 1, 0, 1, 1, 1, 0, 1, 0, 1, 1, 1, 1, 0]
    assert batch.features[batch.row, 0].tolist() == [1 + voxel for voxel in batch.voxel]
    assert not batch.features[batch.mask[:, 0] == 0].any()
    assert batch.view.tolist() == [0, 0, 1, 1]
    assert batch.squared_radius is None
    assert repr(batch) == "<RayBatch: 4 rays, 10 segments>"


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_sums_and_repeats_are_each_ray_s_own(batch, dtype):
    values = torch.arange(10, dtype=dtype)
    assert batch.sum(values).tolist() == [1, 9, 5, 30]
    assert batch.sum(values).dtype == dtype
    of_ray = torch.tensor([1.0, 2.0, 3.0, 4.0], dtype=dtype)
    assert batch.per_segment(of_ray).tolist() == [1, 1, 2, 2, 2, 3, 4, 4, 4, 4]
    assert batch.per_segment(torch.stack([of_ray, -of_ray], dim=1)).shape == (10, 2)


def test_what_is_before_a_segment_is_that_of_its_own_ray(batch):
    values = torch.arange(1.0, 11.0, dtype=torch.float64).requires_grad_()
    assert batch.before(values).tolist() == [0.5, 2, 1.5, 5, 9.5, 3, 3.5, 11, 19.5, 29]
    assert torch.autograd.gradcheck(batch.before, values, atol=1e-6)


@pytest.mark.parametrize("counts", [[], [0], [0, 0]])
def test_rays_without_segments_are_empty_rows(random_rays, counts):
    batch = random_rays(counts).take(torch.arange(len(counts)))
    assert not batch.mask.any()
    assert len(batch.mask) == len(counts) + 1
    assert batch.sum(torch.zeros(0)).tolist() == [0.0] * len(counts)


def test_parts_are_the_rays_taken_apart(random_rays):
    rays = random_rays([3, 0, 5, 1, 0, 4])
    order = torch.tensor([5, 1, 2, 0, 4, 3])
    parts = list(rays.take(order).split([1, 3, 2]))
    assert [len(part) for part in parts] == [1, 3, 2]
    for part, numbers in zip(parts, order.split([1, 3, 2]), strict=True):
        expected = rays.take(numbers)
        for field in fields(part):
            assert torch.equal(getattr(part, field.name), getattr(expected, field.name))


def test_numbers_beyond_the_rays_are_the_same_rays_in_the_next_frame(random_rays):
    rays = random_rays([3, 2, 4])
    first, third = rays.take(torch.tensor([2, 0])), rays.take(torch.tensor([8, 6]))
    assert torch.equal(third.voxel, first.voxel + 2 * rays.unknowns)
    assert third.number.tolist() == [8, 6]
    for name in ("count", "row", "features", "length", "view", "squared_radius"):
        assert torch.equal(getattr(third, name), getattr(first, name))


def test_rays_of_an_operator_are_its_pixels(scene):
    one = scene()
    radius = np.arange(one.projector.shape[0])
    rays, segments = Rays.of(one.projector, squared_radius=radius), one.projector.segments
    assert len(rays) == segments.n_pixels
    assert rays.unknowns == one.grid.size
    assert repr(rays) == (
        f"<Rays: {len(rays)} rays, {len(segments)} segments, <RayFeatures: 6 numbers a segment>>"
    )
    batch = rays.take(torch.tensor([2000, 3]))
    for ray, part in zip((2000, 3), batch.split([1, 1]), strict=True):
        own = slice(segments.ptr[ray], segments.ptr[ray + 1])
        assert np.array_equal(part.voxel, segments.voxel[own])
        assert np.array_equal(part.length, segments.length[own])
        assert part.view == np.searchsorted(one.projector.view_ptr, ray, "right") - 1
        assert part.squared_radius == ray
    rays.length.fill_(0)  # of a copy
    assert segments.length.any()


def test_a_lens_blur_is_left_out(scene):
    one = scene()
    sharp, blurred = (
        Rays.of(each) for each in (one.projector, one.system.with_lens_blur(3.0).projector)
    )
    assert torch.equal(blurred.voxel, sharp.voxel)
    assert torch.equal(blurred.length, sharp.length)


def test_rays_that_cross_and_voxels_that_are_crossed():
    segments, grid = segments_of_three_pixels()
    rays = Rays.of(Projector(segments, grid))
    assert rays.crossing.tolist() == [0, 2]
    assert rays.crossed().nonzero()[:, 0].tolist() == [0, 5, 13, 17, 23]


def test_active_voxels_are_numbered_as_unknowns(scene):
    one = scene()
    alive = np.zeros(one.grid.shape, bool)
    alive[2:7, 3:, ::2] = True
    active = ActiveVoxels(one.grid, np.flatnonzero(alive))
    some = one.projector.segments.renumbered(active.number)
    part = Rays.of(Projector(some, one.grid, one.projector.view_ptr, active))
    whole = Rays.of(one.projector)
    assert part.unknowns == active.size < whole.unknowns
    assert torch.equal(part.crossed(), whole.crossed()[active.index])


def test_upstream_emission_is_the_sum_of_a_loop(scene):
    one = scene(views=3)
    segments, random = one.projector.segments, np.random.default_rng(0)
    volume = random.random(one.grid.size).astype(np.float32)
    rays = Rays.of(one.projector, "optics")
    found = rays.with_upstream(volume, 2.5).features.of_segment[:, -1]
    assert not rays.features.of_segment[:, -1].any()  # the first rays are as they were
    for pixel in range(0, segments.n_pixels, 13):
        light = 0.0
        for entry in range(segments.ptr[pixel], segments.ptr[pixel + 1]):
            own = float(segments.length[entry]) * float(volume[segments.voxel[entry]])
            assert found[entry] == pytest.approx((light + own / 2) / 2.5, rel=1e-5)
            light += own


@pytest.mark.parametrize(
    ("given", "arguments", "message"),
    [
        (segments_of_three_pixels(midpoints=False)[0], {}, "trace with midpoints=True"),
        (segments_of_three_pixels()[0].rows(1, 2), {}, "segments: found none, expected at least"),
        (
            segments_of_three_pixels()[0],
            {"inputs": "polar"},
            "inputs: found 'polar', expected one",
        ),
        (
            segments_of_three_pixels()[0],
            {"squared_radius": np.ones(4)},
            r"squared_radius: found shape \(4,\), expected \(3,\)",
        ),
    ],
)
def test_input_that_does_not_fit_is_refused(given, arguments, message):
    grid = segments_of_three_pixels()[1]
    with pytest.raises(ValueError, match=message) as caught:
        Rays.of(Projector(given, grid), **arguments)
    assert "\n" not in str(caught.value)
