"""The geometry of a rig: cameras, where they look, and the box of voxels they look at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig, nearest_point
from rigs.notebook import SYMBOL, upward
from rigs.scene.scene_camera import own_camera
from tomo.draw import shapes
from tomo.draw.frame import EYE, Up
from tomo.draw.rig.surroundings import bent_line, solids_scene
from tomo.draw.scene import Colour, Label, Mesh, Scene, as_colour, rgb
from tomo.grid import VoxelGrid, grid_of_rig

_SYMBOL_SPREAD = 0.38  # least tangent of the symbol's half diagonal: telelenses would be needles
_LEVEL_WITHIN = 5.0  # degrees of elevation that still count as level
_COLOURS = {"above": rgb("#c2500f"), "level": rgb("#1f6fb2"), "below": rgb("#12826a")}
_BOX, _FIELD, _STEM = rgb("#1b2733"), rgb("#7d5ba6"), rgb("#e3e7eb")


@dataclass(frozen=True, eq=False)
class Target:
    """What the rig looks at, and how large it is."""

    center: NDArray[np.float64]  # (3,)
    radius: float

    @classmethod
    def of(cls, rig: Rig, grid: VoxelGrid | None) -> Target:
        """Return the grid's middle and half diagonal, or the point nearest to all optical axes."""
        if grid is not None:
            return cls(np.array(grid.center), float(np.linalg.norm(grid.extent) / 2))
        positions = np.array([camera.position for camera in rig])
        axes = np.array([camera.R[2] for camera in rig])
        center, _ = nearest_point(positions, axes)
        if np.linalg.norm(positions - center, axis=1).max() < 1e-9:  # a single camera
            center = center + axes[0]
        distance = float(np.median(np.linalg.norm(positions - center, axis=1)))
        return cls(center, 0.02 * distance if distance > 0 else 1.0)


def grid_of(rig: Rig, grid: VoxelGrid | None = None) -> VoxelGrid | None:
    """Return ``grid``, or the box that travels with the rig, or None."""
    return grid_of_rig(rig) if grid is None else grid


def up_of(rig: Rig) -> Up:
    """Return the world axis that most cameras' images show upward."""
    return Up(*upward(rig))


