"""The compiled loops of `tomo.hull.dark_votes`: votes of views on voxels, voxels in views.

Positions come from the corners of bricks by trilinear interpolation, ``corners`` (views, bx + 1,
by + 1, bz + 1, 2). Tables of all views lie in one vector; ``layout`` (views + 1, 3) says where
each begins, and the height and width of its image.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from tomo._compute.jit import compiled
from tomo.hull.projection_lattice import STEP

_SAFE = 1e-3  # pixels: above the rounding error of the interpolation, anywhere in an image


@compiled(inline=True)
def _brick(corners, view, bx, by, bz, axis):
    """Return one coordinate of a brick's eight corners, their range and half a voxel's extent.

    A NaN corner makes all of them NaN.
    """
    a = corners[view, bx, by, bz, axis]
    b = corners[view, bx, by, bz + 1, axis]
    c = corners[view, bx, by + 1, bz, axis]
    d = corners[view, bx, by + 1, bz + 1, axis]
    e = corners[view, bx + 1, by, bz, axis]
    f = corners[view, bx + 1, by, bz + 1, axis]
    g = corners[view, bx + 1, by + 1, bz, axis]
    h = corners[view, bx + 1, by + 1, bz + 1, axis]
    unknown = (a + b + c + d + e + f + g + h) * 0.0
    low = min(min(min(a, b), min(c, d)), min(min(e, f), min(g, h))) + unknown
    high = max(max(max(a, b), max(c, d)), max(max(e, f), max(g, h))) + unknown
    along_x = max(max(abs(e - a), abs(f - b)), max(abs(g - c), abs(h - d)))
    along_y = max(max(abs(c - a), abs(d - b)), max(abs(g - e), abs(h - f)))
    along_z = max(max(abs(b - a), abs(d - c)), max(abs(f - e), abs(h - g)))
    half = (along_x + along_y + along_z) / (2 * STEP) + unknown
    return (a, b, c, d, e, f, g, h), low, high, half


@compiled(inline=True)
def _column(values, x, y):
    """Return a coordinate at the lower end of a brick's column, and how it grows up to the other.

    ``x`` and ``y`` from 0 to 1 across the brick.
    """
    a, b, c, d, e, f, g, h = values
    low = (a * (1 - x) + e * x) * (1 - y) + (c * (1 - x) + g * x) * y
    high = (b * (1 - x) + f * x) * (1 - y) + (d * (1 - x) + h * x) * y
    return low, high - low


@compiled(inline=True)
def _box(low_u, high_u, low_v, high_v, height, width, beyond):
    """Return the pixels ``left, right, top, bottom`` whose area a box touches, ends excluded.

    What lies beyond the image is the nearest pixel of its border if ``beyond``. ``right`` is 0
    where the box is not a number, or leaves the image and nothing lies beyond.
    """
    if not (low_u <= high_u and low_v <= high_v):
        return 0, 0, 0, 0
    inside = low_u >= -0.5 and low_v >= -0.5 and high_u <= width - 0.5 and high_v <= height - 0.5
    if not (inside or beyond):
        return 0, 0, 0, 0
    low_u, high_u = max(low_u, -0.5), max(min(high_u, width - 0.5), -0.5)
    low_v, high_v = max(low_v, -0.5), max(min(high_v, height - 0.5), -0.5)
    left = np.int64(min(math.floor(low_u + 0.5), width - 1))
    top = np.int64(min(math.floor(low_v + 0.5), height - 1))
    right = np.int64(min(math.floor(high_u + 0.5) + 1, width))
    bottom = np.int64(min(math.floor(high_v + 0.5) + 1, height))
    return left, right, top, bottom


@compiled(inline=True)
def _lies_inside(low, high, half, size):
    """Whether all voxels of a brick lie in the image along one axis, each with what it spans."""
    return low - half > _SAFE - 0.5 and high + half < size - 0.5 - _SAFE


@compiled(inline=True)
def _pixels(at, half):
    """Return what `_box` does along one axis, of a voxel that lies in the image."""
    return np.int64(at - half + 0.5), np.int64(at + half + 0.5) + 1


@compiled(inline=True)
def _count(tables, start, stride, left, right, top, bottom):
    above, below = start + top * stride, start + bottom * stride
    return (
        tables[np.uint64(below + right)]
        - tables[np.uint64(above + right)]
        - tables[np.uint64(below + left)]
        + tables[np.uint64(above + left)]
    )


@compiled(parallel=True)
def sum_up(tables, layout):
    """Add to each entry of a view's table those above and left of it."""
    for view in numba.prange(len(layout) - 1):
        start, height, width = layout[view]
        stride = width + 1
        for row in range(height + 1):
            running = 0
            for column in range(stride):
                at = start + row * stride + column
                running += tables[at]
                tables[at] = running + (tables[at - stride] if row > 0 else 0)


