"""A new world for a rig, in a YAML file: a rigid motion, three points, or points' new places."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.files.text import read_yaml_mapping, shortened
from rigs.files.units import UNKNOWN, metres, resized
from rigs.geometry.alignment import are_on_a_line, motion_between
from rigs.geometry.rotation import numbers, rotation
from rigs.rig import Rig

_POORLY_MET = 0.05  # misfit relative to the points' RMS distance from their middle
_KINDS = (
    ("R", "t"),
    ("origin", "x_axis", "xy_plane"),
    ("points", "become"),
)
_MORE = ("world_frame", "length_unit", "rescale")


@dataclass(frozen=True, eq=False)
class World:
    """The motion ``x_new = size R @ x_old + t`` into a new world.

    Attributes
    ----------
    R, t : (3, 3), (3,) float64
    size : float
        By how much lengths grow, before the motion.
    frame : str
        The new world in words.
    misfit : float
        RMS distance by which given places of points are missed; 0 for other kinds.
    """

    R: NDArray[np.float64]
    t: NDArray[np.float64]
    size: float
    frame: str
    misfit: float = 0.0

    def of(self, rig: Rig) -> Rig:
        """Return the rig in this world; its volume goes along where its faces keep to axes."""
        moved = resized(rig, self.size).transformed(self.R, self.t)
        return replace(moved, world_frame=self.frame)


def load_world(path: str | os.PathLike, length_unit: str) -> World:
    """Return the world that a file describes, in a rig's unit of length.

    The file has the keys ``R`` and ``t`` of ``x_new = R x_old + t``, or three points in the old
    world: ``origin``, ``x_axis`` on the new x axis, ``xy_plane`` in the new x-y plane at y > 0; or
    ``points`` in the old world and what they ``become``, three or more of each, with ``rescale:
    true`` where their distances set the scale. ``length_unit`` is by default the rig's, and
    ``world_frame`` says in words what the new world is.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        In one line: the file, the key, what was found, what was expected.
    """
    data = read_yaml_mapping(path)
    try:
        return _world(data, length_unit)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _world(data: Mapping[str, Any], length_unit: str) -> World:
    found = next((kind for kind in _KINDS if kind[0] in data), ())
    choices = ", or ".join(" and ".join((", ".join(k[:-1]), k[-1])) for k in _KINDS)
    if not found:
        raise ValueError(f"found the keys {shortened(', '.join(data))}, expected {choices}")
    for key in found:
        if key not in data:
            raise ValueError(f"{key}: missing, expected {', '.join(found)}")
    for key in data:
        if key not in (*found, *_MORE):
            raise ValueError(f"{shortened(key)}: unknown, expected {', '.join((*found, *_MORE))}")
    rescale, frame = data.get("rescale", False), data.get("world_frame", "")
    if not isinstance(rescale, bool) or (rescale and found[0] != "points"):
        raise ValueError(
            f"rescale: found {shortened(rescale)}, expected true or false, with points and become"
        )
    if not isinstance(frame, str):
        raise ValueError(f"world_frame: found {shortened(frame)}, expected text")
    factor = _factor(data.get("length_unit", length_unit), length_unit)
    if found[0] == "R":
        R, t = rotation(data["R"], "R"), numbers(data["t"], (3,), "t") * factor
        return World(R, t, 1.0, frame or "moved from the rig's former world")
    if found[0] == "origin":
        R, t = _axes_by_points(*(numbers(data[key], (3,), key) * factor for key in found))
        return World(R, t, 1.0, frame or "origin, x axis and x-y plane by three points")
    places = [_points(data[key], key) * factor for key in found]
    return _by_places(*places, rescale, frame)


def _factor(unit: Any, rig_unit: str) -> float:
    """Return the rig's units in one of the file's."""
    if unit == rig_unit:
        return 1.0
    if not isinstance(unit, str) or rig_unit == UNKNOWN:
        raise ValueError(f"length_unit: found {shortened(unit)}, expected {rig_unit}, the rig's")
    return metres(unit) / metres(rig_unit)


def _points(value: Any, what: str) -> NDArray[np.float64]:
    """Return points ``(N, 3)`` that are not on a line."""
    count = len(value) if isinstance(value, list) else 0
    points = numbers(value, (count or 3, 3), what)
    if are_on_a_line(points):
        raise ValueError(
            f"{what}: found {len(points)} points, expected 3 or more that are not on a line"
        )
    return points


def _axes_by_points(
    origin: NDArray, x_axis: NDArray, xy_plane: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return R and t of the world whose axes three points give."""
    if are_on_a_line(np.stack([origin, x_axis, xy_plane])):
        raise ValueError("origin, x_axis, xy_plane: found on a line, expected points that are not")
    x = x_axis - origin
    x = x / np.linalg.norm(x)
    z = np.cross(x, xy_plane - origin)
    z = z / np.linalg.norm(z)
    R = rotation(np.stack([x, np.cross(z, x), z]), "origin, x_axis, xy_plane")
    return R, -R @ origin


def _by_places(points: NDArray, become: NDArray, rescale: bool, frame: str) -> World:
    """Return the world that carries points to their given places best.

    Raises
    ------
    ValueError
        If the places are missed by more than 5 % of their extent.
    """
    if len(points) != len(become):
        raise ValueError(f"become: found {len(become)} points, expected {len(points)}, as points")
    R, t, size = motion_between(points, become, rescale)
    misfit = float(np.sqrt(((size * points @ R.T + t - become) ** 2).sum(axis=1).mean()))
    extent = float(np.sqrt(((become - become.mean(axis=0)) ** 2).sum(axis=1).mean()))
    if misfit > _POORLY_MET * extent:
        _, _, ratio = motion_between(points, become, rescale=True)
        raise ValueError(
            f"become: found points off these places by {misfit:.3g} RMS, {misfit / extent:.0%} of "
            f"their extent, least at {ratio:.4g} times their size, expected the same points in "
            "the same order and length_unit, not mirrored, or rescale: true"
        )
    words = f"places of {len(points)} points, met within {misfit:.3g} RMS"
    return World(R, t, size, frame or words + (", which set the scale" if rescale else ""), misfit)
