from dataclasses import replace

import numpy as np
import pytest
import torch

from tomo import Projector, VoxelGrid
from tomo.grid import ActiveVoxels
from tomo.operators import dot_test
from tomo.trace import Segments
from tomo.wernet import Encoder, RayFeatures, Rays, RayWeights
from tomo.wernet.weights import mean_of_voxels, reweighted

SHOWN = ("direction, x", "direction, z", "depth in the grid")


def _weights(projector, trained=True, shown=None):
    encoder = Encoder(blocks=1, channels=8, silent=True, shown=shown, seed=1)
    if trained:
        generator = torch.Generator().manual_seed(0)
        torch.nn.init.normal_(encoder.last.weight, 0, 0.3, generator=generator)
    random = np.random.default_rng(2)
    volume = random.random(projector.shape[1]).astype(np.float32)
    gauge = random.uniform(0.8, 1.2, projector.shape[1]).astype(np.float32)
    gauge = gauge if trained else np.ones_like(gauge)
    return RayWeights(encoder, volume, 8.0, RayFeatures.of(projector, "optics").image_scale, gauge)


def test_a_new_encoder_gives_the_projector_of_segment_lengths(scene):
    unweighted = scene().projector
    learned = _weights(unweighted, trained=False).projector(unweighted)
    assert np.array_equal(learned.segments.length, unweighted.segments.length)
    assert learned.segments.length.dtype == unweighted.segments.length.dtype
    assert np.array_equal(learned.segments.voxel, unweighted.segments.voxel)
    assert np.array_equal(learned.view_ptr, unweighted.view_ptr)


@pytest.mark.parametrize(("dtype", "bound"), [(np.float64, 1e-12), (np.float32, 1e-6)])
def test_the_learned_projector_has_its_adjoint(scene, dtype, bound):
    unweighted = scene().projector
    learned = _weights(unweighted).projector(unweighted)
    assert np.abs(learned.segments.length / unweighted.segments.length - 1).max() > 0.1
    for operator in (learned, learned.subset([2, 0]), learned.take(np.arange(0, 3000, 7))):
        assert max(dot_test(operator, seed, dtype) for seed in range(20)) < bound


def test_weights_are_lengths_times_one_plus_the_correction_squared_over_the_gauge(scene):
    unweighted = scene().projector
    weights, lengths = _weights(unweighted), unweighted.segments.length
    rays = Rays.of(unweighted, "optics").with_upstream(weights.volume, weights.unit)
    learned = weights.projector(unweighted)
    for ray in range(0, len(rays), 131):
        own, batch = slice(*unweighted.segments.ptr[ray : ray + 2]), rays.take(torch.tensor([ray]))
        with torch.no_grad():
            correction = weights.encoder(batch.features, batch.mask)[batch.row].numpy()
        expected = lengths[own] * (1 + correction) ** 2 / weights.gauge[batch.voxel]
        np.testing.assert_allclose(learned.segments.length[own], expected, rtol=1e-4, atol=1e-6)


def test_the_gauge_is_the_mean_of_a_voxel_s_weights():
    segments = Segments(
        np.array([0, 3, 5]), np.array([0, 1, 2, 1, 2], np.int32),
        np.array([1, 1, 1, 3, 0], np.float32), np.zeros((5, 3), np.float32),
    )  # fmt: skip
    lengths = Projector(segments, VoxelGrid((4, 1, 1), 1.0))
    found = mean_of_voxels(np.array([1, 0, -1, 1, 5], np.float32), lengths)
    # of 1 x 4; of 1 x 1 and 3 x 4; of nothing, because both are zero; of no segment
    np.testing.assert_allclose(found, [4, 13 / 4, 1, 1])
    assert reweighted(lengths, np.arange(5, dtype=np.float32)).segments.length.tolist() == [
        0, 1, 2, 9, 0,
    ]  # fmt: skip
    assert lengths.segments.length.tolist() == [1, 1, 1, 3, 0]


def test_a_view_s_weights_do_not_depend_on_other_views(scene):
    unweighted = scene().projector
    weights = _weights(unweighted)
    whole = weights.projector(unweighted)
    for views in ([0], [7, 2]):
        some = weights.projector(unweighted.subset(views)).segments.length
        np.testing.assert_allclose(some, whole.subset(views).segments.length, rtol=1e-5)


def test_pixels_that_cross_nothing_stay_empty(scene):
    one = scene()
    s = one.projector.segments
    gone = np.zeros(s.n_pixels, bool)
    gone[[0, 5, 6, 7, 500, s.n_pixels - 1]] = True
    counts = np.where(gone, 0, np.diff(s.ptr))
    kept = np.repeat(~gone, np.diff(s.ptr))
    some = Segments(
        np.concatenate([[0], np.cumsum(counts)]), s.voxel[kept], s.length[kept], s.midpoint[kept]
    )
    unweighted = Projector(some, one.grid, one.projector.view_ptr)
    scale = RayFeatures.of(one.projector, "optics").image_scale
    weights = replace(_weights(unweighted, shown=SHOWN), image_scale=scale)
    learned = weights.projector(unweighted)
    assert np.array_equal(learned.segments.ptr, some.ptr)
    whole = weights.projector(one.projector)
    np.testing.assert_allclose(  # to 4e-5: the view's middle is that of the rays it has
        learned.segments.length, whole.segments.length[kept], rtol=1e-4, atol=1e-7
    )


def test_active_voxels_stay(scene):
    one = scene()
    active = ActiveVoxels.from_mask(one.grid, one.truth > 0.05)
    part = one.projector.segments.renumbered(active.number)
    unweighted = Projector(part, one.grid, one.projector.view_ptr, active)
    learned = _weights(unweighted).projector(unweighted)
    assert learned.active is active
    assert learned.shape == unweighted.shape
    assert max(dot_test(learned, seed) for seed in range(5)) < 1e-12
