"""An operator goes to a device only where the device computes what the CPU does."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import rigs
from tomo.grid import VoxelGrid
from tomo.operators import Absorption, GaussianBasis, LinearSystem, dot_test
from tomo.operators.gpu import CudaDevice, DeviceError, DeviceMatrix, DeviceProjector, on_device
from tomo.operators.gpu.probe import _bytes_needed
from tomo.operators.on_the_fly import OnTheFlyProjector
from tomo.operators.on_the_fly.camera_sources import pixel_source
from tomo.solvers import cgls

GRID = VoxelGrid((9, 8, 10), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))
RIG = rigs.ring(
    3, distance=400.0, image_size=(26, 24), footprint=0.8, center=GRID.center, pitch_degrees=20.0
)


def system(form):
    return LinearSystem.from_rig(RIG, GRID, form=form)


@pytest.mark.parametrize(
    ("form", "kind"), [("stored", DeviceMatrix), ("on-the-fly", DeviceProjector)]
)
def test_a_solve_is_that_of_the_cpu(form, kind, host):
    own = system(form).projector
    moved, reason = on_device(own, host)
    assert isinstance(moved, kind)
    assert reason == "computed on host"
    measured = own @ np.random.default_rng(0).random(own.shape[1], np.float32)
    volume, there = cgls(own, measured).volume, cgls(moved, measured).volume
    assert np.linalg.norm(there - volume) < 1e-4 * np.linalg.norm(volume)


@pytest.mark.parametrize("form", ["stored", "on-the-fly"])
@pytest.mark.parametrize("gas", [False, True])
def test_blurred_images_are_computed_there(host, shuffled, form, gas):
    torch = pytest.importorskip("torch")
    plain = system(form)
    lens, linear = plain.with_lens_blur(2.5), plain.with_linear_basis()
    for own in (lens, linear, linear.with_lens_blur(1.5)):
        if gas:
            own = own.with_absorption(Absorption(0.05), np.ones(GRID.shape))
        own = own.projector
        moved, reason = on_device(own, host)
        assert reason == "computed on host"
        random = np.random.default_rng(1)
        x, y = random.random((own.shape[1], 3)), random.random((own.shape[0], 3))
        np.testing.assert_allclose(moved @ x, own @ x, rtol=1e-5)
        assert np.abs(moved.T @ y - own.T @ y).max() < 1e-5 * np.abs(own.T @ y).max()
        assert dot_test(moved, 1, np.float64) < 1e-12
        assert (moved.basis, moved.rows_are_single_rays) == (own.basis, own.rows_are_single_rays)
        some = moved.subset([2, 0])
        np.testing.assert_allclose(some @ x, own.subset([2, 0]) @ x, rtol=1e-5)
        found = moved @ torch.from_numpy(x)
        assert isinstance(found, torch.Tensor)
        assert np.array_equal(found.numpy(), moved @ x)
        other, _ = on_device(own, shuffled)
        assert np.array_equal(other.T @ (other @ x), moved.T @ (moved @ x))


def test_voxel_means_of_the_linear_basis_are_those_of_the_cpu(host):
    own = system("on-the-fly").with_linear_basis().projector
    moved, _ = on_device(own, host)
    x = np.random.default_rng(2).random(own.on_voxel_means.shape[1])
    found = moved.on_voxel_means @ x
    np.testing.assert_allclose(found, own.on_voxel_means @ x, rtol=1e-6, atol=1e-6 * found.max())


def test_blobs_stay_on_the_cpu_and_their_rays_do_not(host):
    own = GaussianBasis(system("on-the-fly").projector, 0.8)
    moved, reason = on_device(own, host)
    assert isinstance(moved, GaussianBasis)
    assert isinstance(moved.projector, DeviceProjector)
    assert reason == "computed on host"
    x = np.random.default_rng(3).random(own.shape[1])
    np.testing.assert_allclose(moved @ x, own @ x, rtol=1e-6)


class Faulty:
    """A device of which one kernel does something else: it adds ``error`` to its result."""

    def __init__(self, device, kernel, argument, change):
        self._device, self._kernel, self._argument, self._change = device, kernel, argument, change
        self.name = "faulty"

    def __getattr__(self, name):
        return getattr(self._device, name)

    def launch(self, kernel, values, threads, *arguments):
        self._device.launch(kernel, values, threads, *arguments)
        if kernel == self._kernel:
            self._change(arguments[self._argument])


def turn(values):
    values[:] = np.roll(values, 1)


def darken(values):
    values.fill(np.nan)


class Drift:
    """A little more at every call: adjoints that float atomics would make."""

    def __init__(self):
        self.calls = 0

    def __call__(self, sums):
        self.calls += 1
        sums += np.uint64(self.calls << 41)


@pytest.mark.parametrize(
    ("kernel", "argument", "change", "reason"),
    [
        ("forward_1", 6, turn, "found images .* from the CPU's, expected at most 1e-05"),
        ("forward_1", 6, darken, "found images nan from the CPU's, expected at most 1e-05"),
        ("adjoint_1", 8, turn, "found back-projection .* from the CPU's, expected at most 1e-05"),
        (
            "adjoint_1",
            8,
            Drift(),
            "found other bits in a second back-projection, expected the same",
        ),
    ],
)
def test_a_device_that_computes_something_else_is_not_used(host, kernel, argument, change, reason):
    own = system("on-the-fly").projector
    moved, found = on_device(own, Faulty(host, kernel, argument, change))
    assert moved is own
    assert re.fullmatch(f"GPU: faulty: {reason}: computed on the CPU", found)


class Small:
    """A device with less memory than an operator needs."""

    name = "small"

    def free_bytes(self):
        return 50_000


@pytest.mark.parametrize("form", ["stored", "on-the-fly"])
def test_too_little_memory_is_said_before_the_work(form):
    own = system(form).projector
    moved, found = on_device(own, Small())
    assert moved is own
    assert re.fullmatch(
        r"GPU: small: 0\.00 GB needed and 0\.00 GB free; \d+ voxels would fit, found 720: "
        "computed on the CPU",
        found,
    )


def test_without_cupy_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "cupy", None)
    expected = "GPU: found no CuPy, expected it: pip install 'flametomo[gpu]'"
    with pytest.raises(DeviceError) as caught:
        CudaDevice()
    assert str(caught.value) == expected
    own = system("stored").projector
    assert on_device(own) == (own, f"{expected}: computed on the CPU")


def test_without_a_driver_one_line_says_so(monkeypatch):
    def count():
        raise RuntimeError("cudaErrorInsufficientDriver: CUDA driver version is insufficient")

    runtime = SimpleNamespace(getDeviceCount=count)
    cupy = SimpleNamespace(cuda=SimpleNamespace(runtime=runtime))
    monkeypatch.setitem(sys.modules, "cupy", cupy)
    with pytest.raises(DeviceError, match=r"^GPU: found no CUDA device: cudaErrorInsufficientDri"):
        CudaDevice()
    runtime.getDeviceCount = lambda: 1
    with pytest.raises(DeviceError, match=r"^GPU: found no device 2, expected 0 to 0$"):
        CudaDevice(2)


def test_the_memory_table_of_the_guide_is_that_of_the_formula():
    page = Path(__file__).parents[4] / "docs/guide/gpu.md"
    row = r"\| (\d+)\^3 \| (\d+) \| (\d+) x (\d+) \| ([\d.]+) \|"
    found = re.findall(row, page.read_text("utf-8"))
    assert len(found) == 5
    for voxels, views, width, height, gigabytes in found:
        grid, size = VoxelGrid((int(voxels),) * 3, 1.0), (int(width), int(height))
        rig = rigs.ring(int(views), distance=4.0 * grid.shape[0], image_size=size, footprint=1.0)
        fixed, each = _bytes_needed(OnTheFlyProjector(list(map(pixel_source, rig)), grid))
        assert float(gigabytes) == pytest.approx((fixed + each * grid.size) / 1e9, abs=0.051)
