"""Lenses of other programs: as `Distortion`, or as directions where none of `rigs.lens` equals it.

omni: Mei and Rives, "Single view point omnidirectional camera calibration from planar grids"
(2007). ds (equations 46 to 51) and eucm (34 to 36): Usenko, Demmel and Cremers, "The double sphere
camera model" (2018). Metashape, p3 and p4 before version 1.5: appendix "Camera models" of its
manual. With ``q = x^2 + y^2``, ``(x, y)`` the tangents, or behind a fisheye the angle times its
direction across, its image point in focal lengths is ::

    x' = x (1 + k1 q + k2 q^2 + k3 q^3 + k4 q^4) + (p1 (q + 2 x^2) + 2 p2 x y) (1 + p3 q + p4 q^2)
    y' = y (1 + k1 q + k2 q^2 + k3 q^3 + k4 q^4) + (p2 (q + 2 y^2) + 2 p1 x y) (1 + p3 q + p4 q^2)
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike, LensCamera, has_lens
from rigs.geometry.image_checks import pixel_centres
from rigs.lens import Distortion
from rigs.ray_table import RayTable
from rigs.rig import Rig

_NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
#: The names of our models' coefficients, in their order.
SLOTS = {"none": (), "brown": _NAMES[:5], "rational": _NAMES, "fisheye": ("k1", "k2", "k3", "k4")}
#: OpenCV's vector of coefficients, by its length.
_BY_LENGTH = {4: "brown", 5: "brown", 8: "rational", 12: "thin_prism", 14: "tilted"}


def from_vector(coefficients: ArrayLike, fisheye: bool, what: str) -> Distortion:
    """Return the lens of OpenCV's vector; where all are zero, and it is no fisheye, none."""
    values = np.asarray(coefficients, np.float64).reshape(-1)
    if fisheye:
        if len(values) != 4:
            raise ValueError(f"{what}: found {len(values)} coefficients, expected 4 of a fisheye")
        return Distortion("fisheye", tuple(values))
    if not values.any():
        return Distortion()
    if len(values) not in _BY_LENGTH:
        raise ValueError(
            f"{what}: found {len(values)} coefficients, "
            f"expected {', '.join(str(n) for n in _BY_LENGTH)}"
        )
    return Distortion(_BY_LENGTH[len(values)], tuple(values))


def refuse_tables(rig: Rig, format_name: str) -> list[LensCamera]:
    """Return the cameras, or raise if one is a table of rays or looks through a scene.

    Few formats hold those.
    """
    if rig.scene is not None:
        raise ValueError(
            f"scene: found {', '.join(solid.name for solid in rig.scene.solids) or 'none'}, which "
            f"{format_name} lacks: write a rig.yaml, with --ray-tables for programs that know no "
            "scene"
        )
    cameras: list[LensCamera] = []
    for camera in rig:
        if not has_lens(camera):
            raise ValueError(
                f"camera {camera.name}: ray_table: found a table of rays, "
                f"which {format_name} lacks"
            )
        cameras.append(camera)
    return cameras


def refuse_skew(camera: LensCamera, format_name: str) -> None:
    """Raise if the pixels' axes are skewed, which many formats cannot hold."""
    skew = float(camera.camera_matrix[0, 1])
    if skew != 0:
        raise ValueError(
            f"camera {camera.name}: camera_matrix: found skew {skew}, which {format_name} lacks"
        )


def refuse_lens(camera: LensCamera, format_name: str) -> None:
    """Raise because a format cannot hold a camera's lens."""
    raise ValueError(
        f"camera {camera.name}: distortion: found model {camera.distortion.model} "
        f"{list(camera.distortion.coefficients)}, which {format_name} lacks"
    )


def named_model(camera: LensCamera, format_name: str) -> tuple[str, dict[str, float]]:
    """Return the name that COLMAP and nerfstudio give a lens, and its coefficients by name.

    A model whose further coefficients are zero is written as the shorter one that is the same.
    """
    model, values = camera.distortion.model, camera.distortion.coefficients
    full = dict(zip(_NAMES, values, strict=False))  # of a fisheye: not used
    if model == "none":
        return "PINHOLE", {}
    if model == "fisheye":
        return "OPENCV_FISHEYE", dict(zip(SLOTS[model], values, strict=True))
    if any(values[8:]):
        refuse_lens(camera, format_name)
    if model != "brown" and any(values[5:8]):
        return "FULL_OPENCV", {name: full[name] for name in _NAMES[:8]}
    return "OPENCV", {name: full.get(name, 0.0) for name in _NAMES[:5]}


