"""RTK's ``RTKThreeDCircularGeometry`` XML: nine parameters and a matrix for each projection.

Written only. RTK projects onto a flat detector, square in its length unit, whose axes are x right
and y *up*, seen from the source at the positive side of ``n = x cross y``::

    [u w, v w, w] = Matrix @ [X, Y, Z, 1]
    Matrix = translate(sx - px, sy - py) magnify(-SDD, -SID) translate(-sx, -sy, 0) Rotation
    Rotation = Rz(-InPlane) Rx(-OutOfPlane) Ry(-Gantry)

Here the projections' pixels are ``spacing = (1, fx / fy)`` apart in the rig's length unit, the
origin (0, 0) is the centre of the *bottom*-left pixel, and images are to be stored bottom row
first: ``u = column``, ``v = (rows - 1 - row) fx / fy``. RTK has one stack of projections, so
cameras must be of one image size and one ratio fx / fy; a path that ends in ``.xml`` is one stack,
any other is a folder of one stack per camera. The spacing is written as a comment. Lenses
and skew are refused: RTK has pinholes alone. The isocentre is the origin of the rig's world.
Source: ``src/rtkThreeDCircularProjectionGeometry.cxx`` at https://github.com/RTKConsortium/RTK and
its documentation, http://www.openrtk.org/Doxygen/DocGeo3D.html.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from rigs.camera_protocol import LensCamera
from rigs.files.text import write_text
from rigs.formats._lens import refuse_lens, refuse_skew, refuse_tables
from rigs.rig import Rig


def save(rig: Rig, path: Path) -> None:
    """Write one XML for all cameras, or, into a folder, one for each."""
    cameras = refuse_tables(rig, "RTK")
    if not cameras:
        raise ValueError("cameras: found none, expected at least one")
    for camera in cameras:
        if any(camera.distortion.coefficients):
            refuse_lens(camera, "RTK")
        refuse_skew(camera, "RTK")
    if path.suffix == ".xml":
        write_text(path, _text(rig))
        return
    path.mkdir(parents=True, exist_ok=True)
    for index, camera in enumerate(cameras):
        write_text(path / f"{camera.name}.xml", _text(rig[index : index + 1]))


def parameters(camera: LensCamera) -> dict[str, float]:
    """Return RTK's nine parameters of a pinhole, angles in degrees."""
    (fx, _, cx), (_, fy, cy) = camera.camera_matrix[:2].tolist()
    axes = _axes(camera)  # rows: right, up, towards the source
    source = axes @ camera.position
    rows = camera.image_size[1]
    gantry, out_of_plane, in_plane = _angles(axes)
    return {
        "SourceToIsocenterDistance": float(source[2]),
        "SourceToDetectorDistance": fx,
        "GantryAngle": gantry,
        "ProjectionOffsetX": float(source[0]) - cx,
        "ProjectionOffsetY": float(source[1]) - (rows - 1 - cy) * fx / fy,
        "OutOfPlaneAngle": out_of_plane,
        "InPlaneAngle": in_plane,
        "SourceOffsetX": float(source[0]),
        "SourceOffsetY": float(source[1]),
    }


def matrix(camera: LensCamera) -> NDArray[np.float64]:
    """Return the projection matrix ``(3, 4)`` onto (u, v) in length units."""
    p = parameters(camera)
    shift = np.eye(3)
    shift[0, 2] = p["SourceOffsetX"] - p["ProjectionOffsetX"]
    shift[1, 2] = p["SourceOffsetY"] - p["ProjectionOffsetY"]
    sdd, sid = p["SourceToDetectorDistance"], p["SourceToIsocenterDistance"]
    magnify = np.array([[-sdd, 0, 0, 0], [0, -sdd, 0, 0], [0, 0, 1, -sid]])
    motion = np.eye(4)
    motion[:3, :3] = _axes(camera)
    motion[:2, 3] = -p["SourceOffsetX"], -p["SourceOffsetY"]
    return shift @ magnify @ motion


def _axes(camera: LensCamera) -> NDArray[np.float64]:
    """Return the detector's axes as rows ``(3, 3)``: right, up and towards the source."""
    return np.diag([1.0, -1.0, -1.0]) @ camera.R


def _angles(axes: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return gantry, out-of-plane and in-plane angle in degrees: axes = Rz(-i) Rx(-o) Ry(-g)."""
    sin = float(np.clip(axes[2, 1], -1.0, 1.0))
    if abs(sin) < 1 - 1e-12:
        about_y = math.atan2(-axes[2, 0], axes[2, 2])
        about_z = math.atan2(-axes[0, 1], axes[1, 1])
    else:  # straight up or down only the sum of the two is determined
        about_y, about_z = math.atan2(axes[0, 2], axes[0, 0]), 0.0
    return -math.degrees(about_y), -math.degrees(math.asin(sin)), -math.degrees(about_z)


def _text(rig: Rig) -> str:
    """Return the file of cameras that share a stack of projections."""
    first = rig[0]
    spacing = first.camera_matrix[0, 0] / first.camera_matrix[1, 1]
    for camera in rig:
        ratio = camera.camera_matrix[0, 0] / camera.camera_matrix[1, 1]
        said = ""
        if camera.image_size != first.image_size:
            said = f"image_size: found {camera.image_size}, expected {first.image_size}"
        elif not math.isclose(ratio, spacing):
            said = f"camera_matrix: found fx / fy = {ratio:.9g}, expected {spacing:.9g}"
        if said:
            raise ValueError(
                f"camera {camera.name}: {said} as of camera {first.name}: RTK has one pixel shape "
                "per stack; write a folder of one XML each"
            )
    projections = "".join(_projection(camera) for camera in refuse_tables(rig, "RTK"))
    return (
        '<?xml version="1.0"?>\n<!DOCTYPE RTKGEOMETRY>\n'
        '<RTKThreeDCircularGeometry version="3">\n'
        f"  <!-- projections: spacing 1 x {float(spacing)!r}, origin 0 0 at the centre of the "
        f"bottom-left pixel, bottom row first, {first.image_size[0]} x {first.image_size[1]} "
        f"pixels, lengths in {_comment(rig.length_unit)} -->\n"
        f"{projections}</RTKThreeDCircularGeometry>\n"
    )


def _projection(camera: LensCamera) -> str:
    """Return the element of a camera."""
    values = "".join(
        f"    <{name}>{value!r}</{name}>\n" for name, value in parameters(camera).items()
    )
    rows = "".join(
        "      " + " ".join(repr(value) for value in row) + "\n" for row in matrix(camera).tolist()
    )
    return (
        f"  <!-- {_comment(camera.name)} -->\n  <Projection>\n{values}"
        f"    <Matrix>\n{rows}    </Matrix>\n  </Projection>\n"
    )


def _comment(text: str) -> str:
    """Return text that may stand in a comment of XML."""
    return re.sub("-(?=-)", "- ", escape(text))