def border_rays(camera: CameraLike, per_side: int = 1) -> NDArray[np.float64]:
    """Return unit directions ``(4 per_side, 3)`` through the image's outer border, clockwise.

    Starts at the outer corner of the top-left pixel. Where the lens maps no direction to a border
    point, the outermost point toward the image's middle that it does map stands instead.
    """
    width, height = camera.image_size
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64)
    steps = np.arange(per_side)[:, None] / per_side
    border = np.concatenate(
        [a + (b - a) * steps for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    )
    middle = np.array([0.5, 0.5])
    directions = np.full((len(border), 3), np.nan)
    for shrink in np.linspace(1, 0, 41):
        missing = ~np.isfinite(directions).all(axis=1)
        if not missing.any():
            break
        uv = (middle + (border[missing] - middle) * shrink) * [width, height] - 0.5
        directions[missing] = camera.rays(uv)[1]
    return np.where(np.isfinite(directions), directions, camera.R[2])


def frustum(camera: CameraLike, depth: float, per_side: int = 1, widen: float = 1.0) -> NDArray:
    """Return where the image's border cuts a plane ``depth`` ahead, ``(4 per_side, 3)``.

    ``per_side`` 1 gives the four corners; a distorted image's border is curved. ``widen`` opens
    the frustum, for symbols; 1 is the camera's own.
    """
    return _at_depth(camera, border_rays(camera, per_side), depth, widen)


def _at_depth(camera: CameraLike, directions: NDArray, depth: float, widen: float) -> NDArray:
    """Return where ``directions`` ``(N, 3)``, opened by ``widen``, cut a plane, ``(N, 3)``."""
    forward = camera.R[2]
    cosine = np.maximum(directions @ forward, 0.05)  # a fisheye's may be 0
    return camera.position + depth * (forward + widen * (directions / cosine[:, None] - forward))


def rig_scene(rig: Rig, grid: VoxelGrid | None = None, up: Up | None = None) -> Scene:
    """Return the cameras' symbols and lines of sight, and the box of voxels.

    Groups: ``cameras, names, sight lines, field of view, arrows, arrow names, box, solids`` and
    ``stems`` (each camera's plumb line, for still pictures).
    """
    if not len(rig):
        raise ValueError("rig: found no camera, expected at least one to draw")
    grid = grid_of(rig, grid)
    target = Target.of(rig, grid)
    up = up or up_of(rig)
    typical = typical_distance(rig, target)
    scene = Scene(length_unit=rig.length_unit)
    for camera in rig:
        scene += _camera_scene(own_camera(camera), target, typical, up)
    scene += _stems(rig, target, typical, up)
    if rig.scene is not None:
        scene = scene.without("sight lines") + through_scene(rig, target, typical, up)
    if grid is not None:
        scene += volume_scene(grid, rig.length_unit)
        for camera in rig:
            scene += _arrow(camera, target, grid, up)
        scene += _field_of_view(facing_camera(rig, up), target)
    return scene


def facing_camera(rig: Rig, up: Up) -> CameraLike:
    """Return the camera whose image plane is seen least edge-on in pictures."""
    eye = up.eye_direction(*EYE)
    return max(rig, key=lambda camera: abs(float(camera.R[2] @ eye)))


def volume_scene(grid: VoxelGrid, length_unit: str = "mm") -> Scene:
    """Return the edges of the grid's box; group ``box``."""
    wires = shapes.box_wires(grid, 0.0024 * float(grid.extent.max()))
    return Scene((Mesh("volume box", "box", *wires, _BOX),), length_unit=length_unit)


def colour_of(camera: CameraLike, target: Target, up: Up) -> tuple[str, Colour]:
    """Return whether the camera stands above, level with or below the target, and the colour."""
    elevation = elevation_of(camera, target, up)
    word = "level" if abs(elevation) < _LEVEL_WITHIN else "above" if elevation > 0 else "below"
    return word, _COLOURS[word]


def elevation_of(camera: CameraLike, target: Target, up: Up) -> float:
    """Return the angle in degrees at which the camera stands above the target's level."""
    away = camera.position - target.center
    return float(np.degrees(np.arcsin(away @ up.vector / max(np.linalg.norm(away), 1e-300))))


def symbol_widening(camera: CameraLike) -> float:
    """Return by how much a camera's symbol is opened so that it can be seen; 1 for wide lenses."""
    corners = frustum(camera, 1.0) - camera.position - camera.R[2]
    return max(1.0, _SYMBOL_SPREAD / max(float(np.linalg.norm(corners, axis=1).max()), 1e-12))


def on_symbol(camera: CameraLike, directions: NDArray, length: float) -> NDArray[np.float64]:
    """Return where unit ``directions`` ``(N, 3)`` lie in the face of a camera's symbol."""
    return _at_depth(camera, directions, 1.01 * length, symbol_widening(camera))


def symbol_length(rig: Rig, target: Target) -> float:
    """Return the length of the cameras' symbols."""
    return SYMBOL * typical_distance(rig, target)


def typical_distance(rig: Rig, target: Target) -> float:
    """Return the median distance of the cameras from the target; 1 if they stand on it."""
    distances = [np.linalg.norm(camera.position - target.center) for camera in rig]
    return float(np.median(distances)) or 1.0


def _camera_scene(camera: CameraLike, target: Target, typical: float, up: Up) -> Scene:
    """Return one camera's symbol, name, and line of sight up to the target's surroundings."""
    _, colour = colour_of(camera, target, up)
    position, forward = camera.position, camera.R[2]
    per_side = 1 if camera.is_pinhole else 6
    length, thick = SYMBOL * typical, 0.0028 * typical
    border = frustum(camera, length, per_side, symbol_widening(camera))
    corners = border[::per_side]
    wires = shapes.join(
        [
            shapes.tubes(np.tile(position, (4, 1)), corners, thick),
            shapes.polyline(border, thick, closed=True),
        ]
    )
    middle = position + length * forward
    face = shapes.fan(middle, border)
    # The line ends where the arrows near the volume begin; it tapers with the distance to the
    # target, so that it stays a thin line when one comes close.
    distance = float((target.center - position) @ forward)
    end = max(distance - 2.2 * target.radius, 0.0)
    halfway = 0.75 * end
    points = position + np.array([[0.0], [halfway], [end]]) * forward
    radii = typical * np.array([0.0016, 0.001, 0.0016 * 2.2 * target.radius / typical])
    line = shapes.tubes(points[:2], points[1:], radii[:2], radii[1:])
    away = position - target.center
    return Scene(
        (
            Mesh(camera.name, "cameras", *wires, colour),
            Mesh(camera.name, "cameras", *face, colour, 0.25),
            Mesh(camera.name, "sight lines", *line, as_colour(0.45 + 0.55 * c for c in colour)),
        ),
        (Label(camera.name, "names", position, 0.085 * away, colour),),
    )


def through_scene(rig: Rig, target: Target, typical: float, up: Up) -> Scene:
    """Return the solids of a rig's scene, and the lines of sight that they bend."""
    lines = []
    for camera in rig:
        _, colour = colour_of(own_camera(camera), target, up)
        pale = as_colour(0.45 + 0.55 * c for c in colour)
        points = bent_line(camera, target.center, target.radius)
        line = shapes.polyline(points, 0.0012 * typical)
        lines.append(Mesh(camera.name, "sight lines", *line, pale))
    return Scene(tuple(lines)) + solids_scene(rig.scene, target.radius, typical)


def _stems(rig: Rig, target: Target, typical: float, up: Up) -> Scene:
    """Return plumb lines from the cameras to the floor beneath the lowest of them."""
    floor = floor_height(rig, target, typical, up)
    feet = np.array([own_camera(camera).position for camera in rig])
    tops = feet.copy()
    feet[:, up.axis] = floor
    dots = shapes.tubes(feet, feet + up.vector * 1e-4 * typical, 0.008 * typical, sides=12)
    lines = shapes.tubes(tops, feet, 0.001 * typical)
    return Scene((Mesh("plumb lines", "stems", *shapes.join([lines, dots]), _STEM),))


def floor_height(rig: Rig, target: Target, typical: float, up: Up) -> float:
    """Return the coordinate, along the upward axis, of a floor that is clear of all cameras."""
    heights = [own_camera(camera).position @ up.vector for camera in rig]
    lowest = min(*heights, target.center @ up.vector) if heights else 0.0
    return up.sign * float(lowest - 0.28 * typical)


def _arrow(camera: CameraLike, target: Target, grid: VoxelGrid, up: Up) -> Scene:
    """Return an arrow along the optical axis that stops short of the box, named at its tail."""
    _, colour = colour_of(camera, target, up)
    position, forward = camera.position, camera.R[2]
    lower = grid.lower - 0.12 * target.radius
    upper = grid.upper + 0.12 * target.radius
    with np.errstate(divide="ignore", invalid="ignore"):
        hits = np.stack([(lower - position) / forward, (upper - position) / forward])
    enter = np.nanmax(np.minimum(hits[0], hits[1]))
    leave = np.nanmin(np.maximum(hits[0], hits[1]))
    if not 0 < enter < leave:
        enter = float((target.center - position) @ forward) - target.radius
    length = 0.4 * target.radius
    if enter <= length:
        return Scene()
    tail, tip = position + (enter - length) * forward, position + enter * forward
    shaft = shapes.arrow(tail, tip, 0.0045 * target.radius)
    label = Label(camera.name, "arrow names", tail, -0.1 * target.radius * forward, colour)
    return Scene((Mesh(camera.name, "arrows", *shaft, colour),), (label,))


def _field_of_view(camera: CameraLike, target: Target) -> Scene:
    """Return what the camera's image covers in the plane through the target."""
    depth = float((target.center - camera.position) @ camera.R[2])
    if depth <= 0:
        return Scene()
    per_side = 1 if camera.is_pinhole else 8
    border = frustum(camera, depth, per_side)
    outline = shapes.polyline(border, 0.004 * target.radius, closed=True)
    face = shapes.fan(border.mean(axis=0), border)
    name = f"field of view of {camera.name}"
    return Scene(
        (
            Mesh(name, "field of view", *outline, _FIELD),
            Mesh(name, "field of view", *face, _FIELD, 0.10),
        )
    )
