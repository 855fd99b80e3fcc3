"""Draw a scene with Open3D's RaycastingScene: shaded, antialiased, without display or GPU."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo.draw.scene import Colour, Scene
from tomo.draw.viewpoint import Viewpoint

_AMBIENT, _DIFFUSE = 0.55, 0.45
_LIGHT = np.array(
    [-0.4, -0.75, -0.55]
)  # from the upper left, behind the eye: right, down, forward
_LAYERS = 24  # translucent surfaces looked through
_RAYS_AT_ONCE = 400_000
_HULL_ABOVE = 3000  # triangles; meshes with more are outlined by their convex hull


class _Caster:
    """The scene's triangles in one RaycastingScene, with the colour and opacity of each mesh."""

    def __init__(self, scene: Scene, viewpoint: Viewpoint) -> None:
        import open3d as o3d

        self._tensor = o3d.core.Tensor.from_numpy
        self._scene = o3d.t.geometry.RaycastingScene()
        light = _LIGHT @ viewpoint.axes
        self._light = light / np.linalg.norm(light)
        self._triangles: list[NDArray[np.integer]] = []
        self._normals: list[NDArray[np.float64]] = []
        self._colours: list[NDArray[np.float64] | None] = []
        looks = []
        # float32 is coarse far from zero: coordinates are relative to the eye
        for mesh in scene.meshes:
            if not len(mesh.triangles):
                continue
            vertices = (mesh.vertices - viewpoint.eye).astype(np.float32)
            self._scene.add_triangles(
                self._tensor(vertices), self._tensor(mesh.triangles.astype(np.uint32))
            )
            self._triangles.append(mesh.triangles)
            self._normals.append(mesh.normals())
            self._colours.append(mesh.vertex_colours)
            looks.append((*mesh.colour, mesh.opacity))
        self._looks = np.array(looks).reshape(-1, 4)

    def colours(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return colour times opacity, and opacity, along rays from the eye: ``(N, 4)``."""
        seen = np.zeros((len(directions), 4))
        if not len(self._looks):
            return seen
        alive = np.arange(len(directions))
        distance = np.zeros(len(directions))
        for _ in range(_LAYERS):
            rays = np.concatenate(
                [directions[alive] * distance[alive, None], directions[alive]], 1
            )
            hits = self._scene.cast_rays(self._tensor(rays.astype(np.float32)))
            step = hits["t_hit"].numpy().astype(np.float64)
            hit = np.isfinite(step)
            alive = alive[hit]
            if not alive.size:
                break
            shade, opacity = self._shade(hits, hit)
            weight = (1 - seen[alive, 3]) * opacity
            seen[alive, :3] += shade * weight[:, None]
            seen[alive, 3] += weight
            distance[alive] = (distance[alive] + step[hit]) * (1 + 1e-5)
            alive = alive[seen[alive, 3] < 0.99]
            if not alive.size:
                break
        return seen

    def _shade(self, hits: dict, hit: NDArray) -> tuple[NDArray, NDArray]:
        """Return colour ``(N, 3)`` and opacity ``(N,)`` of the surfaces hit, lit from one side."""
        geometry = hits["geometry_ids"].numpy()[hit]
        primitive = hits["primitive_ids"].numpy()[hit]
        uv = hits["primitive_uvs"].numpy()[hit]
        normals = np.zeros((len(geometry), 3))
        colours = self._looks[geometry, :3]
        unlit = np.zeros(len(geometry), bool)
        for g in np.unique(geometry):
            mine = geometry == g
            corners = self._triangles[g][primitive[mine]]  # (N, 3 corners)
            u, v = uv[mine, 0], uv[mine, 1]
            fraction = np.stack([1 - u - v, u, v], axis=1)[..., None]  # (N, 3 corners, 1)
            normals[mine] = (self._normals[g][corners] * fraction).sum(axis=1)
            own = self._colours[g]
            if own is not None:
                colours[mine] = (own[corners] * fraction).sum(axis=1)
                unlit[mine] = True
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        light = np.where(unlit, 1.0, _AMBIENT + _DIFFUSE * np.abs(normals @ self._light))
        return colours * light[:, None], self._looks[geometry, 3]


def render(
    scene: Scene, viewpoint: Viewpoint, supersample: int = 3, ground: Colour = (1.0, 1.0, 1.0)
) -> NDArray[np.float32]:
    """Return a picture of the scene's meshes.

    Parameters
    ----------
    scene : Scene
    viewpoint : Viewpoint
    supersample : int
        Rays along each side of a pixel; their mean smooths the edges.
    ground : (3,) tuple
        The colour behind them; white when not given.

    Returns
    -------
    picture : (height, width, 3) float32
        Red, green, blue in 0..1.
    """
    width, height = viewpoint.size
    caster = _Caster(scene, viewpoint)
    steps = (np.arange(supersample) + 0.5) / supersample - 0.5
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(1, -1, 2)
    picture = np.tile(np.array(ground, np.float32), (height, width, 1))
    rows, columns = np.nonzero(_may_see(scene, viewpoint))
    pixels_at_once = max(1, _RAYS_AT_ONCE // supersample**2)
    for first in range(0, len(rows), pixels_at_once):
        some = slice(first, first + pixels_at_once)
        pixels = np.stack([columns[some], rows[some]], axis=-1)[:, None]  # (N, 1, 2)
        seen = caster.colours(viewpoint.directions((pixels + offsets).reshape(-1, 2)))
        mean = seen.reshape(-1, supersample**2, 4).mean(axis=1)
        picture[rows[some], columns[some]] = mean[:, :3] + (1 - mean[:, 3:]) * ground
    return np.clip(picture, 0, 1)


def _may_see(scene: Scene, viewpoint: Viewpoint) -> NDArray[np.bool_]:
    """Return the pixels ``(height, width)`` that may show a mesh; rays are cast only there."""
    import cv2

    width, height = viewpoint.size
    mask = np.zeros((height, width), np.uint8)
    for mesh in scene.meshes:
        if not len(mesh.triangles):
            continue
        uv = viewpoint.project(mesh.vertices)
        if not np.isfinite(uv).all():  # reaches behind the eye
            return np.ones((height, width), bool)
        uv = np.clip(np.round(uv), -30000, 30000).astype(np.int32)
        if len(mesh.triangles) > _HULL_ABOVE:
            cv2.fillConvexPoly(mask, cv2.convexHull(uv), 1)
        else:
            for triangle in uv[mesh.triangles]:
                cv2.fillConvexPoly(mask, triangle, 1)
    return cv2.dilate(mask, np.ones((5, 5), np.uint8)) > 0
