"""Take an operator to a device, compared with the CPU's before anything relies on it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.operators.basis import LinearBasis
from tomo.operators.composition import ComposedProjector
from tomo.operators.gpu.composition import DeviceComposed, DeviceLinear
from tomo.operators.gpu.device import CudaDevice, Device, DeviceError
from tomo.operators.gpu.device_operator import DeviceOperator
from tomo.operators.gpu.matrix import DeviceMatrix
from tomo.operators.gpu.projector import DeviceProjector
from tomo.operators.gpu.slabs import DeviceSlabs
from tomo.operators.image_blur import ImageBlur
from tomo.operators.on_the_fly import AttenuatedProjector, OnTheFlyProjector
from tomo.operators.operator import ProjectionOperator
from tomo.operators.stored import Projector

PROBED = 100
"""Pixels that are compared: fewer miss a kind of ray, more take time at every start."""

AGREES = 1e-5
"""Largest difference, as a fraction of the largest value: float32 alone makes up to 1e-6, and a
voxel taken for its neighbour 1e-2."""

MOST_VOXELS = 2**31 - 1
"""Voxels of a grid on a device: stored entries number them in 32 bits."""


def on_device(
    operator: ProjectionOperator, device: Device | None = None
) -> tuple[ProjectionOperator, str]:
    """Return the same operator on a device, the first one, and where it is; or itself, and why.

    The products of a hundred pixels, spread over all, are compared with the CPU's, and a second
    adjoint with the first, bit by bit. It is the CPU's operator that a difference, an error of the
    device, or too little memory returns. Blobs around the rays stay on the CPU: such an operator
    takes NumPy's arrays only.
    """
    try:
        device = CudaDevice() if device is None else device
        moved = to_device(operator, device)
        if found := difference(operator, moved):
            raise DeviceError(f"GPU: {device.name}: {found}")
    except DeviceError as error:
        return operator, f"{error}: computed on the CPU"
    return moved, f"computed on {device.name}"


def to_device(operator: ProjectionOperator, device: Device) -> ProjectionOperator:
    """Return the same operator on a device, without a comparison.

    `DeviceError`: it does not fit, has no kind of its own there, or the device fails.
    """
    return _moved(operator, device, _slabs(operator, device))


def difference(operator: ProjectionOperator, moved: ProjectionOperator) -> str:
    """Return how products of some pixels differ from the CPU's; nothing where they agree."""
    if operator.shape[0] == 0:
        return ""
    pixels = np.unique(np.linspace(0, operator.shape[0] - 1, PROBED).astype(np.int64))
    own, there = operator.take(pixels), moved.take(pixels)
    random = np.random.default_rng(0)
    x, y = random.random(own.shape[1]), random.normal(size=own.shape[0])
    single = y.astype(np.float32)
    for name, right, found in (
        ("images", own @ x, there @ x.astype(np.float32)),
        ("back-projection", own.T @ y, there.T @ single),
    ):
        off = _relative(right, found)
        if not off <= AGREES:
            return f"found {name} {off:.2g} from the CPU's, expected at most {AGREES:g}"
    if not np.array_equal(there.T @ single, there.T @ single):
        return "found other bits in a second back-projection, expected the same"
    return ""


def _relative(right: NDArray[np.floating], found: NDArray[np.floating]) -> float:
    """Return the largest difference as a fraction of the largest value."""
    scale = float(np.abs(right).max(initial=0.0))
    off = float(np.abs(found - right).max(initial=0.0))
    return off / scale if scale > 0 else off


def _moved(operator: ProjectionOperator, device: Device, slabs: int) -> ProjectionOperator:
    """Return an operator on a device, as far as there is one of its kind."""
    if isinstance(operator, Projector):
        return DeviceMatrix(operator, device)
    if isinstance(operator, OnTheFlyProjector):
        many = slabs > 1
        return DeviceSlabs(operator, device, slabs) if many else DeviceProjector(operator, device)
    if isinstance(operator, AttenuatedProjector):
        clear = DeviceProjector(operator.rays, device)
        return clear.with_absorption(operator.absorption, operator.emission)
    if isinstance(operator, ComposedProjector | LinearBasis) and slabs == 1:
        inner = operator.rays if isinstance(operator, ComposedProjector) else operator.projector
        there = _moved(inner, device, slabs)
        if isinstance(there, DeviceOperator) and isinstance(operator, LinearBasis):
            return DeviceLinear(there)
        if isinstance(there, DeviceOperator) and isinstance(operator.images, ImageBlur):
            return DeviceComposed(operator.images, there, operator.view_ptr)
    changed = operator.with_rays(
        lambda rays: rays if rays is operator else _moved(rays, device, slabs)
    )
    if changed is operator:
        raise DeviceError(f"GPU: found a {type(operator).__name__}, expected rays of cameras")
    return changed


def _slabs(operator: ProjectionOperator, device: Device) -> int:
    """Return into how many slabs a volume is to be cut to fit on a device; 1 where it fits.

    `DeviceError`: rays or stored entries alone are too many, or gas absorbs.
    """
    voxels, planes = operator.grid.size, operator.grid.shape[0]
    if voxels > MOST_VOXELS:
        raise DeviceError(f"GPU: found {voxels} voxels, expected at most {MOST_VOXELS}")
    rays = rays_of(operator)
    fixed, each = _bytes_needed(operator)
    free = device.free_bytes()
    if fixed + each * voxels <= free:
        return 1
    room = max(free - fixed, 0) // each
    slabs = -(-planes // max(room // (voxels // planes), 1))  # whole planes
    if isinstance(rays, OnTheFlyProjector) and room * slabs >= voxels:
        return slabs
    raise DeviceError(
        f"GPU: {device.name}: {(fixed + each * voxels) / 1e9:.2f} GB needed and "
        f"{free / 1e9:.2f} GB free; {room} voxels would fit, found {voxels}"
    )


def rays_of(operator: ProjectionOperator) -> Any:
    """Return the rays that an operator is composed of; itself where it is rays."""
    rays: Any = operator

    def note(found: ProjectionOperator) -> ProjectionOperator:
        nonlocal rays
        rays = found
        return found

    operator.with_rays(note)
    return rays


def _bytes_needed(operator: ProjectionOperator) -> tuple[int, int]:
    """Return the bytes of an operator with its vectors of one column, and those of each voxel."""
    rays = rays_of(operator)
    blur = 0 if rays is operator else 128 * rays.shape[0]
    if isinstance(rays, Projector):  # entries, the transpose's, the views'; spans, parts of rows
        return blur + 24 * rays.n_segments + 88 * rays.shape[0], 88
    absorbs = isinstance(rays, AttenuatedProjector)
    sources = rays.rays._sources if absorbs else getattr(rays, "_sources", ())
    numbers = sum(source.ray_count(0, source.n_pixels) for source in sources)
    of_ray = 65 + 16 * absorbs
    return blur + of_ray * numbers + 24 * rays.shape[0], 28 + 8 * absorbs
