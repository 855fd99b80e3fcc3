import pytest
import torch

from tomo.wernet import weighted_sum


def _case(dtype=torch.float64):
    generator = torch.Generator().manual_seed(1)
    weights = torch.rand(4, 5, generator=generator, dtype=dtype)
    weights[1, 3:] = 0  # a shorter ray, padded
    voxels = torch.rand(7, generator=generator, dtype=dtype)
    index = torch.randint(0, 7, (4, 5), generator=generator)
    return weights.requires_grad_(), voxels.requires_grad_(), index


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
