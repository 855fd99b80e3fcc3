"""All that needs a GPU: ``python tools/studies/gpu.py [--views N] [--sizes 128,256,512]``.

It runs the tests marked ``gpu`` (the device's bits are the host build's), then times products of
arrays that stay on the device. Without a device it says in one line what is missing.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

import rigs  # noqa: E402
from studies.common.timing import in_turn  # noqa: E402
from tomo.grid import VoxelGrid  # noqa: E402
from tomo.operators.gpu import CudaDevice, DeviceError, on_device  # noqa: E402
from tomo.operators.on_the_fly import OnTheFlyProjector  # noqa: E402

IMAGE = (1024, 768)
"""Pixels of a view: as diffct's own benchmark has them."""


def timed(device: CudaDevice, size: int, views: int, repeats: int) -> str:
    """Return a row of the table: rays a second of both products of a cube of voxels."""
    grid = VoxelGrid((size,) * 3, 1.0)
    rig = rigs.ring(views, distance=4.0 * size, image_size=IMAGE, footprint=2.0 * size / IMAGE[0])
    operator, reason = on_device(OnTheFlyProjector.from_cameras(tuple(rig), None, grid), device)
    if getattr(operator, "device", None) is not device:
        return f"{size}: {reason}"
    random = np.random.default_rng(0)
    x = device.array(random.random(operator.shape[1], np.float32))
    y = device.array(random.random(operator.shape[0], np.float32))

    def done(result: Any) -> None:
        device.host(result[:1])  # waits for the device

    products = {"forward": lambda: done(operator @ x), "adjoint": lambda: done(operator.T @ y)}
    seconds = in_turn(products, repeats)
    rays, crossings = operator.shape[0] / 1e9, operator.n_segments / 1e9
    rates = ", ".join(
        f"{name} {rays / one:.3f} Gray/s ({crossings / one:.1f} G crossings/s, {1e3 * one:.1f} ms)"
        for name, one in seconds.items()
    )
    return f"{size}^3 voxels, {views} views of {IMAGE[0]} x {IMAGE[1]}: {rates}"


def main() -> int:
    """Check and time; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--views", type=int, default=36)
    parser.add_argument("--sizes", default="128,256,512")
    parser.add_argument("--repeats", type=int, default=5)
    wanted = parser.parse_args()
    try:
        device = CudaDevice()
    except DeviceError as error:
        sys.stdout.write(f"{error}\n")
        return 2
    sys.stdout.write(f"{device.name}\n")
    sys.stdout.flush()
    folder = "tests/tomo/operators/gpu"  # its own fixtures alone: fewer packages are needed
    tests = ["-m", "pytest", "-q", "-n", "0", "-m", "gpu", "-rs", f"--confcutdir={folder}", folder]
    failed = subprocess.run([sys.executable, *tests], cwd=ROOT, check=False).returncode
    for size in map(int, wanted.sizes.split(",")):
        sys.stdout.write(timed(device, size, wanted.views, wanted.repeats) + "\n")
        sys.stdout.flush()
    return failed


if __name__ == "__main__":
    sys.exit(main())
