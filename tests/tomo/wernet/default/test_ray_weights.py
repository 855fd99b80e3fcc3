from dataclasses import replace

import numpy as np
import pytest
import torch

from tomo import Projector
from tomo.grid import ActiveVoxels
from tomo.operators import dot_test
from tomo.trace import Segments
from tomo.wernet.default import CorrectionEncoder, RayFeatures, RayWeights, ViewParameters
from tomo.wernet.default.compiled_forward import compiled_corrections
from tomo.wernet.default.ray_weights import packed_corrections, parametric_corrections, reweighted
from tomo.wernet.micro_batches import CPU_SEGMENTS


def _weights(projector, trained=True, per_view=True):
    encoder = CorrectionEncoder(blocks=1, channels=8, seed=1)
    view_parameters = ViewParameters(projector.n_views, 8)
    if trained:
        generator = torch.Generator().manual_seed(0)
        torch.nn.init.normal_(encoder.last.weight, 0, 0.3, generator=generator)
        torch.nn.init.normal_(view_parameters.coefficients, 0, 0.05, generator=generator)
        if per_view:
            torch.nn.init.normal_(view_parameters.embedding, 0, 0.3, generator=generator)
            torch.nn.init.normal_(view_parameters.log_gain, 0, 0.1, generator=generator)
    volume = np.random.default_rng(2).random(projector.shape[1]).astype(np.float32)
    return RayWeights(encoder, view_parameters, volume, 8.0, per_view)


def test_a_new_encoder_gives_the_projector_of_segment_lengths(scene):
    unweighted = scene().projector
    learned = _weights(unweighted, trained=False).projector(unweighted)
    assert np.array_equal(learned.segments.length, unweighted.segments.length)
    assert learned.segments.length.dtype == unweighted.segments.length.dtype
    assert np.array_equal(learned.segments.voxel, unweighted.segments.voxel)
    assert np.array_equal(learned.view_ptr, unweighted.view_ptr)
    volume = scene().truth.ravel()
    assert np.array_equal(learned @ volume, unweighted @ volume)


@pytest.mark.parametrize(("dtype", "bound"), [(np.float64, 1e-12), (np.float32, 1e-6)])
def test_the_learned_projector_has_its_adjoint(scene, dtype, bound):
    unweighted = scene().projector
    learned = _weights(unweighted).projector(unweighted)
    assert np.abs(learned.segments.length / unweighted.segments.length - 1).max() > 0.1
    for operator in (learned, learned.subset([2, 0]), learned.take(np.arange(0, 3000, 7))):
        assert max(dot_test(operator, seed, dtype) for seed in range(20)) < bound


def test_weights_are_lengths_times_one_plus_the_correction_squared(scene):
    unweighted = scene().projector
    weights = _weights(unweighted)
    features = RayFeatures.of(unweighted)
    upstream = features.upstream_emission(weights.volume, weights.unit)
    learned = weights.projector(unweighted)
    for ray in range(0, len(features), 131):
        one = torch.tensor([ray])
        packing, described = features.packed(one, upstream)
        view = int(features.view[ray])
        embedding = torch.zeros(len(packing.mask), 8) + weights.view_parameters.embedding[view]
        rows = packing.to_rows(described)
        with torch.no_grad():
            correction = weights.encoder(rows, packing.mask, embedding)[packing.row]
            terms = (
                described[:, 6],
                described[:, 12],
                features.off_axis[ray].expand(len(described)),
            )
            exponent = (
                weights.view_parameters.log_gain[view]
                + torch.stack(terms, 1) @ weights.view_parameters.coefficients
            )
            correction = (1 + correction) * torch.exp(exponent) - 1
        expected = unweighted.segments.length[packing.segment] * (1 + correction.numpy()) ** 2
        found = learned.segments.length[packing.segment]
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)
        with torch.no_grad():
            _, again = packed_corrections(
                weights.encoder, weights.view_parameters, features, upstream, one
            )
        np.testing.assert_allclose(again, correction, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(("blocks", "channels"), [(1, 8), (2, 16), (3, 5)])
def test_ray_by_ray_the_encoder_gives_what_it_gives_in_training(scene, blocks, channels):
    unweighted = scene().projector
    features = RayFeatures.of(unweighted)
    encoder, view_parameters = (
        CorrectionEncoder(blocks=blocks, channels=channels),
        ViewParameters(12, channels),
    )
    generator = torch.Generator().manual_seed(3)
    for parameter in (encoder.last.weight, encoder.last.bias, *view_parameters.parameters()):
        torch.nn.init.normal_(parameter, 0, 0.2, generator=generator)
    with torch.no_grad():
        encoder.hidden[0].weight[:, [2, 7]] = 0  # features that are not looked at
    volume = np.random.default_rng(2).random(unweighted.shape[1]).astype(np.float32)
    upstream = features.upstream_emission(volume, 8.0)
    crossing = features.count.nonzero()[:, 0]
    with torch.no_grad():
        packing, expected = packed_corrections(
            encoder, view_parameters, features, upstream, crossing
        )
    found = compiled_corrections(encoder, view_parameters, features, upstream)[packing.segment]
    assert found.std() > 0.1
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)


