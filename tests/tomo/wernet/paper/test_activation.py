import pytest
import torch
from torch import nn

from tomo.wernet.paper.activation import SLOPE, normalised_rectified, rectified

EMPTY = torch.tensor([0, 4, 5, 11])


def _case(rows=12, channels=3, dtype=torch.float64):
    generator = torch.Generator().manual_seed(0)

    def random(*shape):
        return torch.randn(*shape, generator=generator, dtype=dtype)

    inside = torch.ones(rows, dtype=torch.bool)
    inside[EMPTY] = False
    return 2 * random(rows, channels) + 1, random(channels), random(channels), inside


def test_rectified_rows_are_leaky_and_empty_ones_zero():
    rows, _, _, inside = _case()
    found = rectified(rows, EMPTY)
    expected = torch.where(rows > 0, rows, SLOPE * rows)
    assert torch.equal(found[inside], expected[inside])
    assert bool((rows < 0).any())
    assert not found[EMPTY].any()


def test_normalised_rows_are_pytorch_s_without_the_empty_ones():
    rows, weight, bias, inside = _case()
    twin = nn.BatchNorm1d(3, eps=1e-5, momentum=1.0, dtype=torch.float64)
    twin.weight.data, twin.bias.data = weight, bias
    expected = nn.functional.leaky_relu(twin(rows[inside]), SLOPE)
    found, mean, variance = normalised_rectified(rows, weight, bias, EMPTY, 1e-5)
    torch.testing.assert_close(found[inside], expected, rtol=1e-12, atol=1e-12)
    assert not found[EMPTY].any()
    torch.testing.assert_close(mean, twin.running_mean, rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(variance * 8 / 7, twin.running_var, rtol=1e-12, atol=1e-12)
    assert not mean.requires_grad
    assert not variance.requires_grad


def test_gradients_are_those_of_finite_differences():
    rows, weight, bias, _ = _case()
    inputs = [one.requires_grad_() for one in (rows, weight, bias)]
    exact = {"atol": 1e-6, "rtol": 1e-6}
    assert torch.autograd.gradcheck(lambda x: rectified(x, EMPTY), inputs[0], **exact)
    assert torch.autograd.gradcheck(
        lambda x, w, b: normalised_rectified(x, w, b, EMPTY, 1e-3)[0], inputs, **exact
    )


@pytest.mark.parametrize("normalised", [True, False])
def test_what_stands_in_an_empty_row_means_nothing(normalised):
    rows, weight, bias, _ = _case()
    found = []
    for filling in (0.0, 1e3):
        x = rows.clone()
        x[EMPTY] = filling
        x.requires_grad_()
        if normalised:
            out = normalised_rectified(x, weight, bias, EMPTY, 1e-5)[0]
        else:
            out = rectified(x, EMPTY)
        upstream = torch.arange(36.0, dtype=torch.float64).view(12, 3)
        found.append([out, *torch.autograd.grad(out, x, upstream)])
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-9)
    assert not found[0][1][EMPTY].any()


def test_the_arguments_stay_as_they_are():
    inputs = [one.requires_grad_() for one in _case()[:3]]
    before = [one.detach().clone() for one in inputs]
    out = normalised_rectified(*inputs, EMPTY, 1e-5)[0] + rectified(inputs[0], EMPTY)
    upstream = torch.ones_like(out)
    out.backward(upstream)
    assert all(torch.equal(one, copy) for one, copy in zip(inputs, before, strict=True))
    assert torch.equal(upstream, torch.ones_like(out))
