import numpy as np
import pytest
import torch

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.trace import Segments
from tomo.wernet.paper import RaySamples, epoch_batches

GRID = VoxelGrid((2, 4, 3), (0.5, 1.0, 2.0), (1000.0, -3.0, 7.0))


def _segments(midpoints=True):
    # Three pixels: two voxels, nothing, three voxels; midpoints at the voxels' centres, measured
    # from the grid's as tracers do.
    voxel = np.array([0, 13, 5, 17, 23], np.int32)
    centres = GRID.centers().reshape(-1, 3) - GRID.center
    return Segments(
        np.array([0, 2, 2, 5]),
        voxel,
        np.ones(5, np.float32),
        centres[voxel] if midpoints else None,
    )


def test_a_column_block_holds_indices_then_midpoints_on_one_scale():
    samples = RaySamples.from_segments(_segments(), GRID, [1.0, 2.0, 3.0])
    assert len(samples) == 2  # the pixel without a segment is left out
    assert samples.pixel.tolist() == [0, 2]
    batch = samples.padded(torch.tensor([1, 0]))
    assert batch.features.shape == (2, 6, 3)
    assert batch.measured.tolist() == [3.0, 1.0]
    assert batch.mask[:, 0].tolist() == [[1, 1, 1], [1, 1, 0]]
    assert batch.voxel[0].tolist() == [5, 17, 23]
    # A midpoint at a voxel's centre has its index's value, wherever in the world the grid is.
    torch.testing.assert_close(batch.features[:, :3], batch.features[:, 3:], rtol=0, atol=1e-6)
    assert (batch.features[1, :, 2] == 0).all()
    # Voxel 23 is (1, 3, 2): half a step, one and a half and one from the middle, over 4 / 2.
    torch.testing.assert_close(batch.features[0, :3, 2], torch.tensor([0.25, 0.75, 0.5]))


@pytest.mark.parametrize("inputs", ["absolute", "relative"])
def test_traced_rays_give_numbers_between_minus_one_and_one(scene, inputs):
    one = scene()
    samples = RaySamples.from_segments(one.projector.segments, one.grid, one.measured)
    absolute = samples.packed(torch.arange(len(samples))).features
    assert float(absolute.abs().max()) == pytest.approx(1, abs=0.1)
    # a midpoint lies in its voxel: half a voxel from its centre at most, along any axis
    apart = (absolute[:, 3:] - absolute[:, :3]).abs().max()
    assert float(apart) * max(one.grid.shape) / 2 == pytest.approx(0.5, abs=1e-3)
    samples = RaySamples.from_segments(
        one.projector.segments, one.grid, one.measured, inputs=inputs
    )
    features = samples.packed(torch.arange(len(samples))).features
    assert float(features.abs().max()) <= 1 + 1e-5


def test_relative_inputs_are_the_place_in_the_voxel_and_the_direction(scene):
    one = scene()
    given = one.projector.segments, one.grid, one.measured
    relative = RaySamples.from_segments(*given, inputs="relative")
    rays = torch.arange(0, len(relative), 7)
    batch = relative.packed(rays)
    entry = batch.packing.segment.numpy()
    midpoint = one.projector.segments.midpoint[entry].astype(np.float64)
    centre = one.grid.centers().reshape(-1, 3)[batch.voxel.numpy()] - one.grid.center
    place = 2 * (midpoint - centre) / one.grid.spacing
    found = batch.features[batch.packing.row].numpy()
    np.testing.assert_allclose(found[:, :3], place, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found[:, 3:], axis=1), 1, rtol=1e-5)
    # and a linear function of the absolute ones
    absolute = RaySamples.from_segments(*given).packed(rays).features[batch.packing.row].numpy()
    linear = (absolute[:, 3:] - absolute[:, :3]) * max(one.grid.shape)
    np.testing.assert_allclose(found[:, :3], linear, atol=1e-5)


