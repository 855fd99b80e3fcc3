"""The cases: twelve views on a ring, and what stands in the light's way; lengths in mm.

A case says where cameras really stand, what they see (closed-form sights), and the scene as a
user describes it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rigs import Camera, Optics, Rig, Volume, ring
from rigs.scene import Cylinder, Glass, Mirror, Opaque, Scene, Window
from studies.optics.sights import ByMirror, PastRod, Sight, ThroughLens, ThroughPlate, Vector

VIEWS = 12
DISTANCE = 300.0  # from cameras to the flame's middle, and of the plane in focus
PITCH = 10.0
"""Degrees that cameras stand above the middle: opposite ones then do not share their rays."""

WIDTH, SHAPE = 60.0, (36, 48, 36)  # the flame's depth, as seen by any camera, and voxels
IMAGE_SIZE, FOOTPRINT = (128, 160), 0.6
"""Pixels, and what one covers at the flame: it fills the images' height."""

QUARTZ, THICKNESS = 1.4585, 10.0
STEEPEST = 30.0  # degrees between the most tilted window and the optical axis
WINDOW_AWAY, WINDOW_SIZE = 170.0, (80.0, 80.0)
ROD_RADIUS, ROD_LENGTH = 2.0, 300.0
ROD_AWAY = 33.0
"""From the flame's axis to the rod's: beside the grid, in front of the flame for three views."""

MIRRORED = (2, 7)
MIRROR_AWAY, MIRROR_SIZE = 150.0, (70.0, 100.0)
SPLIT_AWAY, SPLIT_SIZE = 280.0, (110.0, 110.0)
"""From the camera of two views to its mirror, and the mirror's size."""

SPLIT_START, SPLIT_STEP = 150.0, 21.0
"""Degrees at which the other cameras stand: the back of the mirror hides nothing from them."""

LENS = Optics(focal_length=100.0, f_number=2.8, focus_distance=DISTANCE)
APERTURE_RAYS = 16  # rays a pixel in the model
DEPTH = 0.5  # optical depth across the grid


@dataclass(frozen=True, eq=False)
class Case:
    """Views through optics, and the same views without."""

    name: str
    bound: float  # the most that NRMSE may grow where the optics are modelled
    # sights, without: the cameras where they stand, with what is in their way; and the same views
    # without it
    sights: tuple[Sight, ...]
    without: tuple[Sight, ...]
    ignoring: Rig  # the cameras as a user gives them who does not know of the optics
    scene: Scene = field(default_factory=Scene)  # the optics as a user describes them who does
    options: Mapping[str, Any] = field(default_factory=dict)  # what that user asks for
    extinction: float = 0.0  # of the gas in the grid, per mm

    @property
    def modelled(self) -> Rig:
        """The cameras where they stand, with the scene that they look through."""
        rig = replace(self.ignoring, cameras=tuple(sight.camera for sight in self.sights))
        return rig.through(self.scene) if self.scene else rig


def base(scale: float = 1.0) -> Rig:
    """Return cameras with nothing in their way; ``scale`` makes images and grid coarser."""
    shape = tuple(round(n * scale) for n in SHAPE)
    volume = Volume(shape, WIDTH / shape[0])
    return Rig(_around(scale, VIEWS, 360 / VIEWS), volume=volume)


def _around(
    scale: float, views: int, step: float, start: float = 0.0, first: int = 0
) -> tuple[Camera, ...]:
    """Return cameras every ``step`` degrees around the flame, numbered from ``first``."""
    around = ring(
        views,
        step,
        DISTANCE,
        image_size=IMAGE_SIZE,
        footprint=FOOTPRINT,
        pitch_degrees=PITCH,
        start_degrees=start,
    )
    return tuple(
        replace(camera.scaled(scale), name=f"cam{first + number:02d}", status="calibrated")
        for number, camera in enumerate(around)
    )


def windows(rig: Rig) -> Case:
    """Put each camera behind a quartz window of its own, tilted by up to 30 degrees, all ways."""
    sights, solids = [], []
    for view, camera in enumerate(rig):
        tilt, around = np.deg2rad(STEEPEST * (view + 1) / len(rig)), 2.4 * view
        aside = np.cos(around) * camera.R[0] + np.sin(around) * camera.R[1]
        normal = _vector(np.cos(tilt) * camera.R[2] + np.sin(tilt) * aside)
        point = _vector(rig.volume.center - WINDOW_AWAY * camera.R[2])
        sights.append(ThroughPlate(camera, normal, THICKNESS, QUARTZ))
        glass, name = Glass(QUARTZ), f"window {camera.name}"
        solids.append(Window(name, point, normal, THICKNESS, glass, size=WINDOW_SIZE))
    name = "10 mm quartz at 2.5 to 30 degrees"
    return Case(name, 1.15, tuple(sights), _direct(rig), rig, Scene(tuple(solids)))


