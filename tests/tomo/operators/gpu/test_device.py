"""How CuPy is asked, by a stand-in for it on the host's build; what failures of a device say."""

from types import SimpleNamespace

import numpy as np
import pytest
from host_build import CompileException

import rigs
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem
from tomo.operators.gpu import CudaDevice, DeviceError, on_device

GRID = VoxelGrid((9, 8, 10), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))
RIG = rigs.ring(3, distance=400.0, image_size=(26, 24), footprint=0.8, center=GRID.center)


@pytest.mark.parametrize("form", ["stored", "on-the-fly"])
def test_cupy_gives_what_the_host_does(cupy, host, form):
    own = LinearSystem.from_rig(RIG, GRID, form=form).projector
    there, reason = on_device(own)
    assert reason == "computed on Stand-in (cuda:0)"
    assert "--fmad=false" in cupy.options
    here, _ = on_device(own, host)
    random = np.random.default_rng(0)
    x, y = random.random((own.shape[1], 3)), random.random((own.shape[0], 5), np.float32)
    assert np.array_equal(there @ x, here @ x)
    assert np.array_equal(there.T @ y, here.T @ y)


def test_a_kernel_that_does_not_compile_shows_the_compilers_line(cupy, monkeypatch):
    def refuse(code, options):
        raise CompileException('\nkernels.cu(7): error: identifier "whole" is undefined\n1 error')

    monkeypatch.setattr(cupy, "RawModule", refuse)
    own = LinearSystem.from_rig(RIG, GRID, form="on-the-fly").projector
    assert on_device(own) == (
        own,
        'GPU: kernels do not compile: kernels.cu(7): error: identifier "whole" is undefined: '
        "computed on the CPU",
    )


def test_memory_that_runs_out_after_all_is_one_line(cupy):
    own = LinearSystem.from_rig(RIG, GRID, form="on-the-fly").projector
    there, _ = on_device(own)
    cupy.memory = 100
    with pytest.raises(DeviceError) as caught:
        there @ np.ones(own.shape[1])
    line = "GPU: Stand-in (cuda:0): Out of memory allocating"
    assert str(caught.value) == f"{line} {8 * own.shape[0]} bytes"
    assert on_device(own) == (own, f"{line} {64 * own.shape[0]} bytes: computed on the CPU")


def test_arrays_in_other_memory_are_not_taken_for_the_devices(cupy):
    device = CudaDevice()
    for kind, number, expected in ((2, 0, True), (2, 1, False), (1, 0, False)):
        assert device.holds(SimpleNamespace(__dlpack_device__=lambda: (kind, number))) is expected  # noqa: B023
    own = LinearSystem.from_rig(RIG, GRID, form="stored").projector
    there, _ = on_device(own, device)
    torch = pytest.importorskip("torch")
    x = torch.ones(own.shape[1])  # in the CPU's memory: copied, as NumPy's arrays are
    assert np.array_equal(there @ x, there @ x.numpy())


def test_mistakes_of_callers_stay_theirs(cupy):
    device = CudaDevice()
    with pytest.raises(KeyError):
        device.launch("forward_1", np.int32, 1)
