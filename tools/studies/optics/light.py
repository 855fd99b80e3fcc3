"""Images of a flame by dense sampling along the straight pieces that closed-form optics give.

The midpoint rule, as in `studies.scenes.forward`, compiled: an open aperture takes hundreds of
rays a pixel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.compiled import compiled
from studies.optics.flame import PER_VOXEL, Flame
from studies.optics.sights import Sight
from studies.scenes.forward import crossing

STEP = 2.0
"""Nodes between two samples of a ray: its light is then added to 1e-4 of the brightest (RMS)."""


def image(sight: Sight, flame: Flame, extinction: float = 0.0) -> NDArray[np.float64]:
    """Return the image ``(height, width)``: the mean over a pixel's rays of line integrals.

    Parameters
    ----------
    sight : Sight
    flame : Flame
    extinction : float
        ``a``: light is dimmed by ``exp(-a L)``, with the length ``L`` of its way in the grid.
    """
    width, height = sight.camera.image_size
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    total = np.zeros(len(pixels))
    for offset, lens in sight.quadrature():
        for piece in sight.pieces(pixels + offset, lens):
            total += line_integrals(flame, *piece, extinction)
    return (total / len(sight.quadrature())).reshape(height, width)


def line_integrals(
    flame: Flame,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    lengths: NDArray[np.float64],
    extinction: float = 0.0,
) -> NDArray[np.float64]:
    """Return what arrives at the origins of pieces ``(N, 3)`` so long ``(N,)``."""
    lit = np.argwhere(flame.lit)
    edge = flame.grid.spacing[0]
    lower = flame.grid.lower + edge * lit.min(axis=0)
    upper = flame.grid.lower + edge * (lit.max(axis=0) + 1)
    first, last = crossing(origins, directions, lower, upper)
    enters = crossing(origins, directions, *flame.reach)[0] if extinction else first
    return _integrals(
        flame.nodes,
        flame.lit,
        (origins - flame.grid.lower) / flame.spacing,
        directions / flame.spacing,
        first,
        np.minimum(last, lengths),
        enters,
        STEP * flame.spacing,
        extinction,
    )


@compiled
def _integrals(nodes, lit, origins, directions, first, last, enters, step, extinction):
    """Return the integrals ``(N,)``; origins and directions in nodes, distances in lengths."""
    found = np.zeros(len(origins))
    most = (nodes.shape[0] - 2, nodes.shape[1] - 2, nodes.shape[2] - 2)
    for ray in range(len(origins)):
        reach = last[ray] - first[ray]
        if not reach > 0:
            continue
        count = int(np.ceil(reach / step))
        length, total = reach / count, 0.0
        for sample in range(count):
            along = first[ray] + (sample + 0.5) * length
            x = origins[ray, 0] + along * directions[ray, 0]
            y = origins[ray, 1] + along * directions[ray, 1]
            z = origins[ray, 2] + along * directions[ray, 2]
            i = min(max(int(x), 0), most[0])
            j = min(max(int(y), 0), most[1])
            k = min(max(int(z), 0), most[2])
            if lit[i // PER_VOXEL, j // PER_VOXEL, k // PER_VOXEL] == 0:
                continue
            x, y, z = x - i, y - j, z - k
            near = (1 - y) * ((1 - z) * nodes[i, j, k] + z * nodes[i, j, k + 1]) + y * (
                (1 - z) * nodes[i, j + 1, k] + z * nodes[i, j + 1, k + 1]
            )
            i += 1
            far = (1 - y) * ((1 - z) * nodes[i, j, k] + z * nodes[i, j, k + 1]) + y * (
                (1 - z) * nodes[i, j + 1, k] + z * nodes[i, j + 1, k + 1]
            )
            emission = (1 - x) * near + x * far
            if extinction > 0:
                emission *= np.exp(-extinction * (along - enters[ray]))
            total += emission
        found[ray] = total * length
    return found