def rod(rig: Rig) -> Case:
    """Look past an upright rod of 4 mm that three views have in front of the flame."""
    point, axis = _vector(np.add(rig.volume.center, (0, 0, ROD_AWAY))), (0.0, 1.0, 0.0)
    sights = tuple(PastRod(camera, point, axis, ROD_RADIUS) for camera in rig)
    scene = Scene((Cylinder("rod", point, axis, ROD_RADIUS, ROD_LENGTH, Opaque()),))
    return Case("4 mm rod before three views", 1.15, sights, _direct(rig), rig, scene)


def mirrors(rig: Rig) -> Case:
    """Take two views from above by plane mirrors; taken for direct ones where ignored."""
    sights, solids = list(_direct(rig)), []
    for view in MIRRORED:
        camera = rig[view]
        away = -camera.R[2]  # from the flame to the camera
        point = _vector(rig.volume.center + MIRROR_AWAY * away)
        normal = _unit(np.array([0.0, 1.0, 0.0]) - away)
        up = _across(normal, camera.R[1])
        sights[view] = ByMirror(_mirrored(camera, point, normal), point, normal, up, MIRROR_SIZE)
        solids.append(_mirror(f"mirror {camera.name}", sights[view]))
    name = "two views by mirrors"
    return Case(name, 1.15, tuple(sights), _direct(rig), rig, Scene(tuple(solids)))


def split(rig: Rig) -> Case:
    """Take two views by one camera: a mirror in the right half of a wide image shows another side.

    Other cameras see the flame in the mirror behind the flame, or not.
    """
    (width, height), first = rig[0].image_size, rig[0]
    wide = replace(first, image_size=(2 * width, height))
    origin, ahead = (line[0] for line in wide.rays([[1.5 * width - 0.5, (height - 1) / 2]]))
    point = _vector(origin + SPLIT_AWAY * ahead)
    normal = _unit(np.subtract(_unit(np.subtract(rig.volume.center, point)), ahead))
    mirror = ByMirror(wide, point, normal, _across(normal, (0.0, 1.0, 0.0)), SPLIT_SIZE)
    right = replace(wide.cropped(width, 0, width, height), name=f"{first.name} right")
    scale = width / IMAGE_SIZE[0]
    others = _around(scale, len(rig) - 2, SPLIT_STEP, SPLIT_START, first=2)
    return Case(
        "two views on one camera",
        1.15,
        (mirror, *(replace(mirror, camera=camera) for camera in others)),
        tuple(map(Sight, (first, _mirrored(right, point, normal), *others))),
        replace(rig, cameras=(wide, *others)),
        Scene((_mirror("mirror", mirror),)),
    )


def aperture(rig: Rig) -> Case:
    """Take lenses of 100 mm at f/2.8, focused on the flame's middle."""
    plane = LENS.focal_length * DISTANCE / (DISTANCE - LENS.focal_length)  # of the image
    lenses = (replace(LENS, pixel_pitch=plane / camera.camera_matrix[0, 0]) for camera in rig)
    cameras = (replace(c, optics=lens) for c, lens in zip(rig, lenses, strict=True))
    sights = tuple(map(ThroughLens, cameras))
    options = {"aperture_rays": APERTURE_RAYS}
    return Case("f/2.8 at 300 mm over 60 mm", 1.3, sights, _direct(rig), rig, options=options)


def absorption(rig: Rig) -> Case:
    """Fill the grid with gas that absorbs evenly, to an optical depth of 0.5 across the grid."""
    extinction = DEPTH / WIDTH
    direct, options = _direct(rig), {"absorption": extinction}
    return Case(
        "absorption of depth 0.5", 1.3, direct, direct, rig, options=options, extinction=extinction
    )


CASES: dict[str, Callable[[Rig], Case]] = {
    "windows": windows,
    "rod": rod,
    "mirrors": mirrors,
    "split": split,
    "aperture": aperture,
    "absorption": absorption,
}


def _direct(rig: Rig) -> tuple[Sight, ...]:
    return tuple(map(Sight, rig))


def _mirrored(camera: Camera, point: Vector, normal: Vector) -> Camera:
    """Return the camera reflected in a plane; its image has left and right exchanged.

    A reflected frame is left-handed: its x axis is turned round, and columns count from the other
    side.
    """
    H = np.eye(3) - 2 * np.outer(normal, normal)
    R = np.diag([-1.0, 1.0, 1.0]) @ camera.R @ H
    K = np.array(camera.camera_matrix)
    K[0, 2] = camera.image_size[0] - 1 - K[0, 2]
    return replace(camera, camera_matrix=K, R=R, t=-R @ (point + H @ (camera.position - point)))


def _mirror(name: str, sight: ByMirror) -> Mirror:
    across = _vector(np.cross(sight.up, sight.normal))
    return Mirror(name, sight.point, sight.normal, size=sight.size, across=across)


def _across(normal: Vector, towards: ArrayLike) -> Vector:
    """Return the direction in a plane that is nearest to another."""
    return _unit(np.cross(np.cross(normal, towards), normal))


def _vector(values: ArrayLike) -> Vector:
    return tuple(float(value) for value in values)


def _unit(values: ArrayLike) -> Vector:
    return _vector(np.divide(values, np.linalg.norm(values)))
