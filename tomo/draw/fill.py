"""The compiled loop of `tomo.draw.raster`."""

from __future__ import annotations

import math

from tomo._compute.jit import compiled


@compiled()
def fill(samples, nearest, top, places, nearness, colours, opacities) -> None:
    """Lay triangles over samples, in their order.

    Parameters
    ----------
    samples : (rows, columns, 3) float32
        Changed.
    nearest : (rows, columns) float32
        The inverse depth of what is opaque; 0 where nothing is. Changed.
    top : int
        The row of the picture that is the first of these.
    places, nearness, colours, opacities : arrays
        As `tomo.draw.raster` has them, places in samples.
    """
    rows, columns, _ = samples.shape
    for n in range(len(places)):
        x0, y0 = places[n, 0, 0], places[n, 0, 1] - top
        x1, y1 = places[n, 1, 0], places[n, 1, 1] - top
        x2, y2 = places[n, 2, 0], places[n, 2, 1] - top
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if area == 0 or not math.isfinite(area):
            continue
        sign = 1.0 if area > 0 else -1.0
        left = max(math.ceil(min(x0, x1, x2)), 0)
        right = min(math.floor(max(x0, x1, x2)), columns - 1)
        upper = max(math.ceil(min(y0, y1, y2)), 0)
        lower = min(math.floor(max(y0, y1, y2)), rows - 1)
        opacity = opacities[n]
        for row in range(upper, lower + 1):
            for column in range(left, right + 1):
                a = sign * ((x2 - x1) * (row - y1) - (y2 - y1) * (column - x1))
                b = sign * ((x0 - x2) * (row - y2) - (y0 - y2) * (column - x2))
                c = sign * ((x1 - x0) * (row - y0) - (y1 - y0) * (column - x0))
                if a < 0 or b < 0 or c < 0:
                    continue
                # a sample on the border of two triangles belongs to one of them
                if a == 0 and not _owns(sign * (x2 - x1), sign * (y2 - y1)):
                    continue
                if b == 0 and not _owns(sign * (x0 - x2), sign * (y0 - y2)):
                    continue
                if c == 0 and not _owns(sign * (x1 - x0), sign * (y1 - y0)):
                    continue
                a, b, c = a / (sign * area), b / (sign * area), c / (sign * area)
                near = a * nearness[n, 0] + b * nearness[n, 1] + c * nearness[n, 2]
                if near <= nearest[row, column]:
                    continue
                for k in range(3):
                    own = a * colours[n, 0, k] + b * colours[n, 1, k] + c * colours[n, 2, k]
                    samples[row, column, k] += opacity * (own - samples[row, column, k])
                if opacity >= 1:
                    nearest[row, column] = near


@compiled(inline=True)
def _owns(x, y) -> bool:
    """Tell whether a triangle owns the samples on its side along ``(x, y)``."""
    return y > 0 or (y == 0 and x < 0)
