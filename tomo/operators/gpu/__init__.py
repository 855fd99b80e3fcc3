"""The same operators on a CUDA device: exact lengths, an exact adjoint, the same bits every time.

`on_device` takes an operator of the CPU to the device, or returns it with the reason why not::

    A, reason = on_device(system.projector)
    images = A @ x               # x of NumPy, or an array on the device (CuPy, torch)
    back_projection = A.T @ y

An argument on the device is taken by ``__dlpack__`` without a copy, and the result stays there, as
an array of the argument's library. NumPy's arrays are copied there, and the result back.

**Method.** One thread walks the rays of one pixel from voxel to voxel (``walk.cu``). Forward, it
adds up length times value in double precision. Adjoint, it adds whole multiples of a power of two
to 64-bit integers in the voxels (``projection.cu`` has the formulas and the bound). Integers have
the same sum in any order, so threads need none and a run repeats to the bit; float atomics differ
from run to run. Both products use the same lengths: the adjoint is exact but for its rounding to
whole numbers. The rays of a camera take 64 bytes each.

**Trust.** `on_device` compares the kernels with the CPU's operator on some rays. The tests compile
the same text for the host and compare it with the float64 oracle. Neither compiler may contract a
product and a sum to one rounding: the device then has to compute the bits of the host's build.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "composition": ["DeviceComposed", "DeviceLinear"],
        "device": ["CudaDevice", "Device", "DeviceError"],
        "matrix": ["DeviceMatrix"],
        "probe": ["on_device", "to_device"],
        "projector": ["DeviceProjector"],
        "slabs": ["DeviceSlabs"],
        "wanted": ["device_count", "device_for", "on_cpu", "taken_to"],
    },
)
