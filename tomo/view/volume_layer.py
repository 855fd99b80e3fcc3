"""The volume in the page: two surfaces, three planes, and pictures along the line of sight."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.draw.scene import ColourScale
from tomo.draw.shapes import Triangles
from tomo.draw.viewpoint import Viewpoint
from tomo.grid import VoxelGrid
from tomo.view.colours import painted, plane_picture
from tomo.view.rendering import INTEGRAL, MAXIMUM, seen_along
from tomo.view.rig_layer import quaternion
from tomo.view.surfaces import light_surface
from tomo.view.world import World

if TYPE_CHECKING:
    import viser

AXES = "xyz"
NO_PICTURE = "none"
PICTURES = (NO_PICTURE, MAXIMUM, INTEGRAL)

TURNING_TRIANGLES = 8_000
"""Of a surface while the eye moves, where a finer one has more. Without a graphics card 90,000
triangles take 0.15 s of a processor for each picture of the page, 12,000 take 0.05 s."""

OUTER_OPACITY = 0.4
"""Of the surface at the threshold, so that the one within shows through."""

LEAST_BRIGHT = 0.3
"""Where the colour map of surfaces begins. Lower: the faint ones vanish before the dark page."""

COARSE, FINE = 150, 360
"""Rows of a picture along the line of sight while the eye moves, and when it rests."""


class VolumeLayer:
    """What is drawn of one volume.

    Parameters
    ----------
    server : viser.ViserServer
    world : World
    grid : VoxelGrid
    """

    def __init__(self, server: viser.ViserServer, world: World, grid: VoxelGrid) -> None:
        self._server, self._world, self._grid = server, world, grid
        self._surfaces: dict[str, list[viser.MeshHandle]] = {}
        self._is_turning = False
        self._planes: dict[int, viser.ImageHandle] = {}

    def __repr__(self) -> str:
        return f"VolumeLayer(grid={self._grid!r})"

    def show_surface(
        self, name: str, volume: NDArray, level: float, scale: ColourScale, opacity: float
    ) -> int:
        """Draw the surface at a level, above zero, in place of the last of this name.

        Returns
        -------
        int
            Its triangles; with none the last surface is taken away.
        """
        self.hide_surface(name)
        found = light_surface(volume, self._grid, level)
        handles = self._surfaces.setdefault(name, [])
        if len(found[1]):
            handles.append(self._add_surface(f"{name}/fine", found, level, scale, opacity))
        if len(found[1]) > TURNING_TRIANGLES:
            coarse = light_surface(volume, self._grid, level, TURNING_TRIANGLES)
            handles.append(self._add_surface(f"{name}/coarse", coarse, level, scale, opacity))
        self.turn(self._is_turning)
        return len(found[1])

    def _add_surface(
        self, name: str, surface: Triangles, level: float, scale: ColourScale, opacity: float
    ) -> viser.MeshHandle:
        vertices, triangles = surface
        triangles = triangles[outermost_first(vertices, triangles, self._grid)]
        return self._server.scene.add_mesh_simple(
            f"/surface/{name}",
            self._world.points(vertices),
            triangles,
            color=surface_colour(level, scale),
            opacity=None if opacity >= 1 else opacity,
            side="front",  # the far side of a translucent one would double the work
            cast_shadow=False,
            receive_shadow=False,
        )

    def turn(self, is_turning: bool) -> None:
        """Show surfaces of few triangles while the eye moves, where fine ones have many."""
        self._is_turning = is_turning
        with self._server.atomic():
            for handles in self._surfaces.values():
                for handle, is_coarse in zip(handles, (False, True), strict=False):
                    is_shown = len(handles) == 1 or is_coarse == is_turning
                    if handle.visible != is_shown:
                        handle.visible = is_shown

    def hide_surface(self, name: str) -> None:
        """Take a surface away."""
        for handle in self._surfaces.pop(name, ()):
            handle.remove()

    def show_plane(self, volume: NDArray, axis: int, at: float, scale: ColourScale) -> None:
        """Draw the plane across an axis at a world coordinate."""
        picture = plane_picture(volume, self._grid, axis, at, scale)
        center = np.array(self._grid.center)
        center[axis] = at
        position = tuple(self._world.points(center))
        if axis in self._planes:
            handle = self._planes[axis]
            handle.image, handle.position, handle.visible = picture, position, True
            return
        level, upright = (axis + 1) % 3, (axis + 2) % 3
        extent = self._grid.extent / self._world.unit
        self._planes[axis] = self._server.scene.add_image(
            f"/planes/{AXES[axis]}",
            picture,
            float(extent[level]),
            float(extent[upright]),
            format="png",
            wxyz=quaternion(np.eye(3)[[level, upright, axis]].T),
            position=position,
            cast_shadow=False,
            receive_shadow=False,
        )

    def hide_plane(self, axis: int) -> None:
        """Hide the plane across an axis."""
        if axis in self._planes:
            self._planes[axis].visible = False

    def picture_for(
        self,
        camera: viser.CameraHandle,
        volume: NDArray,
        how: str,
        colours: ColourScale,
        rows: int,
    ) -> NDArray[np.uint8]:
        """Return what a page's eye sees of the volume, in colours, ``(rows, columns, 3)``.

        Colours are of the values for the maximum. Integrals have no common scale: the brightest
        is the last colour.
        """
        viewpoint = viewpoint_of(camera, self._world, rows)
        seen = seen_along(volume, self._grid, viewpoint, how)
        if how == INTEGRAL:
            most = float(seen.max(initial=0.0)) or 1.0
            colours = ColourScale("", 0.0, most, colours.colours)
        return painted(seen, colours)


def outermost_first(
    vertices: NDArray[np.float64], triangles: NDArray, grid: VoxelGrid
) -> NDArray[np.intp]:
    """Return the order of triangles ``(T, 3)`` from the outermost to the one in the middle.

    The page draws a translucent surface in this order and hides what lies behind what it has
    drawn. From wherever one looks, the outer parts are mostly those in front; in another order
    parts behind shine through in streaks.
    """
    out = np.linalg.norm((vertices - grid.center) / grid.extent, axis=1)
    return np.argsort(-out[triangles].sum(axis=1), kind="stable")


def surface_colour(level: float, scale: ColourScale) -> tuple[int, int, int]:
    """Return the colour of a surface: brighter than its value's, which light and shade darken."""
    span = scale.upper - scale.lower
    ratio = float(np.clip((level - scale.lower) / span, 0, 1))
    shown = scale.lower + span * (LEAST_BRIGHT + (1 - LEAST_BRIGHT) * ratio)
    red, green, blue = painted(np.array(shown), scale).tolist()
    return red, green, blue


def viewpoint_of(camera: viser.CameraHandle, world: World, rows: int) -> Viewpoint:
    """Return a page's eye as a viewpoint of a picture of so many rows."""
    from scipy.spatial.transform import Rotation

    columns = max(2, round(rows * camera.aspect))
    focal = rows / 2 / np.tan(camera.fov / 2)
    axes = Rotation.from_quat(np.asarray(camera.wxyz), scalar_first=True).as_matrix().T
    principal = np.array([columns - 1, rows - 1]) / 2
    return Viewpoint(world.back(camera.position), axes, focal, principal, (columns, rows))
