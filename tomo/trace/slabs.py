"""Project through a volume slab by slab, with no stored matrix: forward and its exact transpose.

A slab is one layer of voxels across the axis along which the ray moves fastest (in voxels). Inside
a slab the ray crosses each other axis at most once, so it meets at most three voxels, whose
lengths follow from two clamped crossing points without a branch that depends on data. Positions
are computed from the slab's number, never accumulated, so that slabs are independent and the loop
over them vectorises. The forward and the adjoint use the same function for the lengths.

The adjoint gives each thread a range of voxels along x: every thread visits all rays and adds what
falls into its own range. Each voxel's sum is in the order of the rays, whoever owns it, so the
bits do not depend on the number of threads, and nothing is written twice at a time.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from tomo._compile import compiled


@compiled(inline=True)
def _frame(position, direction, length, shape, strides, real):
    """Return a ray's course over its slabs, in units of slabs from the first one on.

    Returns
    -------
    tuple
        ``first, count``: the slabs that it meets; ``enter, leave``: where, in slabs from the
        first; ``b, slope_b, c, slope_c``: where it enters the first slab's lower face along the
        two other axes, and its slopes; ``last_b, last_c``: their last voxels;
        ``stride_a, stride_b, stride_c``; ``scale``: world length a slab; ``axis``.
        Geometry is float64 up to here and ``real`` (float32 or float64) from here on.
    """
    axis = 0
    if abs(direction[1]) > abs(direction[axis]):
        axis = 1
    if abs(direction[2]) > abs(direction[axis]):
        axis = 2
    axis_b = 1 if axis == 0 else 0
    axis_c = 1 if axis == 2 else 2
    start = position[axis]
    stop = start + direction[axis] * length
    low, high = min(start, stop), max(start, stop)
    first = min(max(math.floor(low), 0), shape[axis] - 1)
    last = min(max(math.ceil(high), first + 1), shape[axis])
    per_slab = 1.0 / direction[axis]
    slope_b, slope_c = direction[axis_b] * per_slab, direction[axis_c] * per_slab
    to_face = first - start
    return (
        first,
        last - first,
        real(low - first),
        real(high - first),
        real(position[axis_b] + slope_b * to_face),
        real(slope_b),
        real(position[axis_c] + slope_c * to_face),
        real(slope_c),
        np.int32(shape[axis_b] - 1),
        np.int32(shape[axis_c] - 1),
        strides[axis],
        strides[axis_b],
        strides[axis_c],
        real(abs(per_slab)),
        axis,
    )


@compiled(inline=True)
def _crossing(position, per_slope, before, after, enter, leave):
    """Return where the ray passes from voxel ``before`` to ``after``; ``leave`` if it does not."""
    face = max(before, after)
    at = min(max((face - position) * per_slope, enter), leave)
    return leave if before == after else at


@compiled(inline=True)
def _pieces(slab, enter, leave, b, slope_b, per_b, c, slope_c, per_c, last_b, last_c, real):
    """Return the three voxels ``(b, c)`` that a ray meets in a slab, and its length in each."""
    into = max(real(slab), enter)
    out = max(min(real(slab + 1), leave), into)
    b0 = np.int32(math.floor(b + slope_b * into))
    b1 = np.int32(math.floor(b + slope_b * out))
    c0 = np.int32(math.floor(c + slope_c * into))
    c1 = np.int32(math.floor(c + slope_c * out))
    # A ray that starts within rounding of a plane may seem to pass two.
    b1, c1 = min(max(b1, b0 - 1), b0 + 1), min(max(c1, c0 - 1), c0 + 1)
    at_b = _crossing(b, per_b, real(b0), real(b1), into, out)
    at_c = _crossing(c, per_c, real(c0), real(c1), into, out)
    sooner, later = min(at_b, at_c), max(at_b, at_c)
    b0, b1 = min(max(b0, 0), last_b), min(max(b1, 0), last_b)
    c0, c1 = min(max(c0, 0), last_c), min(max(c1, 0), last_c)
    middle_b = b1 if at_b < at_c else b0
    middle_c = c0 if at_b < at_c else c1
    return b0, c0, sooner - into, middle_b, middle_c, later - sooner, b1, c1, out - later


@compiled(parallel=True, reassociate=True)
def forward(
    positions, directions, lengths, weights, pixel_ptr, shape, volume, images
) -> None:  # fmt: skip
    """Write to ``images`` (P,) the projections of ``volume`` (voxels,).

    Rays as in `tomo.trace.box.BoxCrossing`, grouped by ``pixel_ptr`` with ``weights``.
    """
    real = volume.dtype.type
    strides = (shape[1] * shape[2], shape[2], 1)
    for pixel in numba.prange(len(images)):
        together = 0.0
        for ray in range(pixel_ptr[pixel], pixel_ptr[pixel + 1]):
            if not lengths[ray] > 0:
                continue
            (
                first, count, enter, leave, b, slope_b, c, slope_c, last_b, last_c,
                stride_a, stride_b, stride_c, scale, _,
            ) = _frame(
                positions[ray], directions[ray], lengths[ray], shape, strides, real
            )  # fmt: skip
            per_b, per_c = real(1) / slope_b, real(1) / slope_c
            total = real(0)
            for slab in range(count):
                b0, c0, length0, b1, c1, length1, b2, c2, length2 = _pieces(
                    slab, enter, leave, b, slope_b, per_b, c, slope_c, per_c, last_b, last_c, real
                )
                row = (first + slab) * stride_a
                total += length0 * volume[row + b0 * stride_b + c0 * stride_c]
                total += length1 * volume[row + b1 * stride_b + c1 * stride_c]
                total += length2 * volume[row + b2 * stride_b + c2 * stride_c]
            together += weights[ray] * scale * total
        images[pixel] = together


@compiled(parallel=True)
def adjoint(
    positions, directions, lengths, weights, pixel_ptr, shape, ranges, images, volume
) -> None:  # fmt: skip
    """Add to ``volume`` (voxels,) the back-projection of ``images`` (P,).

    ``ranges`` (parts + 1,) cuts the voxels along x; each part belongs to one thread.
    """
    real = volume.dtype.type
    strides = (shape[1] * shape[2], shape[2], 1)
    for part in numba.prange(len(ranges) - 1):
        low_x, high_x = ranges[part], ranges[part + 1]
        own_from, own_to = low_x * strides[0], high_x * strides[0]
        voxel = np.zeros((3, max(shape)), np.int64)
        value = np.zeros((3, max(shape)), volume.dtype)
        for pixel in range(len(images)):
            if images[pixel] == 0:
                continue
            for ray in range(pixel_ptr[pixel], pixel_ptr[pixel + 1]):
                if not lengths[ray] > 0:
                    continue
                (
                    first, count, enter, leave, b, slope_b, c, slope_c, last_b, last_c,
                    stride_a, stride_b, stride_c, scale, axis,
                ) = _frame(
                    positions[ray], directions[ray], lengths[ray], shape, strides, real
                )  # fmt: skip
                per_b, per_c = real(1) / slope_b, real(1) / slope_c
                start, stop = _slabs_in_range(
                    low_x, high_x, axis, first, count, b, slope_b, np.float64(per_b)
                )
                factor = real(images[pixel] * weights[ray] * scale)
                for slab in range(start, stop):
                    b0, c0, length0, b1, c1, length1, b2, c2, length2 = _pieces(
                        slab, enter, leave, b, slope_b, per_b, c, slope_c, per_c,
                        last_b, last_c, real,
                    )  # fmt: skip
                    row = (first + slab) * stride_a
                    at = slab - start
                    voxel[0, at] = row + b0 * stride_b + c0 * stride_c
                    voxel[1, at] = row + b1 * stride_b + c1 * stride_c
                    voxel[2, at] = row + b2 * stride_b + c2 * stride_c
                    value[0, at] = length0 * factor
                    value[1, at] = length1 * factor
                    value[2, at] = length2 * factor
                for piece in range(3):
                    for at in range(stop - start):
                        v = voxel[piece, at]
                        if own_from <= v < own_to:
                            volume[v] += value[piece, at]


@compiled(inline=True)
def _slabs_in_range(low_x, high_x, axis, first, count, b, slope_b, per_b):
    """Return the slabs ``start, stop`` of a ray that may hold voxels from ``low_x`` to ``high_x``.

    Along x the slabs are the voxels; otherwise x is the ray's axis b.
    """
    if axis == 0:
        return max(low_x - first, 0), max(min(high_x - first, count), 0)
    if slope_b == 0:
        return 0, count
    one, other = (low_x - b) * per_b, (high_x - b) * per_b
    near, far = min(one, other), max(one, other)
    if near > count or far < 0:
        return 0, 0
    return max(int(max(near, 0.0)) - 1, 0), min(int(min(far, count)) + 2, count)
