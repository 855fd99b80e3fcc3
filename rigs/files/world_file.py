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
from rigs.geometry.rotation import POORLY_MET, are_on_a_line, motion_between, numbers, rotation
from rigs.rig import Rig

_KINDS = (("R", "t"), ("origin", "x_axis", "xy_plane"), ("points", "become"))
_MORE = ("world_frame", "length_unit", "rescale")


@dataclass(frozen=True, eq=False)
class World:
    """The motion ``x_new = size R @ x_old + t`` into a new world, which is ``frame`` in words.

    ``misfit`` is the RMS distance by which given places of points are missed; 0 for other kinds.
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


def load_world(path: str | os.PathLike, rig: Rig) -> World:
    """Return the world that a file describes for a rig.

    The file has the keys ``R`` and ``t`` of ``x_new = R x_old + t``, or three points in the old
    world: ``origin``, ``x_axis`` on the new x axis, ``xy_plane`` in the new x-y plane at y > 0; or
    ``points`` in the old world and what they ``become``, three or more of each; or, as for
    calibrate-rig, new positions of three or more cameras by name. ``rescale: true`` lets distances
    set the scale. ``length_unit`` is by default the rig's, and
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
        return _world(data, rig)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _world(data: Mapping[str, Any], rig: Rig) -> World:
    given = {key: value for key, value in data.items() if key not in _MORE}
    rescale, frame = data.get("rescale", False), data.get("world_frame", "")
    if not isinstance(rescale, bool):
        raise ValueError(f"rescale: found {shortened(rescale)}, expected true or false")
    if not isinstance(frame, str):
        raise ValueError(f"world_frame: found {shortened(frame)}, expected text")
    factor = _factor(data.get("length_unit", rig.length_unit), rig.length_unit)
    if given and all(isinstance(key, str) and key in rig for key in given):
        points = np.array([rig[name].position for name in given])
        places = np.array([numbers(place, (3,), name) for name, place in given.items()])
        return _by_places(points, places * factor, rescale, frame)
    keys = next((kind for kind in _KINDS if kind[0] in given), ())
    if not keys:
        choices = ", or ".join(" and ".join((", ".join(k[:-1]), k[-1])) for k in _KINDS)
        raise ValueError(
            f"found the keys {shortened(', '.join(map(str, data)))}, expected {choices}, or "
            "positions by the rig's names of cameras"
        )
    for key in keys:
        if key not in given:
            raise ValueError(f"{key}: missing, expected {', '.join(keys)}")
    for key in given:
        if key not in keys:
            raise ValueError(f"{shortened(key)}: unknown, expected {', '.join((*keys, *_MORE))}")
    if keys[0] == "points":
        here, there = (_points(data[key], key) * factor for key in keys)
        return _by_places(here, there, rescale, frame)
    if rescale:
        raise ValueError("rescale: found true, expected points and what they become with it")
    if keys[0] == "R":
        R, t = rotation(data["R"], "R"), numbers(data["t"], (3,), "t") * factor
        return World(R, t, 1.0, frame or "moved from the rig's former world")
    R, t = _axes_by_points(*(numbers(data[key], (3,), key) * factor for key in keys))
    return World(R, t, 1.0, frame or "origin, x axis and x-y plane by three points")


def _factor(unit: Any, rig_unit: str) -> float:
    """Return the rig's units in one of the file's."""
    if unit == rig_unit:
        return 1.0
    if not isinstance(unit, str) or rig_unit == UNKNOWN:
        raise ValueError(f"length_unit: found {shortened(unit)}, expected {rig_unit}, the rig's")
    return metres(unit) / metres(rig_unit)


def _points(value: Any, what: str) -> NDArray[np.float64]:
    """Return points ``(N, 3)``."""
    count = len(value) if isinstance(value, list) else 0
    return numbers(value, (count or 3, 3), what)


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
    """Return the world that carries points to their given places best."""
    if len(points) != len(become):
        raise ValueError(f"become: found {len(become)} points, expected {len(points)}, as points")
    for name, some in (("points", points), ("become", become)):
        if are_on_a_line(some):
            raise ValueError(f"{name}: found {len(some)} points, expected 3 or more not on a line")
    R, t, size = motion_between(points, become, rescale)
    misfit = float(np.sqrt(((size * points @ R.T + t - become) ** 2).sum(axis=1).mean()))
    extent = float(np.sqrt(((become - become.mean(axis=0)) ** 2).sum(axis=1).mean()))
    if misfit > POORLY_MET * extent:
        _, _, ratio = motion_between(points, become, rescale=True)
        raise ValueError(
            f"become: found points off these places by {misfit:.3g} RMS, {misfit / extent:.0%} of "
            f"their extent, least at {ratio:.4g} times their size, expected the same points in "
            "the same order and length_unit, not mirrored, or rescale: true"
        )
    words = f"places of {len(points)} points, met within {misfit:.3g} RMS"
    return World(R, t, size, frame or words + (", which set the scale" if rescale else ""), misfit)