@compiled(parallel=True)
def vote(tables, layout, corners, reach, enough, beyond, votes):
    """Count in ``votes`` (nx, ny, nz) uint8 the views without a bright pixel in a voxel's box.

    ``tables`` hold the sums of bright pixels above and left of each corner, ``reach`` (views,)
    grows the boxes on every side. Counting ends at ``enough``; for ``beyond`` see `_box`.
    """
    nx, ny, nz = votes.shape
    n_views, _, bricks_y, bricks_z, _ = corners.shape
    bricks_y, bricks_z = bricks_y - 1, bricks_z - 1
    for brick in numba.prange((corners.shape[1] - 1) * bricks_y * bricks_z):
        bx, rest = divmod(np.int64(brick), bricks_y * bricks_z)
        by, bz = divmod(rest, bricks_z)
        x0, y0, z0 = STEP * bx, STEP * by, STEP * bz
        x1, y1, z1 = min(x0 + STEP, nx), min(y0 + STEP, ny), min(z0 + STEP, nz)
        mixed = np.zeros(n_views, np.bool_)
        dark = 0
        for view in range(n_views):
            start, height, width = layout[view]
            _, low_u, high_u, half_u = _brick(corners, view, bx, by, bz, 0)
            _, low_v, high_v, half_v = _brick(corners, view, bx, by, bz, 1)
            grow = reach[view]
            left, right, top, bottom = _box(
                low_u - grow, high_u + grow, low_v - grow, high_v + grow,
                height, width, beyond,
            )  # fmt: skip
            if right == 0:  # some of its voxels may yet lie in the image
                mixed[view] = half_u >= 0 and half_v >= 0
                continue
            bright = _count(tables, start, width + 1, left, right, top, bottom)
            if bright == 0:
                dark += 1
                if dark >= enough:
                    break
            mixed[view] = 0 < bright < (right - left) * (bottom - top)
        votes[x0:x1, y0:y1, z0:z1] = dark
        if dark >= enough:
            continue
        for view in range(n_views):
            if not mixed[view]:
                continue
            start, height, width = layout[view]
            u, low_u, high_u, half_u = _brick(corners, view, bx, by, bz, 0)
            v, low_v, high_v, half_v = _brick(corners, view, bx, by, bz, 1)
            half_u += reach[view]
            half_v += reach[view]
            inside = _lies_inside(low_u, high_u, half_u, width) and _lies_inside(
                low_v, high_v, half_v, height
            )
            for i in range(x0, x1):
                for j in range(y0, y1):
                    x, y = (i - x0 + 0.5) / STEP, (j - y0 + 0.5) / STEP
                    u0, slope_u = _column(u, x, y)
                    v0, slope_v = _column(v, x, y)
                    for k in range(z0, z1):
                        if votes[i, j, k] >= enough:
                            continue
                        z = (k - z0 + 0.5) / STEP
                        at_u, at_v = u0 + slope_u * z, v0 + slope_v * z
                        if inside:
                            left, right = _pixels(at_u, half_u)
                            top, bottom = _pixels(at_v, half_v)
                        else:
                            left, right, top, bottom = _box(
                                at_u - half_u, at_u + half_u, at_v - half_v, at_v + half_v,
                                height, width, beyond,
                            )  # fmt: skip
                            if right == 0:
                                continue
                        bright = _count(tables, start, width + 1, left, right, top, bottom)
                        votes[i, j, k] += bright == 0


@compiled(parallel=True)
def splat(corners, bricks, ptr, shown, slack, layout, steps):
    """Write to ``steps`` where voxels' boxes begin and end in every view.

    `sum_up` makes of it how many touch each pixel. Brick ``bricks[b]`` (B, 3) has the voxels
    ``shown[ptr[b]:ptr[b + 1]]`` (V, 3): where in the brick their middles are, from 0 to 1.
    """
    for view in numba.prange(corners.shape[0]):
        start, height, width = layout[view]
        stride = width + 1
        for brick in range(len(bricks)):
            bx, by, bz = bricks[brick, 0], bricks[brick, 1], bricks[brick, 2]
            u, low_u, high_u, half_u = _brick(corners, view, bx, by, bz, 0)
            v, low_v, high_v, half_v = _brick(corners, view, bx, by, bz, 1)
            half_u += slack[view]
            half_v += slack[view]
            inside = _lies_inside(low_u, high_u, half_u, width) and _lies_inside(
                low_v, high_v, half_v, height
            )
            for n in range(ptr[brick], ptr[brick + 1]):
                x, y, z = shown[n, 0], shown[n, 1], shown[n, 2]
                u0, slope_u = _column(u, x, y)
                v0, slope_v = _column(v, x, y)
                at_u, at_v = u0 + slope_u * z, v0 + slope_v * z
                if inside:
                    left, right = _pixels(at_u, half_u)
                    top, bottom = _pixels(at_v, half_v)
                else:
                    left, right, top, bottom = _box(
                        max(at_u - half_u, -0.5), min(at_u + half_u, width - 0.5),
                        max(at_v - half_v, -0.5), min(at_v + half_v, height - 0.5),
                        height, width, False,
                    )  # fmt: skip
                    if right <= left or bottom <= top:
                        continue
                above, below = start + top * stride, start + bottom * stride
                steps[np.uint64(above + left)] += 1
                steps[np.uint64(below + right)] += 1
                steps[np.uint64(above + right)] -= 1
                steps[np.uint64(below + left)] -= 1
