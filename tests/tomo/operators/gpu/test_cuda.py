"""On a device: the bits of the host's build, arrays that stay there, the same bits in ten runs."""

import numpy as np
import pytest

import rigs
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import Absorption, LinearSystem
from tomo.operators.gpu import DeviceMatrix, DeviceProjector, on_device
from tomo.operators.on_the_fly import OnTheFlyProjector
from tomo.operators.on_the_fly.camera_sources import pixel_source

pytestmark = pytest.mark.gpu

GRID = VoxelGrid((24, 30, 20), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))
RIG = rigs.ring(
    5, distance=400.0, image_size=(60, 80), footprint=0.5, center=GRID.center, pitch_degrees=20.0
)
SOME = ActiveVoxels.from_mask(GRID, np.random.default_rng(0).random(GRID.shape) < 0.4)


def operators(device):
    """Yield every kind of operator on a device."""
    for active in (ActiveVoxels(GRID), SOME):
        flying = OnTheFlyProjector(
            [pixel_source(one, None, 2) for one in RIG], GRID, active=active
        )
        clear = DeviceProjector(flying, device)
        yield clear
        yield clear.subset([4, 1])
        yield clear.with_absorption(Absorption(0.02, 0.1), np.linspace(0, 1, active.size))
        system = LinearSystem.from_rig(RIG, GRID, active=active)
        yield DeviceMatrix(system.projector, device)
        yield on_device(system.with_linear_basis().projector, device)[0]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_bits_of_the_hosts_build(cuda, host, dtype):
    random = np.random.default_rng(1)
    for there, here in zip(operators(cuda), operators(host), strict=True):
        x = random.random((here.shape[1], 5)).astype(dtype)
        y = random.normal(size=(here.shape[0], 5)).astype(dtype)
        assert np.array_equal(there @ x, here @ x)
        volumes = here.T @ y
        assert all(np.array_equal(there.T @ y, volumes) for _ in range(10))
        y[7, 2] = np.nan
        np.testing.assert_array_equal(there.T @ y, here.T @ y)


def test_an_operator_is_taken_there(cuda):
    for form in ("stored", "on-the-fly"):
        moved, reason = on_device(LinearSystem.from_rig(RIG, GRID, form=form).projector, cuda)
        assert reason == f"computed on {cuda.name}"
        assert moved.device is cuda


def test_arrays_stay_there(cuda):
    cupy = pytest.importorskip("cupy")
    operator = next(operators(cuda))
    x = np.random.default_rng(2).random(operator.shape[1], np.float32)
    images = operator @ cupy.asarray(x)
    assert isinstance(images, cupy.ndarray)
    assert np.array_equal(cupy.asnumpy(operator.T @ images), operator.T @ (operator @ x))


def test_tensors_stay_there(cuda):
    torch = pytest.importorskip("torch")
    if not torch.cuda.is_available():
        pytest.skip("torch: found no CUDA device, or a build without CUDA")
    operator = next(operators(cuda))
    x = np.random.default_rng(2).random(operator.shape[1], np.float32)
    images = operator @ torch.from_numpy(x).cuda()
    assert images.is_cuda
    assert np.array_equal(images.cpu().numpy(), operator @ x)


def test_gradients_stay_there(cuda):
    torch = pytest.importorskip("torch")
    if not torch.cuda.is_available():
        pytest.skip("torch: found no CUDA device, or a build without CUDA")
    from tomo.wernet import project

    own = LinearSystem.from_rig(RIG, GRID).with_linear_basis().projector
    there, _ = on_device(own, cuda)
    start, found = torch.rand((2, *GRID.shape), generator=torch.Generator().manual_seed(0)), []
    for operator, device in ((own, "cpu"), (there, "cuda")):
        volume = start.to(device).requires_grad_()
        (gradient,) = torch.autograd.grad(project(volume, operator).square().sum(), volume)
        assert gradient.device.type == device
        found.append(gradient.cpu())
    assert float((found[0] - found[1]).norm() / found[0].norm()) < 1e-6
