"""Start values of cameras that look into another medium, from an adjustment that ignored it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, world_points
from rigs.calibrate.adjust.projection import Lens
from rigs.calibrate.refraction.refraction import Refraction
from rigs.calibrate.refraction.routes import routes_to
from rigs.geometry.rotation import matrix_of_vector
from rigs.scene.plates import Window
from rigs.scene.surfaces import PLANE

_FARTHEST = 4.0  # half a window's size: a line of sight that misses by more is not through it


def start_before_media(
    scene: Scene, arrays: ObservationArrays, refraction: Refraction, held: int | None
) -> Scene:
    """Return unknowns with cameras where they stand, from those that saw no other medium.

    Light in the other medium is straight. An adjustment that ignores the medium's border thus
    finds the targets in it right, and cameras that are m times as far from the border, with m
    times the focal length, where m is the ratio of the indices: the virtual cameras of paraxial
    optics. The border was given relative to the true camera ``held``, if the world's axes are its.
    """
    points = world_points(scene, arrays)
    if held is not None:
        own = np.nanmean(points[arrays.camera == held], axis=0)
        R, t = _world_of_held(scene, refraction, held, own)
        points = points @ R.T + t
        scene = replace(
            scene,
            camera_R=scene.camera_R @ R.T,
            camera_t=scene.camera_t - scene.camera_R @ R.T @ t,
            target_R=R @ scene.target_R,
            target_t=scene.target_t @ R.T + t,
        )
    camera_R, camera_t, lenses = scene.camera_R.copy(), scene.camera_t.copy(), list(scene.lenses)
    for camera, center in enumerate(scene.centers()):
        behind = np.nanmean(points[arrays.camera == camera], axis=0) - center
        found = _border(refraction, center, behind)
        if found is None:
            continue
        length, normal, ratio = found
        behind = behind / np.linalg.norm(behind)
        before = _refracted(behind, normal, ratio)
        seen = _in_own_medium(camera_R[camera] @ behind, ratio)
        turn = _rotation_between(before, camera_R[camera].T @ seen)
        camera_R[camera] = camera_R[camera] @ turn
        place = center + length * (behind - before / ratio)
        camera_t[camera] = -camera_R[camera] @ place
        matrix = lenses[camera].matrix.copy()
        matrix[:2, :2] /= ratio
        coefficients = np.zeros_like(lenses[camera].coefficients)  # those of the medium mostly
        lenses[camera] = Lens(matrix, lenses[camera].model, coefficients)
    return replace(scene, lenses=tuple(lenses), camera_R=camera_R, camera_t=camera_t)


def _world_of_held(
    scene: Scene, refraction: Refraction, held: int, middle: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the motion that takes what one camera sees to behind the border in front of it.

    The border was given in the axes of the true camera, whose virtual one stands behind it.
    """
    center, R = scene.centers()[held], scene.camera_R[held]
    found = _border(refraction, center, middle - center)
    if found is None:
        return np.eye(3), np.zeros(3)
    ratio, behind = found[2], middle - center
    before = R.T @ _in_own_medium(R @ behind / np.linalg.norm(behind), ratio)
    length, normal, _ = _border(refraction, center, before * np.linalg.norm(behind)) or found
    behind = behind / np.linalg.norm(behind)
    turn = _rotation_between(behind, _refracted(before, normal, 1 / ratio))
    virtual = center + length * (before - ratio * turn @ behind)
    return turn, virtual - turn @ center


def _in_own_medium(behind: NDArray[np.float64], ratio: float) -> NDArray[np.float64]:
    """Return a pixel's direction, given that of a lens of ``ratio`` times the focal length."""
    scaled = behind * [ratio, ratio, 1.0]
    return scaled / np.linalg.norm(scaled)


def _rotation_between(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smallest rotation ``(3, 3)`` that takes a unit vector to another one."""
    axis = np.cross(one, other)
    size = np.linalg.norm(axis)
    angle = np.arctan2(size, one @ other)
    return matrix_of_vector(axis * (angle / size if size > 0 else 0.0))


def likely_route(
    refraction: Refraction, center: NDArray[np.float64], point: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return the faces between a camera and a target of which both are known roughly.

    Where nothing is between: those of the window passed most closely, relative to its size.
    """
    route = routes_to(refraction, center, point[None])[0][0]
    route, nearest = route[route >= 0], _FARTHEST
    if len(route):
        return route
    for number, solid in enumerate(refraction.scene.solids):
        if not isinstance(solid, Window):
            continue
        normal, ahead = np.array(solid.normal), np.array(solid.point) - center
        with np.errstate(divide="ignore", invalid="ignore"):
            part = (ahead @ normal) / ((point - center) @ normal)
        away = float(np.linalg.norm(part * (point - center) - ahead)) / (solid.diameter / 2)
        if 0 < part < 1 and away < nearest:
            own = refraction.passing(number)
            route, nearest = own if ahead @ normal < 0 else own[::-1], away
    return route


def _border(
    refraction: Refraction, center: NDArray[np.float64], sight: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64], float] | None:
    """Return how far ahead a camera's light enters another medium, the normal there, the ratio.

    The normal points to the medium. None where the target is in the camera's own medium.
    """
    route = likely_route(refraction, center, center + sight)
    faces = refraction.faces[route]
    if not len(faces):
        return None
    index = refraction.scene.medium
    for face in faces:
        index = face["index"][1] if face["index"][0] == index else face["index"][0]
    ratio = float(index / refraction.scene.medium)
    if abs(ratio - 1) < 1e-3:  # air and vacuum: the shift is below that of the glass
        return None
    first, direction = faces[0], sight / np.linalg.norm(sight)
    if first["kind"] != PLANE:
        length = (first["point"] - center) @ direction - first["radius"]
        return max(float(length), 0.0), direction, ratio
    normal = first["axis"] * np.sign(first["axis"] @ direction)
    return float((first["point"] - center) @ normal / (direction @ normal)), normal, ratio


def _refracted(
    direction: NDArray[np.float64], normal: NDArray[np.float64], ratio: float
) -> NDArray[np.float64]:
    """Return the unit direction on the other side of a border; at most nearly along it."""
    across = ratio * (direction - (direction @ normal) * normal)
    size = float(np.linalg.norm(across))
    across *= min(1.0, 0.99 / max(size, 1e-300))
    return across + np.sqrt(1 - across @ across) * normal
