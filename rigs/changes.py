"""Changes of a rig that follow what was done to its images, and new names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from rigs.calibration_record import followed
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
                raise ValueError(
                    f"camera {camera.name}: scale: found {self.scale}, expected a positive number"
                )
            camera = camera.scaled(1 / self.scale)
        return camera


def with_images_changed(rig: Rig, changes: Mapping[str, ImageChange]) -> Rig:
    """Return the rig whose cameras' images were changed, by the cameras' names.

    The calibration's figures in pixels stay those of the images that were calibrated; its entry
    ``changed_since`` says what was done.

    Raises
    ------
    ValueError
        If the rig has no camera of a name, or a window is not inside an image.
    """
    for name in changes:
        rig[name]  # raises where there is none
    cameras = [changes[c.name].of(c) if c.name in changes else c for c in rig]
    changed = replace(rig, cameras=tuple(cameras))
    changes = {name: change for name, change in changes.items() if change != ImageChange()}
    lines = [f"{name}: images {changes[name]}" for name in rig.names if name in changes]
    return replace(changed, calibration=followed(rig, changed, lines=lines))


def with_cameras(rig: Rig, names: Mapping[str, str]) -> Rig:
    """Return the rig of the cameras named, in the rig's order, under new names.

    Parameters
    ----------
    rig : Rig
    names : mapping of str to str
        New names of the cameras to keep, by their old ones.

    Raises
    ------
    ValueError
        If the rig has no camera of a name, or two cameras would have one.
    """
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
