"""A rig and its calibration's figures after its images or cameras' names changed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigs.camera_protocol import CameraLike
from rigs.ray_table import RayTable
from rigs.rig import Rig


@dataclass(frozen=True)
class ImageChange:
    """How a camera's images were changed: cropped first, then rotated, then resized.

    Parameters
    ----------
    crop : (int, int, int, int), optional
        Column and row of the window's top-left pixel, its width and height.
    degrees : {0, 90, 180, 270}
        Turn of the image, clockwise.
    scale : float
        By how much the image shrank; below one it grew.

    Examples
    --------
    >>> str(ImageChange((1, 2, 30, 20), 90, 2.0))
    'cropped to 30 x 20 pixels from (1, 2), rotated by 90 degrees clockwise, shrunk 2-fold'
    """

    crop: tuple[int, int, int, int] | None = None
    degrees: int = 0
    scale: float = 1.0

    def __str__(self) -> str:
        """Return the change in words."""
        words = []
        if self.crop is not None:
            x, y, width, height = self.crop
            words.append(f"cropped to {width} x {height} pixels from ({x}, {y})")
        if self.degrees:
            words.append(f"rotated by {self.degrees} degrees clockwise")
        if self.scale > 1:
            words.append(f"shrunk {self.scale:g}-fold")
        elif self.scale < 1:
            words.append(f"enlarged {1 / self.scale:g}-fold")
        return ", ".join(words) or "unchanged"

    def of(self, camera: CameraLike) -> CameraLike:
        """Return the camera of the changed image."""
        if self.crop is not None:
            camera = camera.cropped(*self.crop)
        if self.degrees:
            camera = camera.rotated(self.degrees)
        if self.scale != 1:
            if not self.scale > 0:
                raise ValueError(f"camera {camera.name}: scale: found {self.scale}, expected > 0")
            camera = camera.scaled(1 / self.scale)
        return camera


def with_images_changed(rig: Rig, changes: Mapping[str, ImageChange]) -> Rig:
    """Return the rig whose cameras' images were changed, by the cameras' names.

    The calibration's figures in pixels stay those of the images that were calibrated; its entry
    ``changed_since`` says what was done.
    """
    for name in changes:
        rig[name]  # raises where there is none
    cameras = [changes[c.name].of(c) if c.name in changes else c for c in rig]
    changed = replace(rig, cameras=tuple(cameras))
    changes = {name: change for name, change in changes.items() if change != ImageChange()}
    lines = [f"{name}: images {changes[name]}" for name in rig.names if name in changes]
    return replace(changed, calibration=followed(rig, changed, lines=lines))


def with_cameras(rig: Rig, names: Mapping[str, str]) -> Rig:
    """Return the rig of the cameras named, in its order, under new names by their old ones."""
    for name in names:
        rig[name]  # raises where there is none
    kept = tuple(c.renamed(names[c.name]) for c in rig if c.name in names)
    changed = replace(rig, cameras=kept)
    gone = [name for name in rig.names if name not in names]
    lines = [f"{name}: renamed {new}" for name, new in names.items() if new != name]
    if gone:
        lines.append(f"left out: {', '.join(gone)}")
    return replace(changed, calibration=followed(rig, changed, names, lines))


def as_ray_tables(rig: Rig) -> Rig:
    """Return the rig whose cameras are tables of their rays, see `rigs.RayTable.of`.

    A scene is in the rays and needed no longer.
    """
    return replace(rig, cameras=tuple(RayTable.of(camera) for camera in rig))


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
    """Return the calibration of the rig ``before`` as it holds for ``after``, in one world.

    Figures by camera go with its name (``names``: new ones by old ones). A target's pose stands in
    a camera's axes: it is converted where these turned, and to the first camera's where that one
    is gone. Other figures stay those of the images calibrated; `SINCE` keeps ``lines`` on what was
    done.
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
