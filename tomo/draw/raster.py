"""Draw the triangles of a scene into a picture: shaded, antialiased, without display or GPU."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo.draw.scene import Colour, Scene
from tomo.draw.viewpoint import Viewpoint

_AMBIENT, _DIFFUSE = 0.55, 0.45
_LIGHT = np.array(
    [-0.4, -0.75, -0.55]
)  # from the upper left, behind the eye: right, down, forward
_SAMPLES_AT_ONCE = 4_000_000


def render(
    scene: Scene, viewpoint: Viewpoint, supersample: int = 3, ground: Colour = (1.0, 1.0, 1.0)
) -> NDArray[np.float32]:
    """Return a picture of the scene's meshes.

    Parameters
    ----------
    scene : Scene
    viewpoint : Viewpoint
        Triangles that reach behind its eye are left out.
    supersample : int
        Samples along each side of a pixel; their mean smooths the edges.
    ground : (3,) tuple
        The colour behind them; white when not given.

    Returns
    -------
    picture : (height, width, 3) float32
        Red, green, blue in 0..1.

    Notes
    -----
    Opaque triangles hide what is behind them sample by sample; translucent ones are laid over
    them in the order of their middles, the farthest first.
    """
    from tomo.draw.fill import fill

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
