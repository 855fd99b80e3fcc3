import pytest
import torch
from torch.nn import functional

from tomo.wernet import packed_convolution


def _case(rows, into=3, out=4, dtype=torch.float64):
    generator = torch.Generator().manual_seed(0)

    def random(*shape):
        return torch.randn(*shape, generator=generator, dtype=dtype).requires_grad_()

    return random(rows, into), random(out, into, 3), random(out)


@pytest.mark.parametrize("rows", [1, 2, 9])
@pytest.mark.parametrize("bias", [True, False])
def test_it_is_pytorch_s_convolution_with_padding_one(rows, bias):
    x, weight, offset = _case(rows)
    given = (weight, offset) if bias else (weight, None)
    expected = functional.conv1d(x.T[None], *given, padding=1)[0].T
    torch.testing.assert_close(packed_convolution(x, *given), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("rows", [1, 2, 7])
@pytest.mark.parametrize("bias", [True, False])
def test_its_gradients_are_those_of_finite_differences(rows, bias):
    inputs = _case(rows) if bias else _case(rows)[:2]
    assert torch.autograd.gradcheck(packed_convolution, inputs, atol=1e-6, rtol=1e-6)


@pytest.mark.parametrize("wanted", [0, 1, 2])
def test_only_the_gradients_asked_for_are_there_and_are_the_same(wanted):
    inputs = _case(6)
    together = torch.autograd.grad(packed_convolution(*inputs).square().sum(), inputs)
    alone = [one.detach().requires_grad_(place == wanted) for place, one in enumerate(inputs)]
    packed_convolution(*alone).square().sum().backward()
    for place, one in enumerate(alone):
        if place == wanted:
            torch.testing.assert_close(one.grad, together[place], rtol=1e-12, atol=1e-12)
        else:
            assert one.grad is None


def test_rows_next_to_an_empty_one_do_not_see_past_it():
    x, weight, bias = _case(7)
    with torch.no_grad():
        x[3] = 0
        whole = packed_convolution(x, weight, bias)
        above, below = packed_convolution(x[:3], weight, bias), x[4:]
        torch.testing.assert_close(whole[:3], above, rtol=1e-12, atol=1e-12)
        expected = packed_convolution(below, weight, bias)
        torch.testing.assert_close(whole[4:], expected, rtol=1e-12, atol=1e-12)


def test_the_arguments_stay_as_they_are():
    inputs = _case(5)
    before = [one.detach().clone() for one in inputs]
    packed_convolution(*inputs).sum().backward()
    assert all(torch.equal(one, copy) for one, copy in zip(inputs, before, strict=True))
