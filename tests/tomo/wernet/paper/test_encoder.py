import pytest
import torch
from torch import nn

from tomo.wernet import VARIANTS, Packing
from tomo.wernet.paper import WeightEncoder


def _rays(counts=(9, 4, 1), width=9, seed=0):
    """Return random features and the mask of rays with ``counts`` segments."""
    mask = (torch.arange(width) < torch.tensor(counts)[:, None]).float()[:, None, :]
    features = torch.randn(len(counts), 6, 9, generator=torch.Generator().manual_seed(seed))
    return nn.functional.pad(features, (0, width - 9)) * mask, mask


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("training", [True, False])
def test_padding_columns_change_nothing(variant, training):
    encoder = WeightEncoder(variant, seed=1).train(training)
    short = encoder(*_rays(width=9))
    long = encoder(*_rays(width=25))
    assert short.abs().max() > 1e-4  # there is something to compare
    torch.testing.assert_close(long[:, :9], short, rtol=1e-4, atol=1e-7)
    assert not long[:, 9:].any()


@pytest.mark.parametrize("variant", VARIANTS)
def test_padding_columns_leave_the_gradients_alone(variant):
    gradients = []
    for width in (9, 25):
        encoder = WeightEncoder(variant, seed=1)
        encoder(*_rays(width=width)).sum().backward()
        gradients.append([p.grad for p in encoder.parameters()])
    for narrow, wide in zip(*gradients, strict=True):
        torch.testing.assert_close(wide, narrow, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("variant", ["no-bias", "bias-mask"])
def test_a_rays_weights_do_not_depend_on_the_other_rays(variant):
    encoder = WeightEncoder(variant)
    features, mask = _rays()
    together = encoder(features, mask)
    alone = encoder(features[1:2, :, :4], mask[1:2, :, :4])
    torch.testing.assert_close(together[1:2, :4], alone, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("variant", VARIANTS)
def test_weights_are_at_least_zero_and_zero_in_the_padding(variant):
    features, mask = _rays(counts=(9, 4, 1) * 20)
    weights = WeightEncoder(variant)(features, mask)
    assert weights.shape == (60, 9)
    assert (weights >= 0).all()
    assert not weights[mask[:, 0] == 0].any()


def test_without_bias_zero_in_is_zero_out():
    features, mask = _rays()
    assert not WeightEncoder("no-bias")(features * 0, mask).any()


def test_batch_normalisation_agrees_with_pytorchs_on_the_entries_without_padding():
    encoder = WeightEncoder("batch-norm", blocks=1, channels=6)
    norm, twin = encoder.norms[0], nn.BatchNorm1d(6)
    features, mask = _rays(counts=(9, 4, 1))
    packed = features.transpose(1, 2)[mask[:, 0] > 0]  # (14, 6)
    found = norm(features, mask).transpose(1, 2)[mask[:, 0] > 0]
    torch.testing.assert_close(found, twin(packed), rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(norm.running_mean, twin.running_mean)
    torch.testing.assert_close(norm.running_var, twin.running_var)
    norm.eval(), twin.eval()
    found = norm(features, mask).transpose(1, 2)[mask[:, 0] > 0]
    torch.testing.assert_close(found, twin(packed), rtol=1e-4, atol=1e-5)


def _far(found, expected):
    """Return the largest difference, relative to the largest entry."""
    return float((found - expected).abs().max() / expected.abs().max())


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("training", [True, False])
def test_packed_rays_give_the_padded_ones_weights_and_gradients(variant, training):
    counts = torch.randint(1, 25, (60,), generator=torch.Generator().manual_seed(3))
    mask = (torch.arange(25) < counts[:, None]).float()[:, None, :]
    inside = mask[:, 0] > 0
    generator = torch.Generator().manual_seed(0)
    features = torch.randn(60, 6, 25, generator=generator) * mask
    upstream = torch.randn(int(counts.sum()), generator=generator)
    packing = Packing.of(torch.cumsum(counts, 0) - counts, counts)
    rows = packing.to_rows(features.transpose(1, 2)[inside])

    def results(packed):
        encoder = WeightEncoder(variant, seed=1)
        if variant == "batch-norm":  # statistics unlike those of a new encoder
            encoder(3 * features + 1, mask)
        encoder.train(training)
        if packed:
            weights = encoder(rows, packing.mask)
            assert not weights[packing.mask[:, 0] == 0].any()
            weights = weights[packing.row]
        else:
            weights = encoder(features, mask)[inside]
        weights.backward(upstream)
        buffers = [value for value in encoder.buffers()]
        return [weights.detach(), *(p.grad for p in encoder.parameters()), *buffers]

    for found, expected in zip(results(packed=True), results(packed=False), strict=True):
        assert _far(found, expected) < 1e-5


@pytest.mark.parametrize(("blocks", "reach"), [(1, 2), (3, 4)])
def test_a_weight_sees_one_neighbour_more_with_every_layer(blocks, reach):
    encoder = WeightEncoder("bias-mask", blocks=blocks)
    features = torch.randn(1, 6, 21, generator=torch.Generator().manual_seed(0))
    features.requires_grad_()
    encoder(features, torch.ones(1, 1, 21))[0, 10].backward()
    seen = features.grad[0].abs().sum(dim=0).nonzero().ravel()
    assert seen.tolist() == list(range(10 - reach, 10 + reach + 1))


def test_the_seed_alone_decides_the_initial_weights():
    state = torch.get_rng_state()
    first = WeightEncoder(seed=5).state_dict()
    torch.manual_seed(99)
    second, other = WeightEncoder(seed=5).state_dict(), WeightEncoder(seed=6).state_dict()
    torch.set_rng_state(state)
    WeightEncoder(seed=5)
    assert torch.equal(torch.get_rng_state(), state)
    assert all(torch.equal(first[name], second[name]) for name in first)
    assert not torch.equal(first["last.weight"], other["last.weight"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"variant": "layer-norm"}, "variant: found 'layer-norm', expected one of no-bias"),
        ({"blocks": 0}, "blocks: found 0"),
        ({"channels": 1.5}, "channels: found 1.5"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        WeightEncoder(**arguments)
