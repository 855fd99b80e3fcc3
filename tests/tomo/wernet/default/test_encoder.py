import pytest
import torch

from tomo.wernet import Packing
from tomo.wernet.default import CorrectionEncoder
from tomo.wernet.default.ray_features import FEATURES


def _trained(seed=0, **settings):
    """Return an encoder whose last layer is no longer zero."""
    encoder = CorrectionEncoder(seed=seed, **settings)
    torch.nn.init.normal_(encoder.last.weight, generator=torch.Generator().manual_seed(seed))
    return encoder


def _rays(counts=(9, 4, 1), seed=0):
    counts = torch.tensor(counts)
    packing = Packing.of(torch.cumsum(counts, 0) - counts, counts)
    generator = torch.Generator().manual_seed(seed)
    described = torch.randn(int(counts.sum()), len(FEATURES), generator=generator)
    return packing, described


@pytest.mark.parametrize("settings", [{}, {"blocks": 1, "channels": 3}, {"blocks": 4}])
def test_a_new_encoder_corrects_nothing(settings):
    packing, described = _rays()
    correction = CorrectionEncoder(**settings)(packing.to_rows(described), packing.mask)
    assert correction.shape == (len(packing.mask),)
    assert not correction.any()


def test_a_new_encoder_can_learn():
    # zero in the last layer only: its gradient is not zero, and then neither are the others'
    packing, described = _rays()
    encoder = CorrectionEncoder()
    encoder(packing.to_rows(described), packing.mask).square().sum().backward()
    encoder(packing.to_rows(described), packing.mask).sum().backward()
    assert encoder.last.weight.grad.abs().max() > 0
    encoder = _trained()
    encoder(packing.to_rows(described), packing.mask).sum().backward()
    assert all(p.grad.abs().max() > 0 for p in encoder.parameters())


def test_a_ray_s_correction_depends_on_that_ray_alone():
    encoder = _trained()
    packing, described = _rays()
    together = encoder(packing.to_rows(described), packing.mask)[packing.row]
    alone = Packing.of(torch.tensor([9]), torch.tensor([4]))
    found = encoder(alone.to_rows(described[9:13]), alone.mask)[alone.row]
    torch.testing.assert_close(found, together[9:13], rtol=1e-5, atol=1e-6)


def test_what_is_hidden_changes_nothing_and_stays_hidden_in_training():
    encoder, (packing, described) = _trained(), _rays()
    encoder.show_only(("upstream emission", "depth in the grid"))
    shown = [name in ("upstream emission", "depth in the grid") for name in FEATURES]
    other = torch.where(torch.tensor(shown), described, torch.randn(described.shape))

    def correction(features):
        return encoder(packing.to_rows(features), packing.mask)[packing.row]

    torch.testing.assert_close(correction(described), correction(other))
    before = encoder.hidden[0].weight.detach().clone()
    optimiser = torch.optim.Adam(encoder.parameters(), lr=0.1)
    gradients = torch.autograd.grad(correction(described).square().sum(), encoder.parameters())
    for parameter, gradient in zip(encoder.parameters(), gradients, strict=True):
        parameter.grad = gradient
    optimiser.step()
    changed = (encoder.hidden[0].weight != before).any(dim=2).any(dim=0)
    assert changed.tolist() == shown
    assert not encoder.hidden[0].weight[:, [not one for one in shown]].any()


@pytest.mark.parametrize(("blocks", "reach"), [(1, 2), (2, 3)])
def test_a_correction_sees_one_neighbour_more_with_every_layer(blocks, reach):
    encoder = _trained(blocks=blocks)
    packing, described = _rays((21,))
    described.requires_grad_()
    encoder(packing.to_rows(described), packing.mask)[packing.row][10].backward()
    seen = described.grad.abs().sum(dim=1).nonzero()[:, 0]
    assert seen.tolist() == list(range(10 - reach, 10 + reach + 1))


def test_the_seed_alone_decides_the_initial_weights():
    state = torch.get_rng_state()
    first = CorrectionEncoder(seed=5).state_dict()
    assert torch.equal(torch.get_rng_state(), state)
    second, other = CorrectionEncoder(seed=5).state_dict(), CorrectionEncoder(seed=6).state_dict()
    assert all(torch.equal(first[name], second[name]) for name in first)
    assert not torch.equal(first["hidden.0.weight"], other["hidden.0.weight"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"blocks": 0}, "blocks: found 0, expected a whole number >= 1"),
        ({"channels": 1.5}, "channels: found 1.5"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        CorrectionEncoder(**arguments)
