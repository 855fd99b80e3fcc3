"""The figures of ``rig.calibration`` when cameras or their images change."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from rigs.rig import Rig

SINCE = "changed_since"
"""Key of the lines that say what was done to a rig after its calibration."""


def recorded(rig: Rig, name: str, camera: str | None = None) -> float | None:
    """Return a figure of a rig's calibration, of all cameras or one; None where it is unknown.

    Unknown is what is missing, not a number, infinite, or not positive.
    """
    figures: Any = rig.calibration or {}
    for key in () if camera is None else ("cameras", camera):
        figures = figures.get(key) if isinstance(figures, Mapping) else None
    value = figures.get(name) if isinstance(figures, Mapping) else None
    if not isinstance(value, (int, float)) or not math.isfinite(value) or not value > 0:
        return None
    return float(value)


def followed(
    before: Rig, after: Rig, names: Mapping[str, str] | None = None, lines: Iterable[str] = ()
) -> dict[str, Any] | None:
    """Return the calibration of the rig ``before`` as it holds for the rig ``after``.

    Figures by camera follow its name, and go with it. A target's pose stands in a camera's
    axes: it is converted where these turned, and to the first camera's where that one is gone.
    Other figures stay those of the images that were calibrated.

    Parameters
    ----------
    before, after : Rig
        In one world and unit.
    names : mapping of str to str, optional
        New names of cameras by their old ones.
    lines : iterable of str
        What was done, to be kept under `SINCE`.
    """
    if not before.calibration or not after.names:
        return before.calibration
    new = {name: (names or {}).get(name, name) for name in before.names}
    record = _by_new_name(before.calibration, new, set(after.names))
    if isinstance(held := record.get("held"), str):
        record["held"] = new.get(held, held)
    poses = record.get("target_poses")
    if isinstance(poses, list | tuple):
        record["target_poses"] = [_pose(pose, before, after, new) for pose in poses]
    known = record.get(SINCE)
    changes = [*(known if isinstance(known, list | tuple) else ()), *lines]
    return record | ({SINCE: changes} if changes else {})


def _by_new_name(data: Any, new: Mapping[str, str], kept: set[str]) -> Any:
    """Return plain data whose mappings by camera have new names, without cameras that are gone."""
    if isinstance(data, list | tuple):
        return [_by_new_name(item, new, kept) for item in data]
    if not isinstance(data, Mapping):
        return data
    if data and data.keys() <= new.keys():
        return {new[key]: value for key, value in data.items() if new[key] in kept}
    return {key: _by_new_name(value, new, kept) for key, value in data.items()}


def _pose(pose: Any, before: Rig, after: Rig, new: Mapping[str, str]) -> Any:
    """Return a target's pose in the axes of a camera that the rig ``after`` has."""
    try:
        corners = np.array(pose["corners"], np.float64)
        is_known = pose["camera"] in new and corners.ndim == 2 and corners.shape[1] == 3
    except (TypeError, ValueError, KeyError, OverflowError):
        is_known = False
    if not is_known:
        return pose
    old = before[pose["camera"]]
    name = new[old.name] if new[old.name] in after.names else after.names[0]
    seen_by = after[name]
    if name == new[old.name] and np.array_equal(old.R, seen_by.R):
        return dict(pose) | {"camera": name}
    moved = ((corners - old.t) @ old.R) @ seen_by.R.T + seen_by.t
    return dict(pose) | {
        "camera": name,
        "corners": [[float(f"{x:.6g}") for x in c] for c in moved],
    }
