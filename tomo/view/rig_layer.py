"""The rig in the page: cameras with their images, names, lines of sight, the box, the hardware."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike
from rigs.scene.scene_camera import own_camera
from tomo.draw.rig.rig_scene import (
    colour_of,
    frustum,
    rig_scene,
    symbol_length,
    symbol_widening,
    volume_scene,
)
from tomo.draw.scene import Colour, Mesh, as_colour
from tomo.view.content import Content
from tomo.view.world import World

if TYPE_CHECKING:
    import viser

SHOWN = {"sight lines": False, "box": True, "solids": True}
"""Groups of the rig's scene that become layers, and whether they are shown at first."""

_LOOKS: dict[str, Callable[[Colour], Colour]] = {
    "sight lines": lambda colour: colour,
    "box": lambda colour: (0.75, 0.78, 0.82),
    "solids": lambda colour: as_colour(0.35 + 0.65 * c for c in colour),
}
"""Colours on the page's dark ground, of those that pictures on white have."""


class RigLayer:
    """The cameras and what stands around them.

    Parameters
    ----------
    server : viser.ViserServer
    world : World
    content : Content
        With a rig.
    chosen : callable
        Called with the name of a camera that was clicked.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        world: World,
        content: Content,
        chosen: Callable[[str], None],
    ) -> None:
        self._server, self._world, self._content = server, world, content
        self._layers: dict[str, list[viser.SceneNodeHandle]] = {
            name: [] for name in ("cameras", "names", *SHOWN)
        }
        self._frusta: dict[str, viser.CameraFrustumHandle] = {}
        if content.rig is not None:
            self._add_scene()
            for camera in content.rig:
                self._add_camera(camera, chosen)
        elif content.box is not None:
            self._add_meshes("box", volume_scene(content.box).meshes)

    def __repr__(self) -> str:
        return f"<RigLayer: {len(self._frusta)} cameras>"

    @property
    def names(self) -> tuple[str, ...]:
        """The layers that have something to show."""
        return tuple(name for name, parts in self._layers.items() if parts)

    def show(self, layer: str, is_shown: bool) -> None:
        """Show or hide a layer."""
        with self._server.atomic():
            for part in self._layers[layer]:
                part.visible = is_shown

    def show_images(self, pictures: Mapping[str, NDArray[np.uint8]]) -> None:
        """Hang pictures ``(rows, columns, 3)`` into the cameras' symbols; None takes them away."""
        with self._server.atomic():
            for name, handle in self._frusta.items():
                handle.image = pictures.get(name)

    def _add_camera(self, camera: CameraLike, chosen: Callable[[str], None]) -> None:
        content, world = self._content, self._world
        own, name = own_camera(camera), camera.name
        _, colour = colour_of(own, content.target, content.up)
        fov, aspect = field_of_view(own)
        depth = symbol_length(content.rig, content.target) / world.unit
        half = np.tan(fov / 2)
        handle = self._server.scene.add_camera_frustum(
            f"/cameras/{len(self._frusta)}",
            fov,
            aspect,
            scale=depth * float(np.cbrt(half * half * aspect / 3)),  # viser divides by that
            thickness=2.0,
            thickness_units="screen",
            color=colour,
            wxyz=quaternion(own.R.T),
            position=tuple(world.points(own.position)),
            cast_shadow=False,
            receive_shadow=False,
        )
        handle.on_click(lambda _: chosen(name))
        self._frusta[name] = handle
        away = world.points(own.position)
        label = self._server.scene.add_label(
            f"/names/{len(self._frusta)}",
            name,
            position=tuple(away * 1.06),
            anchor="center-center",
            font_screen_scale=0.8,
            visible=False,
        )
        self._layers["cameras"].append(handle)
        self._layers["names"].append(label)

    def _add_scene(self) -> None:
        scene = rig_scene(self._content.rig, self._content.box, up=self._content.up)
        for layer in SHOWN:
            self._add_meshes(layer, scene.only([layer]).meshes)

    def _add_meshes(self, layer: str, meshes: tuple[Mesh, ...]) -> None:
        """Add meshes, those of one look as one: the page draws few large ones faster."""
        looks: dict[tuple, Mesh] = {}
        for mesh in meshes:
            look = (*mesh.colour, mesh.opacity)
            looks[look] = looks[look].merged(mesh) if look in looks else mesh
        for number, mesh in enumerate(looks.values()):
            handle = self._server.scene.add_mesh_simple(
                f"/{layer.replace(' ', '_')}/{number}",
                self._world.points(mesh.vertices),
                mesh.triangles,
                color=_LOOKS[layer](mesh.colour),
                opacity=None if mesh.opacity >= 1 else mesh.opacity,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
                visible=SHOWN[layer],
            )
            self._layers[layer].append(handle)


def field_of_view(camera: CameraLike) -> tuple[float, float]:
    """Return the upright angle in radians and width over height of a camera's symbol.

    A symbol is a pyramid about the optical axis, opened as in pictures of rigs: a lens' bent
    border and a principal point off the middle do not show in it.
    """
    corners = frustum(camera, 1.0, widen=symbol_widening(camera)) - camera.position
    across = corners @ camera.R.T
    width, height = np.ptp(across[:, 0]), np.ptp(across[:, 1])
    return float(2 * np.arctan(height / 2)), float(width / max(height, 1e-9))


def quaternion(R: NDArray) -> tuple[float, float, float, float]:
    """Return a rotation matrix as ``(w, x, y, z)``."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = Rotation.from_matrix(R).as_quat(scalar_first=True).tolist()
    return w, x, y, z
