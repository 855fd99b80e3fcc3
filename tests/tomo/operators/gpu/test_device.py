"""How CuPy is asked, by a stand-in for it on the host's build; what failures of a device say."""

import re
import sys
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

import rigs
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem
from tomo.operators.gpu import CudaDevice, DeviceError, on_device

GRID = VoxelGrid((9, 8, 10), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))
RIG = rigs.ring(3, distance=400.0, image_size=(26, 24), footprint=0.8, center=GRID.center)

CompileException = type("CompileException", (Exception,), {"__module__": "cupy.cuda.compiler"})
OutOfMemoryError = type("OutOfMemoryError", (MemoryError,), {"__module__": "cupy.cuda.memory"})


class Array(np.ndarray):
    """An array of the stand-in's."""

    def set(self, values):
        assert values.flags.c_contiguous
        assert values.dtype == self.dtype
        self[...] = values


class CurrentDevice(nullcontext):
    """A device of the stand-in's, entered or made a thread's own."""

    def use(self):
        pass


class StandIn:
    """CuPy as far as it is asked, on the host's build of the kernels."""

    from_dlpack = staticmethod(lambda values: np.from_dlpack(values).view(Array))
    ascontiguousarray = staticmethod(np.ascontiguousarray)
    asnumpy = staticmethod(lambda values: np.array(values))

    def __init__(self, host, memory=1 << 40):
        self.host, self.memory, self.options = host, memory, []
        runtime = SimpleNamespace(
            getDeviceCount=lambda: 1,
            getDeviceProperties=lambda number: {"name": b"Stand-in"},
            memGetInfo=lambda: (1 << 40, 1 << 40),
        )
        self.cuda = SimpleNamespace(runtime=runtime, Device=lambda number: CurrentDevice())

    def get_default_memory_pool(self):
        return SimpleNamespace(free_bytes=lambda: 0)

    def array(self, values, order):
        return np.array(values, order=order).view(Array)

    def zeros(self, shape, dtype):
        made = np.zeros(shape, dtype)
        self.memory -= made.nbytes
        if self.memory < 0:
            raise OutOfMemoryError(f"Out of memory allocating {made.nbytes} bytes")
        return made.view(Array)

    def RawModule(self, code, options):  # noqa: N802
        self.options += options
        return SimpleNamespace(
            compile=lambda: None, get_function=lambda kernel: self.function(code, kernel)
        )

    def function(self, code, kernel):
        values = np.float32 if code.startswith("typedef float real;") else np.float64

        def run(blocks, threads, arguments):
            assert (len(blocks), len(threads)) == (1, 1)
            self.host.launch(kernel, values, blocks[0] * threads[0], *arguments)

        return run


@pytest.fixture
def cupy(host, monkeypatch):
    stand_in = StandIn(host)
    monkeypatch.setitem(sys.modules, "cupy", stand_in)
    return stand_in


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


def test_the_study_measures_both_products(host, run_tool, monkeypatch):
    from studies import gpu  # run_tool has tools/ on the path

    monkeypatch.setattr(gpu, "IMAGE", (16, 12))
    row = gpu.timed(host, 6, 2, 1)
    rate = r"[\d.]+ Gray/s \([\d.]+ G crossings/s, [\d.]+ ms\)"
    assert re.fullmatch(rf"6\^3 voxels, 2 views of 16 x 12: forward {rate}, adjoint {rate}", row)