#: Parameters of sphere models, before the focal lengths and the principal point.
SPHERES = {"omni": ("xi",), "ds": ("xi", "alpha"), "eucm": ("alpha", "beta")}
MOST_RAYS = 2**24
"""Largest table of rays made from a formula: about 4 GB while it is made."""
MOST_TABLES = 4
"""How many of the largest tables one rig may have: 1.6 GB."""
_STEPS = 30  # Newton's; a lens that bends by a tenth needs five
_SAME = 1e-12  # focal lengths between an image point and its ray's: 1e-9 px of any camera


def check_table_size(size: tuple[int, int]) -> None:
    """Raise where a few digits of a text file ask for a table far larger than any sensor's."""
    if size[0] * size[1] > MOST_RAYS:
        raise ValueError(
            f"image_size: found {size[0]} x {size[1]} pixels, expected at most {MOST_RAYS} "
            "for a camera that becomes a table of rays"
        )


def limited(cameras: Iterable[CameraLike]) -> tuple[CameraLike, ...]:
    """Return cameras that are made one by one; raise once their tables have too many pixels."""
    found: list[CameraLike] = []
    total = 0
    for camera in cameras:
        found.append(camera)
        total += 0 if camera.has_lens_model else math.prod(camera.image_size)
        if total > MOST_TABLES * MOST_RAYS:
            raise ValueError(
                f"image_size: found tables of rays with {total} pixels, expected at most "
                f"{MOST_TABLES * MOST_RAYS}: the lens is none of rig.yaml's, so keep fewer "
                "images or undistort them first"
            )
    return tuple(found)


def table_of(camera: Camera, seen: NDArray[np.float64]) -> RayTable:
    """Return the table of directions ``(N, 3)``, a pixel each, in the axes of a camera."""
    rows = (seen @ camera.R).reshape(*camera.image_size[::-1], 3)
    return RayTable(camera.name, camera.position, rows, status=camera.status)


def sphere_table(camera: Camera, model: str, parameters: Sequence[float]) -> RayTable:
    """Return a camera with a sphere model behind its own lens."""
    check_table_size(camera.image_size)
    behind = camera.rays()[1] @ camera.R.T  # the model's own image plane, at depth one
    return table_of(camera, sphere(model, parameters, behind[:, :2] / behind[:, 2:]))


