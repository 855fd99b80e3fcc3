import numpy as np
import pytest
import torch

from tomo.grid import VoxelGrid
from tomo.segments import Segments
from tomo.wernet import RaySamples, epoch_batches

GRID = VoxelGrid((2, 4, 3), (0.5, 1.0, 2.0), (1000.0, -3.0, 7.0))


def _segments(midpoints=True):
    # Three pixels: two voxels, nothing, three voxels; midpoints at the voxels' centres.
    voxel = np.array([0, 13, 5, 17, 23], np.int32)
    centres = GRID.centers().reshape(-1, 3)
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
        return list(epoch_batches(1003, 4, 25, torch.Generator().manual_seed(seed)))

    batches = epoch(3)
    assert [len(batch) for batch in batches] == [100] * 10 + [3]
    rays = torch.cat(batches)
    assert torch.equal(rays.sort().values, torch.arange(1003))
    assert torch.equal(rays, torch.cat(epoch(3)))
    assert not torch.equal(rays, torch.cat(epoch(4)))


def test_two_epochs_of_one_generator_differ():
    generator = torch.Generator().manual_seed(0)
    first, second = (torch.cat(list(epoch_batches(500, 1, 100, generator))) for _ in range(2))
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
