import pytest
import torch

from tomo.wernet import Packing
from tomo.wernet.paper import packed_sum, weighted_sum


def _case(dtype=torch.float64):
    generator = torch.Generator().manual_seed(1)
    weights = torch.rand(4, 5, generator=generator, dtype=dtype)
    weights[1, 3:] = 0  # a shorter ray, padded
    voxels = torch.rand(7, generator=generator, dtype=dtype)
    index = torch.randint(0, 7, (4, 5), generator=generator)
    return weights.requires_grad_(), voxels.requires_grad_(), index


def _packed_case():
    """Return `_case` with the padding left out, and its packing."""
    weights, voxels, index = _case()
    inside = weights.detach() != 0
    assert inside.sum(dim=1).tolist() == [5, 3, 5, 5]
    count = inside.sum(dim=1)
    packing = Packing.of(torch.cumsum(count, 0) - count, count)
    return weights.detach()[inside].requires_grad_(), voxels, index[inside], packing, inside


@pytest.mark.parametrize("normalise_gradient", [True, False])
def test_packed_and_padded_sums_and_gradients_are_the_same(normalise_gradient):
    weights, voxels, index = _case()
    upstream = torch.tensor([1.0, -2.0, 0.5, 3.0], dtype=torch.float64)
    padded = weighted_sum(weights, voxels, index, normalise_gradient)
    expected = torch.autograd.grad(padded, (weights, voxels), upstream)
    some, voxels, index, packing, inside = _packed_case()
    packed = packed_sum(some, voxels, index, packing, normalise_gradient)
    found = torch.autograd.grad(packed, (some, voxels), upstream)
    torch.testing.assert_close(packed, padded, rtol=1e-12, atol=0)
    torch.testing.assert_close(found[0], expected[0][inside], rtol=1e-12, atol=0)
    torch.testing.assert_close(found[1], expected[1], rtol=1e-12, atol=1e-15)


def test_the_plain_packed_form_is_the_true_gradient():
    weights, voxels, index, packing, _ = _packed_case()
    assert torch.autograd.gradcheck(
        lambda w, x: packed_sum(w, x, index, packing, normalise_gradient=False),
        (weights, voxels),
        atol=1e-6,
        rtol=1e-6,
    )


def test_the_normalised_packed_form_is_the_plain_one_over_each_ray_s_norm():
    weights, voxels, index, packing, _ = _packed_case()
    norm = packing.sum(weights.detach().square()).sqrt()
    upstream = torch.tensor([1.0, -2.0, 0.5, 3.0], dtype=torch.float64)
    inputs = weights, voxels
    normalised = torch.autograd.grad(packed_sum(*inputs, index, packing), inputs, upstream)
    plain = packed_sum(*inputs, index, packing, normalise_gradient=False)
    divided = torch.autograd.grad(plain, inputs, upstream / norm, retain_graph=True)
    undivided = torch.autograd.grad(plain, inputs, upstream)
    torch.testing.assert_close(normalised[1], divided[1], rtol=1e-12, atol=1e-15)
    torch.testing.assert_close(normalised[0], undivided[0], rtol=1e-12, atol=0)
    assert (normalised[1] - undivided[1]).abs().max() > 0.1


def test_a_packed_ray_without_any_weight_sends_back_zero():
    packing = Packing.of(torch.tensor([0, 2]), torch.tensor([2, 3]))
    weights = torch.tensor([0.0, 0.0, 1.0, 0.0, 2.0], requires_grad=True)
    voxels = torch.ones(5, requires_grad=True)
    packed_sum(weights, voxels, torch.arange(5), packing).sum().backward()
    assert voxels.grad[:2].tolist() == [0, 0]
    assert voxels.grad[2:].norm().item() == pytest.approx(1)


@pytest.mark.parametrize("normalise_gradient", [True, False])
def test_forward_is_the_weighted_sum(normalise_gradient):
    weights, voxels, index = _case()
    found = weighted_sum(weights, voxels, index, normalise_gradient)
    for ray in range(4):
        expected = sum(weights[ray, j] * voxels[index[ray, j]] for j in range(5))
        torch.testing.assert_close(found[ray], expected)


def test_the_plain_form_is_the_true_gradient():
    weights, voxels, index = _case()
    assert torch.autograd.gradcheck(
        lambda w, x: weighted_sum(w, x, index, normalise_gradient=False), (weights, voxels)
    )


def test_the_normalised_form_divides_the_voxels_gradient_by_the_norm_of_the_rays_weights():
    weights, voxels, index = _case()
    upstream = torch.tensor([1.0, -2.0, 0.5, 3.0], dtype=torch.float64)
    weighted_sum(weights, voxels, index).backward(upstream)
    to_voxels = torch.zeros(7, dtype=torch.float64)
    for ray in range(4):
        norm = weights[ray].detach().square().sum().sqrt()
        for j in range(5):
            to_voxels[index[ray, j]] += upstream[ray] * weights[ray, j].detach() / norm
    torch.testing.assert_close(voxels.grad, to_voxels)
    torch.testing.assert_close(weights.grad, upstream[:, None] * voxels.detach()[index])


def test_larger_weights_do_not_enlarge_the_normalised_step():
    steps = []
    for factor in (1.0, 1000.0):
        weights, voxels, index = _case()
        weighted_sum(weights * factor, voxels, index).sum().backward()
        steps.append(voxels.grad)
    torch.testing.assert_close(steps[0], steps[1])


def test_a_ray_without_any_weight_sends_back_zero():
    voxels = torch.ones(3, requires_grad=True)
    weighted_sum(torch.zeros(2, 4), voxels, torch.zeros(2, 4, dtype=torch.int64)).sum().backward()
    assert torch.equal(voxels.grad, torch.zeros(3))


def test_gradients_are_the_same_bits_every_time():
    # Large enough for several threads, with many entries a voxel: atomics would show in about
    # one run of four (with one thread, nothing would).
    generator = torch.Generator().manual_seed(0)
    weights = torch.rand(3200, 70, generator=generator)
    index = torch.randint(0, 50, (3200, 70), generator=generator)
    gradients = []
    for _ in range(40):
        voxels = torch.ones(50, requires_grad=True)
        weighted_sum(weights, voxels, index).sum().backward()
        gradients.append(voxels.grad)
    assert all(torch.equal(gradients[0], other) for other in gradients[1:])