def sphere(
    model: str, parameters: Sequence[float], plane: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return unit vectors ``(N, 3)`` seen at ``plane`` ``(N, 2)``, in focal lengths; or NaN."""
    q = (plane**2).sum(axis=1)
    with np.errstate(all="ignore"):
        values = np.array(parameters, np.float64)  # a float of Python raises on overflow
        if model == "omni":
            (xi,) = values
            gain, forward, shift = (xi + np.sqrt(1 + (1 - xi**2) * q)) / (q + 1), 1.0, xi
        elif model == "ds":
            xi, alpha = values
            root = np.sqrt(1 - (2 * alpha - 1) * q)
            forward = (1 - alpha**2 * q) / (alpha * root + 1 - alpha)
            gain = forward * xi + np.sqrt(forward**2 + (1 - xi**2) * q)
            gain, shift = gain / (forward**2 + q), xi
        else:
            alpha, beta = values
            root = np.sqrt(1 - (2 * alpha - 1) * beta * q)
            forward = (1 - beta * alpha**2 * q) / (alpha * root + 1 - alpha)
            gain, shift = 1.0, 0.0
        seen = np.stack([gain * plane[:, 0], gain * plane[:, 1], gain * forward - shift], axis=1)
        return seen / np.linalg.norm(seen, axis=1, keepdims=True)


def metashape_table(camera: Camera, lens: Mapping[str, float], is_fisheye: bool) -> RayTable:
    """Return a camera with a lens ``k1`` to ``k4``, ``p1`` to ``p4`` in place of its own.

    Directions are NaN beyond the lens's first fold.
    """
    check_table_size(camera.image_size)
    uv = np.c_[pixel_centres(camera.image_size), np.ones(np.prod(camera.image_size))]
    plane = (uv @ np.linalg.inv(camera.camera_matrix).T)[:, :2]
    point = _undistorted(plane, lens)
    if is_fisheye:
        return table_of(camera, behind_fisheye(point))
    seen = np.hstack([point, np.ones((len(point), 1))])
    return table_of(camera, seen / np.linalg.norm(seen, axis=1, keepdims=True))


def behind_fisheye(bent: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit vectors of angles times their directions across ``(N, 2)``; NaN from pi on."""
    angle = np.linalg.norm(bent, axis=1, keepdims=True)
    angle = np.where(angle < np.pi, angle, np.nan)
    return np.hstack([bent * np.sinc(angle / np.pi), np.cos(angle)])


def _undistorted(plane: NDArray[np.float64], lens: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the points that the lens maps to ``plane``, both ``(N, 2)``, by Newton's steps."""
    point = np.array(plane)
    active = np.arange(len(point))  # points that a step still moves
    for _ in range(_STEPS):
        here = point[active]
        image, (a, b, c, d) = _distorted(here, lens)
        with np.errstate(all="ignore"):
            short, scale = plane[active] - image, 1 / (a * d - b * c)
            step = np.stack([d * short[:, 0] - b * short[:, 1],
                             a * short[:, 1] - c * short[:, 0]], axis=1)  # fmt: skip
            step *= scale[:, None]
            longest = np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-300)
            moved = here + step * np.minimum(1.0, 0.5 / longest)  # half a focal length at a time
        point[active] = moved
        active = active[(moved != here).any(axis=1) & np.isfinite(moved).all(axis=1)]
    image, (a, b, c, d) = _distorted(point, lens)
    with np.errstate(all="ignore"):
        found = (np.abs(image - plane).max(axis=1) < _SAME) & (a * d - b * c > 0) & (a + d > 0)
    found &= _before_fold(point, lens)
    return np.where(found[:, None], point, np.nan)


def _before_fold(point: NDArray[np.float64], lens: Mapping[str, float]) -> NDArray[np.bool_]:
    """Return whether the radius grows with the image's all the way from the axis to a point."""
    k = [lens[f"k{n}"] for n in (4, 3, 2, 1)]
    slope = np.array(
        [9 * k[0], 7 * k[1], 5 * k[2], 3 * k[3], 1.0]
    )  # d(r gain)/dr in q, high first
    roots = np.roots(np.trim_zeros(slope, "f"))
    real = roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)].real
    with np.errstate(all="ignore"):
        return (point**2).sum(axis=1) < (real.min() if len(real) else np.inf)


def _distorted(
    point: NDArray[np.float64], lens: Mapping[str, float]
) -> tuple[NDArray[np.float64], tuple[NDArray, NDArray, NDArray, NDArray]]:
    """Return the image of points ``(N, 2)`` and the Jacobian's rows a, b and c, d."""
    k1, k2, k3, k4, p1, p2, p3, p4 = (
        lens[f"{letter}{n}"] for letter in "kp" for n in (1, 2, 3, 4)
    )
    x, y = point.T
    with np.errstate(all="ignore"):
        q = x * x + y * y
        gain = 1 + q * (k1 + q * (k2 + q * (k3 + q * k4)))
        d_gain = k1 + q * (2 * k2 + q * (3 * k3 + q * 4 * k4))
        more, d_more = 1 + q * (p3 + q * p4), p3 + 2 * q * p4
        tx, ty = p1 * (q + 2 * x * x) + 2 * p2 * x * y, p2 * (q + 2 * y * y) + 2 * p1 * x * y
        image = np.stack([x * gain + tx * more, y * gain + ty * more], axis=1)
        across = 2 * p1 * y + 2 * p2 * x  # of tx by y and of ty by x alike
        return image, (
            gain + 2 * x * x * d_gain + (6 * p1 * x + 2 * p2 * y) * more + 2 * x * tx * d_more,
            2 * x * y * d_gain + across * more + 2 * y * tx * d_more,
            2 * x * y * d_gain + across * more + 2 * x * ty * d_more,
            gain + 2 * y * y * d_gain + (6 * p2 * y + 2 * p1 * x) * more + 2 * y * ty * d_more,
        )
