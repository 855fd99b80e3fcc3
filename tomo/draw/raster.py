"""Draw the triangles of a scene into a picture: shaded, antialiased, without display or GPU."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo.draw.frame import Viewpoint
from tomo.draw.scene import Colour, Scene

_AMBIENT, _DIFFUSE = 0.55, 0.45
_LIGHT = np.array(
    [-0.4, -0.75, -0.55]
)  # from the upper left, behind the eye: right, down, forward
_SAMPLES_AT_ONCE = 4_000_000


def render(
    scene: Scene, viewpoint: Viewpoint, supersample: int = 3, ground: Colour = (1.0, 1.0, 1.0)
) -> NDArray[np.float32]:
    """Return a picture of the scene's meshes, ``(height, width, 3)`` float32 in 0..1.

    Triangles that reach behind the eye are left out. Opaque ones hide what is behind them sample
    by sample; translucent ones are laid over them in the order of their middles, the farthest
    first.
    """
    width, height = viewpoint.size
    places, nearness, colours, opacities = _triangles(scene, viewpoint)
    places = (places + 0.5) * supersample - 0.5
    order = np.where(opacities < 1, nearness.mean(axis=1), -np.inf)
    order = np.argsort(order, kind="stable")  # the opaque ones first
    parts = [one[order] for one in (places, nearness, colours, opacities)]
    rows = max(1, _SAMPLES_AT_ONCE // (width * supersample**2))
    bands = []
    for top in range(0, height, rows):
        count = min(rows, height - top)
        size = (count * supersample, width * supersample)
        samples = np.tile(np.array(ground, np.float32), (*size, 1))
        fill(samples, np.zeros(size, np.float32), top * supersample, *parts)
        blocks = samples.reshape(count, supersample, width, supersample, 3)
        bands.append(blocks.mean(axis=(1, 3)))
    return np.clip(np.concatenate(bands), 0, 1)


def _triangles(scene: Scene, viewpoint: Viewpoint) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return corners in pixels, inverse depths, and colours of triangles, and their opacities.

    Shapes are ``(N, 3 corners, 2)``, ``(N, 3)``, ``(N, 3 corners, 3)`` and ``(N,)``.
    """
    light = _LIGHT @ viewpoint.axes
    light /= np.linalg.norm(light)
    parts = []
    for mesh in scene.meshes:
        depth = (mesh.vertices - viewpoint.eye) @ viewpoint.axes[2]
        ahead = mesh.triangles[(depth[mesh.triangles] > 0).all(axis=1)]
        shade = _AMBIENT + _DIFFUSE * np.abs(mesh.normals() @ light)
        colours = mesh.vertex_colours  # a mesh that shows numbers is not shaded
        colours = shade[:, None] * mesh.colour if colours is None else colours
        places, inverse = viewpoint.project(mesh.vertices)[ahead], 1 / depth[ahead]
        parts.append((places, inverse, colours[ahead], np.full(len(ahead), mesh.opacity)))
    if not parts:
        return np.zeros((0, 3, 2)), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0)
    places, inverse, colours, opacities = map(np.concatenate, zip(*parts, strict=True))
    return places, inverse, colours, opacities


@compiled()
def fill(samples, nearest, top, places, nearness, colours, opacities) -> None:
    """Lay triangles over samples ``(rows, columns, 3)`` float32, in their order; see `_triangles`.

    ``nearest`` ``(rows, columns)`` is the inverse depth of what is opaque, 0 where nothing is;
    both are changed. ``top`` is the row of the picture that is the first of these.
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
