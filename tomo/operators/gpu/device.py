"""A CUDA device: memory, the kernels' text compiled at run time, arrays of other libraries."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

FILES = ("walk.cu", "projection.cu", "blur.cu")

NAMES = (
    "forward_1", "forward_4", "dimmed_forward", "adjoint_1", "adjoint_4", "dimmed_adjoint",
    "largest", "spread", "collect", "row_parts_1", "row_parts_4", "row_totals", "blurred",
)  # fmt: skip
"""The kernels that are launched by name."""


TOGETHER = 4
"""Columns that share a walk, or the reading of an entry."""


def together(columns: int, most: int = TOGETHER) -> Iterator[tuple[int, int]]:
    """Iterate over columns computed together: the first, and how many, ``most`` or 1."""
    first = 0
    while first < columns:
        some = most if first + most <= columns else 1
        yield first, some
        first += some


def source(values: DTypeLike) -> str:
    """Return the whole text for volumes and images of one type, float32 or float64."""
    real = {np.dtype(np.float32): "float", np.dtype(np.float64): "double"}[np.dtype(values)]
    folder = files("tomo.operators.gpu")
    parts = [folder.joinpath(name).read_text("utf-8") for name in FILES]
    return "\n".join([f"typedef {real} real;", *parts])


THREADS_A_BLOCK = 128
"""Threads that are scheduled together: fewer leave multiprocessors idle, more leave none of the
registers that a walk takes, about 80."""

OPTIONS = ("--fmad=false", "--std=c++14")
"""No contraction of a * b + c: the host's build gives the same bits."""

CUDA = 2
"""CUDA's number among DLPack's kinds of devices."""

NOTHING = np.uint64(0)
"""A null pointer."""


class DeviceError(RuntimeError):
    """There is no device to compute on, or it lacks something; one line says what."""


class CudaDevice:
    """A CUDA device, through CuPy: arrays on it are of a type of its own.

    ``number`` is CUDA's, ``count`` how many devices there are. `DeviceError`: CuPy, the driver or
    the device is missing; later, the device fails.
    """

    def __init__(self, number: int = 0) -> None:
        try:
            self._cupy: Any = importlib.import_module("cupy")
        except ImportError as error:
            raise DeviceError(
                "GPU: found no CuPy, expected it: pip install 'flametomo[gpu]'"
            ) from error
        try:
            count = self._cupy.cuda.runtime.getDeviceCount()
        except Exception as error:  # CUDARuntimeError, where there is no driver or an old one
            raise DeviceError(
                f"GPU: found no CUDA device: {_line(error)}; expected a driver for CUDA 12+"
            ) from error
        if not 0 <= number < count:
            raise DeviceError(f"GPU: found no device {number}, expected 0 to {count - 1}")
        self.count, self.number = int(count), number
        self._device = self._cupy.cuda.Device(number)
        properties = self._cupy.cuda.runtime.getDeviceProperties(number)
        self.name = f"{properties['name'].decode()} (cuda:{number})"
        self._module = cache(self._compiled)

    def __repr__(self) -> str:
        """Name the device."""
        return f"<CudaDevice: {self.name}>"

    def compile(self, values: DTypeLike) -> None:
        """Compile the kernels for one type, or raise `DeviceError`; CuPy keeps them on disk."""
        with self.used():
            self._module(np.dtype(values))

    def _compiled(self, values: np.dtype) -> Any:
        """Return the kernels for one type; the compiler's first line is shown where it refuses."""
        text = source(values)
        try:
            module = self._cupy.RawModule(code=text, options=OPTIONS)
            module.compile()
        except Exception as error:  # CompileException, and what a missing compiler raises
            raise DeviceError(f"GPU: kernels do not compile: {_line(error)}") from error
        return module

    @contextmanager
    def used(self) -> Iterator[None]:
        """Work on the device; what goes wrong there is one line: no memory left, a device lost."""
        try:
            with self._device:
                yield
        except Exception as error:
            if type(error).__module__.partition(".")[0] not in ("cupy", "cupy_backends"):
                raise  # no fault of the device's
            raise DeviceError(f"GPU: {self.name}: {_line(error)}") from error

    def array(self, values: NDArray) -> Any:
        """Return a copy on the device, in rows; what the thread computes next is there too."""
        with self.used():
            copied = self._cupy.array(values, order="C")
        self._device.use()
        return copied

    def zeros(self, shape: tuple[int, ...], dtype: DTypeLike) -> Any:
        """Return an array of zeros on the device."""
        with self.used():
            return self._cupy.zeros(shape, dtype)

    def write(self, target: Any, values: NDArray) -> None:
        """Copy values to a part of an array of the device, in rows and of the same type."""
        with self.used():
            target.set(values)

    def host(self, values: Any) -> NDArray:
        """Return a copy of an array of the device in NumPy's."""
        with self.used():
            return self._cupy.asnumpy(values)

    def holds(self, values: Any) -> bool:
        """Return whether an array that has ``__dlpack_device__`` is in the device's memory."""
        return tuple(map(int, values.__dlpack_device__())) == (CUDA, self.number)

    def adopt(self, values: Any) -> Any:
        """Return such an array as one of the device's, in rows, without a copy where it can."""
        with self.used():
            return self._cupy.ascontiguousarray(self._cupy.from_dlpack(values))

    def launch(self, kernel: str, values: DTypeLike, threads: int, *arguments: Any) -> None:
        """Run a kernel, compiled for float32 or float64 ``values``, on so many threads.

        Arguments are arrays of the device, NumPy's scalars of the kernel's types, or `NOTHING`.
        """
        if threads == 0:
            return
        blocks = -(-threads // THREADS_A_BLOCK)
        with self.used():
            function = self._module(np.dtype(values)).get_function(kernel)
            function((blocks,), (THREADS_A_BLOCK,), arguments)

    def free_bytes(self) -> int:
        """Return how much memory is free: of the device, and of what CuPy keeps for reuse."""
        with self.used():
            pool = self._cupy.get_default_memory_pool()
            return int(self._cupy.cuda.runtime.memGetInfo()[0]) + int(pool.free_bytes())


Device = CudaDevice
"""What operators compute on: anything with the same methods, as the tests' own on the host."""


def _line(error: Exception) -> str:
    """Return the first line of an error that says something."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return next(
        (line for line in lines if "error" in line.lower()), next(iter(lines), repr(error))
    )
