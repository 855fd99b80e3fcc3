"""The encoder: each ray's own numbers, whatever it is packed with."""

import pytest
import torch
from torch import nn

from tomo.wernet import OPTICS, VARIANTS, Encoder
from tomo.wernet.encoder import ROWS, MaskedBatchNorm


def give(encoder, batch):
    """Return what an encoder gives for every segment of a batch."""
    return encoder(batch.features, batch.mask)[batch.row]


@pytest.fixture
def rays(random_rays):
    return random_rays([9, 4, 1, 0, 30])


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("training", [True, False])
@pytest.mark.parametrize("rows", [ROWS - 100, ROWS - 1, ROWS, ROWS + 1])
def test_empty_rows_give_zero_and_change_nothing(rays, variant, training, rows):
    batch = rays.take(torch.arange(5))
    more = (0, 0, 0, rows - len(batch.mask))
    features, mask = (nn.functional.pad(one, more) for one in (batch.features, batch.mask))
    results = []
    for given in ((batch.features, batch.mask), (features, mask)):
        encoder = Encoder("relative", variant=variant, seed=1).train(training)
        found = encoder(*given)
        assert found.shape == (len(given[1]),)
        assert not found[given[1][:, 0] == 0].any()
        found[batch.row].sum().backward()
        results.append([found[batch.row].detach(), *(p.grad for p in encoder.parameters())])
        results[-1] += list(encoder.buffers())
    assert results[0][0].abs().max() > 1e-3  # there is something to compare
    for short, long in zip(*results, strict=True):
        torch.testing.assert_close(long, short, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("training", [True, False])
def test_a_ray_s_numbers_depend_on_that_ray_alone_but_for_batch_statistics(
    random_rays, variant, training
):
    rays = random_rays([9, 4, 1] + [7] * 200)
    encoder = Encoder("relative", variant=variant, seed=1).train(training)
    assert encoder.couples_rays == (variant == "batch-norm" and training)
    together = give(encoder, rays.take(torch.arange(203)))[9:13]
    alone = give(encoder, rays.take(torch.tensor([1])))
    apart = (together - alone).abs().max() / together.abs().max()
    assert (apart > 1e-2) == encoder.couples_rays
    assert (apart < 1e-5) != encoder.couples_rays


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_batch_normalisation_is_pytorchs_of_the_rows_of_segments(rays, dtype):
    batch = rays.take(torch.arange(5))
    x, mask = 3 * batch.features.to(dtype) + 1, batch.mask.to(dtype)
    norm, twin = MaskedBatchNorm(6).to(dtype), nn.BatchNorm1d(6, dtype=dtype)
    for training in (True, True, False):
        norm.train(training), twin.train(training)
        torch.testing.assert_close(norm(x, mask)[batch.row], twin(x[batch.row]))
        torch.testing.assert_close(norm.running_mean, twin.running_mean)
        torch.testing.assert_close(norm.running_var, twin.running_var)


def test_batch_normalisation_of_a_single_segment_is_finite(random_rays):
    batch = random_rays([1]).take(torch.arange(1))
    encoder = Encoder("relative", variant="batch-norm")
    assert give(encoder, batch).isfinite().all()
    assert all(value.isfinite().all() for value in encoder.state_dict().values())


@pytest.mark.parametrize(("blocks", "reach"), [(1, 2), (3, 4)])
def test_a_number_sees_one_neighbour_more_with_every_layer(random_rays, blocks, reach):
    batch = random_rays([21]).take(torch.arange(1))
    features = batch.features.requires_grad_()
    give(Encoder("relative", blocks=blocks), batch)[10].backward()
    seen = features.grad[batch.row].abs().sum(dim=1).nonzero()[:, 0]
    assert seen.tolist() == list(range(10 - reach, 10 + reach + 1))


@pytest.mark.parametrize("settings", [{}, {"blocks": 1, "channels": 3}, {"blocks": 4}])
def test_a_silent_encoder_gives_zero_and_can_learn(random_rays, settings):
    batch = random_rays([9, 4, 1], "optics").take(torch.arange(3))
    encoder = Encoder(silent=True, **settings)
    optimiser = torch.optim.SGD(encoder.parameters(), lr=0.1)
    assert not give(encoder, batch).any()
    for _ in range(2):  # the last layer learns at once, the others as soon as it is not zero
        optimiser.zero_grad()
        (give(encoder, batch) - 1).square().sum().backward()
        optimiser.step()
    assert all(p.grad.abs().max() > 0 for p in encoder.parameters())


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_last_bias_is_what_is_asked_for(variant):
    bias = Encoder("relative", variant=variant, last_bias=0.5).last.bias
    assert bias is None if variant == "no-bias" else bias.tolist() == [0.5]


def test_only_what_is_shown_is_seen_and_learned_from(random_rays):
    names = ("upstream emission", "depth in the grid")
    encoder = Encoder(shown=names, seed=1)
    assert encoder.settings["shown"] == names
    batch = random_rays([9, 4, 1], "optics").take(torch.arange(3))
    features = batch.features.requires_grad_()
    give(encoder, batch).square().sum().backward()
    shown = [name in names for name in OPTICS]
    assert features.grad.any(dim=0).tolist() == shown
    weight = encoder.hidden[0].weight
    assert weight.grad.any(dim=-1).any(dim=0)[:, 0].tolist() == shown


def test_the_seed_alone_decides_the_initial_weights():
    state = torch.get_rng_state()
    first = Encoder(seed=5).state_dict()
    assert torch.equal(torch.get_rng_state(), state)
    second, other = Encoder(seed=5).state_dict(), Encoder(seed=6).state_dict()
    assert all(torch.equal(first[name], second[name]) for name in first)
    assert not any(torch.equal(first[name], other[name]) for name in first)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"inputs": "polar"}, "inputs: found 'polar', expected one of absolute, relative, optics"),
        ({"variant": "layer-norm"}, "variant: found 'layer-norm', expected one of no-bias"),
        ({"blocks": 0}, "blocks: found 0, expected a whole number >= 1"),
        ({"channels": 1.5}, "channels: found 1.5"),
        ({"shown": ("colour",)}, "shown: found .'colour'., expected features of 'optics'"),
        ({"inputs": "relative", "shown": OPTICS[:1]}, "shown: found"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        Encoder(**arguments)