def test_an_encoder_of_zeros_leaves_trends_and_levels(scene):
    unweighted = scene().projector
    weights = _weights(unweighted)
    features = RayFeatures.of(unweighted)
    upstream = features.upstream_emission(weights.volume, weights.unit)
    plain = CorrectionEncoder(blocks=1, channels=8)
    crossing = features.count.nonzero()[:, 0]
    with torch.no_grad():
        packing, expected = packed_corrections(
            plain, weights.view_parameters, features, upstream, crossing
        )
    assert expected.abs().max() > 0.1
    found = parametric_corrections(weights.view_parameters, features, upstream)[packing.segment]
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)
    simple = RayWeights(plain, weights.view_parameters, weights.volume, weights.unit, True)
    lengths = unweighted.segments.length[packing.segment] * (1 + expected.numpy()) ** 2
    found = simple.projector(unweighted).segments.length[packing.segment]
    np.testing.assert_allclose(found, lengths, rtol=1e-4, atol=1e-6)
    _, described = features.packed(crossing, upstream)
    depth, emission, off_axis = (term[packing.segment] for term in features.terms(upstream))
    np.testing.assert_allclose(depth, described[:, 6], atol=1e-5)
    np.testing.assert_allclose(emission, described[:, 12], atol=1e-5)
    assert np.array_equal(off_axis, packing.per_segment(features.off_axis[crossing]))


def test_weights_are_at_least_zero():
    segments = Segments(
        np.array([0, 3]), np.arange(3, dtype=np.int32), np.ones(3, np.float32),
        np.zeros((3, 3), np.float32),
    )  # fmt: skip
    from tomo.grid import VoxelGrid

    unweighted = Projector(segments, VoxelGrid((3, 1, 1), 1.0))
    found = reweighted(unweighted, np.array([-3.0, -1.0, 0.5], np.float32))
    assert found.segments.length.tolist() == [4.0, 0.0, 2.25]
    assert unweighted.segments.length.tolist() == [1.0, 1.0, 1.0]


def test_the_same_bits_for_any_number_of_threads(scene, on_threads):
    unweighted = scene(image_size=(21, 30)).projector
    assert unweighted.n_segments > 4 * CPU_SEGMENTS
    found = []
    for threads in (1, 2, 4):
        with on_threads(threads):
            found.append(_weights(unweighted).projector(unweighted).segments.length)
            assert torch.get_num_threads() == threads
    assert all(np.array_equal(found[0], other) for other in found[1:])


def test_other_views_take_the_mean_of_what_is_each_view_s_own(scene):
    unweighted = scene().projector
    weights = _weights(unweighted)
    mean = weights.view_parameters.mean(unweighted.n_views)
    expected = RayWeights(weights.encoder, mean, weights.volume, weights.unit, True)
    found = weights.projector(unweighted, same_views=False).segments.length
    assert np.array_equal(found, expected.projector(unweighted).segments.length)
    assert not np.array_equal(found, weights.projector(unweighted).segments.length)
    fewer = unweighted.subset([1, 4])
    assert weights.projector(fewer, same_views=False).n_views == 2


def test_a_view_s_weights_do_not_depend_on_other_views(scene):
    unweighted = scene().projector
    weights = replace(_weights(unweighted), image_scale=RayFeatures.of(unweighted).image_scale)
    whole = weights.projector(unweighted, same_views=False)
    for view in (0, 1):
        alone = weights.projector(unweighted.subset([view]), same_views=False).segments.length
        np.testing.assert_allclose(alone, whole.subset([view]).segments.length, rtol=1e-5)


def test_without_numbers_of_their_own_views_do_not_matter(scene):
    unweighted = scene().projector
    weights = _weights(unweighted, per_view=False)
    whole = weights.projector(unweighted)
    some = [7, 2]
    for same_views in (True, False):
        found = weights.projector(unweighted.subset(some), same_views=same_views)
        np.testing.assert_allclose(
            found.segments.length, whole.subset(some).segments.length, rtol=1e-5, atol=1e-7
        )


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
    weights = _weights(unweighted, per_view=False)
    weights = replace(weights, image_scale=RayFeatures.of(one.projector).image_scale)
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


def test_repr_names_the_sizes(scene):
    text = repr(_weights(scene().projector))
    assert text == "<RayWeights: 12 views, {'blocks': 1, 'channels': 8}>"
