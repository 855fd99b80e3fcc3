"""Gradients in torch where the operator is: tensors stay there, results are those of the CPU."""

import numpy as np
import pytest

import rigs
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import LinearSystem
from tomo.operators.gpu import on_device
from tomo.operators.gpu.device_operator import DeviceOperator

torch = pytest.importorskip("torch")

GRID = VoxelGrid((9, 8, 10), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))
RIG = rigs.ring(
    3, distance=400.0, image_size=(26, 24), footprint=0.8, center=GRID.center, pitch_degrees=20.0
)
SOME = ActiveVoxels.from_mask(GRID, np.random.default_rng(0).random(GRID.shape) < 0.6)


@pytest.fixture(params=["stored", "on-the-fly"])
def pair(request, host, monkeypatch):
    """Return an operator on the CPU and on the device, where NumPy's arrays are refused."""
    system = LinearSystem.from_rig(RIG, GRID, form=request.param, active=SOME)
    own = system.with_linear_basis().projector
    there, _ = on_device(own, host)

    def refuse(*arguments):
        raise AssertionError("copied from the device")

    monkeypatch.setattr(DeviceOperator, "_on_numpy", refuse)
    return own, there


def test_values_and_gradients_stay_and_are_those_of_the_cpu(pair):
    from tomo.wernet import project

    own, there = pair
    start = torch.from_numpy(np.random.default_rng(1).random((2, *GRID.shape)))
    found = []
    for operator in (own, there):
        volume = start.clone().requires_grad_()
        pixels = project(volume, operator)
        (gradient,) = torch.autograd.grad(pixels.square().sum(), volume)
        found.append((pixels.detach(), gradient))
    for here, device in zip(*found, strict=True):
        assert here.shape == device.shape
        assert float((here - device).norm() / here.norm()) < 1e-6


def test_a_loop_of_ones_own_finds_the_volume(pair):
    from tomo.wernet import project

    _, there = pair
    truth = torch.from_numpy(np.random.default_rng(2).random(SOME.size, np.float32))
    measured = project(truth, there)
    volume = torch.zeros(SOME.size, requires_grad=True)
    optimiser = torch.optim.LBFGS([volume], max_iter=30)

    def loss():
        optimiser.zero_grad()
        value = (project(volume, there) - measured).square().mean()
        value.backward()
        return value

    before = loss().item()
    optimiser.step(loss)
    assert loss().item() < 1e-3 * before


def test_values_that_are_not_finite_are_refused(pair):
    from tomo.wernet import project

    with pytest.raises(ValueError, match="volume: found 1 NaN or infinite values, expected finit"):
        project(torch.full((SOME.size,), 1.0).index_fill(0, torch.tensor([3]), np.nan), pair[1])
