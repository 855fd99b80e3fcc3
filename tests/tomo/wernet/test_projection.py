"""A projection in torch is the operator's own, and its gradients are those of its adjoint."""

import numpy as np
import pytest
import torch

import rigs
from tomo import ActiveVoxels, GaussianBasis, LinearSystem, VoxelGrid
from tomo.wernet import project

GRID = VoxelGrid((5, 6, 4), 1.7)
RIG = rigs.ring(
    6, distance=100.0, image_size=(13, 15), footprint=0.9, pitch_degrees=[12.0, -14.0] * 3,
    start_degrees=23.0,
)  # fmt: skip
FORMS = ("stored", "on the fly", "blurred", "linear", "blobs", "active")


def system_of(form):
    kind = "on-the-fly" if form == "on the fly" else "stored"
    active = None
    if form == "active":
        inside = np.linalg.norm(GRID.centers(), axis=-1) < 3.5
        active = ActiveVoxels.from_mask(GRID, inside)
    system = LinearSystem.from_rig(RIG, GRID, form=kind, active=active)
    return {"blurred": lambda: system.with_lens_blur(1.0), "linear": system.with_linear_basis}.get(
        form, lambda: system
    )()


def operator_of(form):
    projector = system_of(form).projector
    return GaussianBasis(projector, 1.0) if form == "blobs" else projector


def random(*shape, dtype=torch.float64, seed=0):
    return torch.randn(*shape, dtype=dtype, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("dtype", "bound"), [(torch.float64, 1e-12), (torch.float32, 1e-6)])
def test_pixels_are_the_operators_and_the_gradient_is_its_adjoint(form, dtype, bound):
    operator = operator_of(form)
    x = random(operator.shape[1], dtype=dtype).requires_grad_()
    y = random(operator.shape[0], dtype=dtype, seed=1)
    pixels = project(x, operator)
    assert pixels.dtype == dtype
    np.testing.assert_array_equal(pixels.detach().numpy(), operator @ x.detach().numpy())
    pixels.backward(y)
    assert x.grad.dtype == dtype
    images, volume = pixels.detach().double() @ y.double(), x.detach().double() @ x.grad.double()
    assert abs(images - volume) < bound * float(pixels.detach().norm() * y.norm())


@pytest.mark.parametrize("form", FORMS)
def test_derivatives_are_finite_differences_of_any_order(form):
    operator = operator_of(form)
    x = random(operator.shape[1]).requires_grad_()
    some = random(6, operator.shape[0], seed=2)

    def few(volume):
        return some @ project(volume, operator)

    assert torch.autograd.gradcheck(few, x, check_forward_ad=True)
    assert torch.autograd.gradgradcheck(lambda volume: few(volume) ** 2, x, fast_mode=True)


@pytest.mark.parametrize("form", ["stored", "on the fly", "linear"])
def test_volumes_of_any_shape_and_batches_have_the_same_pixels(form):
    system = system_of(form)
    batch = random(2, 3, *GRID.shape)
    pixels = project(batch, system)
    assert pixels.shape == (2, 3, system.projector.shape[0])
    for found in (project(batch.flatten(-3), system), torch.func.vmap(one(system))(batch)):
        torch.testing.assert_close(found, pixels, rtol=0, atol=1e-12)
    torch.testing.assert_close(project(batch[1, 2], system), pixels[1, 2], rtol=0, atol=1e-12)


def one(system):
    return lambda volume: project(volume, system)


def test_inactive_voxels_show_nothing_and_have_no_gradient():
    system = system_of("active")
    volume = random(*GRID.shape).requires_grad_()
    project(volume, system).square().sum().backward()
    seen = torch.as_tensor(system.projector.active.mask)
    assert (volume.grad[~seen] == 0).all()
    assert (volume.grad[seen] != 0).any()
    few = project(volume.detach()[seen], system)
    torch.testing.assert_close(project(volume.detach(), system), few, rtol=0, atol=0)


def test_transforms_of_torch_serve():
    system = system_of("stored")
    x, y = random(*GRID.shape), random(system.projector.shape[0], seed=1)
    matrix = system.projector @ np.eye(GRID.size)
    back = torch.as_tensor(matrix.T @ y.numpy()).reshape(GRID.shape)
    found = torch.func.grad(lambda volume: project(volume, system) @ y)(x)
    torch.testing.assert_close(found, back)
    jacobian = torch.func.jacrev(lambda volume: project(volume, system))(x)
    torch.testing.assert_close(jacobian.flatten(1), torch.as_tensor(matrix))
    _, ahead = torch.func.jvp(one(system), (x,), (x,))
    torch.testing.assert_close(ahead, project(x, system))


@pytest.mark.parametrize(
    ("volume", "words"),
    [
        (torch.zeros(5, 6, 5), r"found shape \(5, 6, 5\), expected .* \(5, 6, 4\)"),
        (torch.zeros(GRID.shape, dtype=torch.bfloat16), "bfloat16, expected torch.float32"),
        (torch.zeros(GRID.shape, dtype=torch.int64), "int64, expected torch.float32"),
        (torch.full(GRID.shape, torch.nan), "found 120 NaN or infinite values"),
    ],
)
def test_other_volumes_are_refused_in_one_line(volume, words):
    with pytest.raises(ValueError, match=words) as error:
        project(volume, system_of("stored"))
    assert "\n" not in str(error.value)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_tensors_on_a_device_come_back_there():
    system = system_of("stored")
    x = random(*GRID.shape)
    there = x.cuda().requires_grad_()
    project(there, system).square().sum().backward()
    here = x.clone().requires_grad_()
    project(here, system).square().sum().backward()
    torch.testing.assert_close(there.grad.cpu(), here.grad)