@pytest.mark.parametrize("inputs", ["absolute", "relative"])
def test_padded_and_packed_batches_hold_the_same(scene, inputs):
    one = scene()
    samples = RaySamples.from_segments(
        one.projector.segments, one.grid, one.measured, inputs=inputs
    )
    rays = torch.randperm(len(samples), generator=torch.Generator().manual_seed(0))[:50]
    packed, padded = samples.packed(rays), samples.padded(rays)
    inside = padded.mask[:, 0] > 0
    assert torch.equal(inside.sum(dim=1), packed.packing.count)
    assert torch.equal(padded.voxel[inside], packed.voxel)
    assert torch.equal(padded.measured, packed.measured)
    rows = packed.features[packed.packing.row]
    assert torch.equal(padded.features.transpose(1, 2)[inside], rows)
    assert not packed.features[packed.packing.mask[:, 0] == 0].any()
    assert repr(packed) == f"<PackedBatch: 50 rays, {len(packed.voxel)} segments>"
    assert repr(padded) == f"<SampleBatch: 50 rays, padded to {inside.shape[1]} segments>"


@pytest.mark.parametrize("inputs", ["absolute", "relative"])
def test_active_voxels_are_numbered_and_seen_as_on_the_whole_grid(scene, inputs):
    one = scene()
    alive = np.zeros(one.grid.shape, bool)
    alive[2:7, 3:, ::2] = True
    active = ActiveVoxels(one.grid, np.flatnonzero(alive))
    segments = one.projector.segments
    some = segments.renumbered(active.number)
    whole = RaySamples.from_segments(segments, one.grid, one.measured)
    part = RaySamples.from_segments(some, one.grid, one.measured, active=active)
    assert len(part.index) == active.size < len(whole.index)
    assert torch.equal(part.index, whole.index[active.index])
    assert torch.equal(part.crossed(), whole.crossed()[active.index])
    kept = torch.from_numpy(alive.ravel()[segments.voxel])
    of_part, of_whole = (
        RaySamples.from_segments(one_of, one.grid, one.measured, inputs=inputs, active=voxels)
        for one_of, voxels in ((some, active), (segments, None))
    )
    features = [s.packed(torch.arange(len(s))) for s in (of_part, of_whole)]
    rows = [batch.features[batch.packing.row] for batch in features]
    columns = slice(0, 3) if inputs == "relative" else slice(0, 6)
    assert torch.equal(rows[0][:, columns], rows[1][kept][:, columns])


def test_wider_padding_adds_columns_only():
    samples = RaySamples.from_segments(_segments(), GRID, [1.0, 2.0, 3.0])
    narrow, wide = samples.padded(torch.arange(2)), samples.padded(torch.arange(2), width=7)
    assert torch.equal(wide.features[..., :3], narrow.features)
    assert not wide.features[..., 3:].any()
    assert not wide.mask[..., 3:].any()
    with pytest.raises(ValueError, match=r"width: found 2, expected at least 3"):
        samples.padded(torch.arange(2), width=2)


def test_crossed_voxels():
    crossed = RaySamples.from_segments(_segments(), GRID, np.ones(3)).crossed()
    assert np.flatnonzero(crossed.numpy()).tolist() == [0, 5, 13, 17, 23]


def test_an_epoch_uses_every_ray_once_in_a_seeded_order():
    def epoch(seed):
        return list(epoch_batches(1003, 100, torch.Generator().manual_seed(seed)))

    batches = epoch(3)
    assert [len(batch) for batch in batches] == [100] * 10 + [3]
    rays = torch.cat(batches)
    assert torch.equal(rays.sort().values, torch.arange(1003))
    assert torch.equal(rays, torch.cat(epoch(3)))
    assert not torch.equal(rays, torch.cat(epoch(4)))


def test_two_epochs_of_one_generator_differ():
    generator = torch.Generator().manual_seed(0)
    first, second = (torch.cat(list(epoch_batches(500, 100, generator))) for _ in range(2))
    assert not torch.equal(first, second)


@pytest.mark.parametrize(
    ("segments", "measured", "message"),
    [
        (_segments(midpoints=False), np.ones(3), "trace with midpoints=True"),
        (_segments(), np.ones(4), r"measured: found shape \(4,\), expected \(3,\)"),
        (_segments().rows(1, 2), np.ones(1), "at least one ray"),
    ],
)
def test_input_that_does_not_fit_is_refused(segments, measured, message):
    with pytest.raises(ValueError, match=message):
        RaySamples.from_segments(segments, GRID, measured)


def test_unknown_inputs_are_refused():
    with pytest.raises(ValueError, match="inputs: found 'polar', expected one of absolute, rel"):
        RaySamples.from_segments(_segments(), GRID, np.ones(3), inputs="polar")
