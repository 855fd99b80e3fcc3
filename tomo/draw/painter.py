"""Draw a scene's triangles one over the other, without Open3D: the still picture of a page."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo.draw.scene import Scene
from tomo.draw.viewpoint import Viewpoint


def painted(scene: Scene, viewpoint: Viewpoint) -> NDArray[np.float32]:
    """Return the triangles on black, ``(height, width, 3)`` in 0..1, the farthest painted first.

    A page needs no more: its script draws what is behind what, and `tomo.draw.raycast` pictures.
    Triangles that reach behind the eye are left out; translucent ones are dark.
    """
    import cv2

    places, depths, colours = [], [], []
    for mesh in scene.meshes:
        corners = (mesh.vertices - viewpoint.eye)[mesh.triangles]  # (N, 3 corners, 3)
        depth = corners @ viewpoint.axes[2]
        ahead = (depth > 0).all(axis=1)
        places.append(viewpoint.project(mesh.vertices)[mesh.triangles[ahead]])
        depths.append(depth[ahead].mean(axis=1))
        own = mesh.vertex_colours
        plain = np.broadcast_to(mesh.colour, (int(ahead.sum()), 3))
        face = plain if own is None else own[mesh.triangles[ahead]].mean(axis=1)
        colours.append(mesh.opacity * face)
    width, height = viewpoint.size
    picture = np.zeros((height, width, 3), np.float32)
    if places:
        uv = np.clip(np.round(np.concatenate(places)), -30000, 30000).astype(np.int32)
        shades = np.concatenate(colours)
        for n in np.argsort(-np.concatenate(depths), kind="stable"):
            cv2.fillConvexPoly(picture, uv[n], shades[n].tolist())
    return picture
