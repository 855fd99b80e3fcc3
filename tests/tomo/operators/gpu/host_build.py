"""The kernels compiled for the host by the system's C++ compiler, and devices that run them.

A plugin of pytest: tests/tomo/conftest.py has its fixtures.
"""

import ctypes
import os
import shutil
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tomo.operators.gpu import CudaDevice, DeviceError
from tomo.operators.gpu.device import NAMES, THREADS_A_BLOCK, source
from tomo.operators.gpu.device_operator import DeviceOperator

HERE = Path(__file__).parent
COMPILER = next(filter(None, map(shutil.which, (os.environ.get("CXX", "g++"), "clang++"))), None)


class HostDevice:
    """A device whose memory is the host's; ``order`` seeds the order in which threads run."""

    name = "host"
    from_dlpack = staticmethod(np.from_dlpack)  # for tests that count what others copy by it

    def __init__(self, libraries, order=None):
        self.libraries, self.order = libraries, order

    def array(self, values):
        return np.array(values, order="C")

    def zeros(self, shape, dtype):
        return np.zeros(shape, dtype)

    def write(self, target, values):
        target[:] = values

    def host(self, values):
        return np.array(values)

    def holds(self, values):
        return values.__dlpack_device__()[0] == 1  # DLPack's number of the CPU

    def adopt(self, values):
        return np.ascontiguousarray(self.from_dlpack(values))

    def free_bytes(self):
        return 1 << 40

    def used(self):
        return nullcontext()

    def launch(self, kernel, values, threads, *arguments):
        library = self.libraries[np.dtype(values).name]
        assert getattr(library, f"count_{kernel}")() == len(arguments), kernel
        cells, pointers = [], (ctypes.c_void_p * len(arguments))()
        for i, one in enumerate(arguments):
            if isinstance(one, np.ndarray):
                assert one.flags.c_contiguous
                cells.append(ctypes.c_void_p(one.ctypes.data))
            else:
                assert one.dtype in (np.int64, np.float64, np.uint64)
                cells.append(ctypes.c_uint64(int(one.view(np.uint64))))
            pointers[i] = ctypes.addressof(cells[-1])
        whole = -(-threads // THREADS_A_BLOCK) * THREADS_A_BLOCK  # blocks are always full
        order = None
        if self.order is not None:
            drawn = np.random.default_rng(self.order).permutation(whole)
            order = drawn.ctypes.data_as(ctypes.c_void_p)
        getattr(library, f"host_{kernel}")(ctypes.c_longlong(whole), order, pointers)


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

    ndarray = Array
    from_dlpack = staticmethod(lambda values: np.from_dlpack(values).view(Array))
    ascontiguousarray = staticmethod(np.ascontiguousarray)
    asnumpy = staticmethod(lambda values: np.array(values))

    def __init__(self, host, memory=1 << 40):
        self.host, self.memory, self.options = host, memory, []
        runtime = SimpleNamespace(
            getDeviceCount=lambda: 1,
            getDeviceProperties=lambda number: {"name": b"Stand-in"},
            memGetInfo=lambda: (1 << 40, 1 << 40),
            deviceGetAttribute=lambda attribute, number: {16: 132, 13: 1_980_000}[attribute],
        )
        self.cuda = SimpleNamespace(runtime=runtime, Device=lambda number: CurrentDevice())

    def get_default_memory_pool(self):
        return SimpleNamespace(free_bytes=lambda: 0, total_bytes=lambda: 3 << 30)

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


@pytest.fixture
def on_arrays_of(monkeypatch):
    """Return a function: the name of a library of which arrays on the device are from then on."""

    def take(name):
        pytest.importorskip("array_api_compat")
        library = pytest.importorskip(name)

        def array(operator, values):
            return values if operator.takes(values) else library.asarray(np.array(values))

        monkeypatch.setattr(CudaDevice, "holds", lambda device, values: True)
        monkeypatch.setattr(DeviceOperator, "array", array)
        return library

    return take


@pytest.fixture(scope="session")
def libraries(tmp_path_factory):
    """Return the kernels as shared libraries, by the name of their type."""
    if COMPILER is None:
        pytest.skip("no C++ compiler: found neither g++ nor clang++")
    folder, found = tmp_path_factory.mktemp("kernels"), {}
    for kind in ("float32", "float64"):
        text = [f'#include "{HERE / "host.hpp"}"', source(kind), *(f"HOST({n})" for n in NAMES)]
        (folder / f"{kind}.cpp").write_text("\n".join(text), "utf-8")
        command = [
            COMPILER, "-std=c++14", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-Wall",
            "-Werror", "-o", folder / f"{kind}.so", folder / f"{kind}.cpp",
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        found[kind] = ctypes.CDLL(str(folder / f"{kind}.so"))
    return found


@pytest.fixture(scope="session")
def host(libraries):
    """Return the device that runs the host's build."""
    return HostDevice(libraries)


@pytest.fixture(scope="session")
def shuffled(libraries):
    """Return one that runs threads in an order drawn by chance."""
    return HostDevice(libraries, order=7)


@pytest.fixture(scope="session")
def cuda():
    """Return a CUDA device, or skip with what is missing."""
    try:
        return CudaDevice()
    except DeviceError as error:
        pytest.skip(str(error))
