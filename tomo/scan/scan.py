"""Scan: what calibrated cameras saw, in files that are read when asked for."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.scan.corrections import Corrections

if TYPE_CHECKING:
    from rigs import Rig

Images = list[NDArray[np.float32]]
Masks = list[NDArray[np.bool_]]


@dataclass(frozen=True)
class Frame:
    """One moment.

    Attributes
    ----------
    name : str
    images : mapping
        Camera name to image file.
    """

    name: str
    images: Mapping[str, Path]


@dataclass(frozen=True)
class Scan:
    """A calibrated image set; images are read when asked for, and nothing is kept.

    Parameters
    ----------
    rig : Rig
        The cameras of the images that this scan gives back, shrunk where those are shrunk.
    frames : tuple of Frame
    corrections : Corrections
    grid : VoxelGrid, optional
        Where a volume is worth reconstructing.
    truth : Path, optional
        The volume that the images were simulated from.
    source : Path, optional
        The file or folder that the scan came from; errors name it.
    shrink : int
        By how much the images are shrunk when read.
    recorded_sizes : mapping, optional
        Camera to ``(width, height)`` of the files; that of the rig when None.
    effects : mapping, optional
        What the images were simulated with: the fields of `tomo.simulation.effects.Effects`, and
        ``gains``, camera to gain. Only compared with, as the truth is.
    """

    rig: Rig
    frames: tuple[Frame, ...]
    corrections: Corrections = field(default_factory=Corrections)
    grid: VoxelGrid | None = None
    truth: Path | None = None
    source: Path | None = None
    shrink: int = 1
    recorded_sizes: Mapping[str, tuple[int, int]] | None = None
    effects: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        """Check that names belong together; whether files can be read shows when they are."""
        if self.recorded_sizes is None:
            sizes = {camera.name: tuple(camera.image_size) for camera in self.rig}
            object.__setattr__(self, "recorded_sizes", sizes)
        if not len(self.rig):
            raise ValueError(f"{self._where}cameras: found none, expected at least one")
        if not self.frames:
            raise ValueError(f"{self._where}frames: found none, expected at least one")
        for name, count in Counter(frame.name for frame in self.frames).items():
            if count > 1:
                raise ValueError(f"{self._where}frame {name!r}: found twice, expected once")

    @property
    def frame_names(self) -> tuple[str, ...]:
        """The names of the frames, in order."""
        return tuple(frame.name for frame in self.frames)

    @property
    def _where(self) -> str:
        return "" if self.source is None else f"{self.source}: "

    def frame(self, name: str | None = None) -> Frame:
        """Return a frame by name, or by the end of its name; the first one when None.

        The name itself comes first; then the number that a name ends with, ``90`` for
        ``frame_090``; then any other end, where only one frame has it.

        Raises
        ------
        ValueError
            If no frame, or more than one, is meant; the message lists those that there are.
        """
        if name is None:
            return self.frames[0]
        ways = (
            lambda frame: frame.name == name,
            lambda frame: _last_number(frame.name) == _last_number(name) and name.isdecimal(),
            lambda frame: name != "" and frame.name.endswith(name),
        )
        for is_meant in ways:
            found = [frame for frame in self.frames if is_meant(frame)]
            if len(found) == 1:
                return found[0]
        known = ", ".join(self.frame_names)
        raise ValueError(f"{self._where}frame: found {name!r}, expected one of {known}")

    def without(self, *cameras: str) -> Scan:
        """Return the scan without some cameras, in the rig's order: hold-outs.

        Raises
        ------
        ValueError
            If a camera is unknown, or none would be left.
        """
        self._check_known(cameras)
        return self._keep([name for name in self.rig.names if name not in cameras])

    def only(self, *cameras: str) -> Scan:
        """Return the scan of these cameras alone, in the rig's order.

        Raises
        ------
        ValueError
            If a camera is unknown, or none is named.
        """
        self._check_known(cameras)
        return self._keep([name for name in self.rig.names if name in cameras])

    def _check_known(self, cameras: Iterable[str]) -> None:
        for name in cameras:
            if name not in self.rig.names:
                known = ", ".join(self.rig.names)
                raise ValueError(f"{self._where}camera: found {name!r}, expected one of {known}")

    def _keep(self, names: list[str]) -> Scan:
        cameras = tuple(self.rig[name] for name in names)
        return replace(self, rig=replace(self.rig, cameras=cameras))

    def scaled(self, factor: int) -> Scan:
        """Return the scan with images shrunk ``factor``-fold by area means, and their cameras.

        Sides that ``factor`` does not divide lose their last ``side % factor`` rows or columns, at
        the bottom and on the right; the camera is cropped alike before it is scaled. A shrunk
        pixel is usable only when all of its pixels are.

        Raises
        ------
        ValueError
            If the factor is no whole number >= 1, or an image would have no pixel left.
        """
        if factor < 1 or factor != int(factor):
            raise ValueError(f"scale: found {factor}, expected a whole number >= 1")
        factor = int(factor)
        if factor == 1:
            return self
        cameras = []
        for camera in self.rig:
            if min(camera.image_size) < factor:
                raise ValueError(
                    f"{self._where}camera {camera.name}: scale: found {factor}, expected at most "
                    f"{min(camera.image_size)}, the image's shorter side"
                )
            cameras.append(camera.shrunk(factor))
        rig = replace(self.rig, cameras=tuple(cameras))
        return replace(self, rig=rig, shrink=self.shrink * factor)

    def images(self, frame: str | None = None) -> Images:
        """Return the corrected images of a frame: float32 ``(h, w)``, in the rig's order.

        Unusable pixels are 0; `masks` tells them from dark ones.
        """
        return self.read(frame)[0]

    def masks(self, frame: str | None = None) -> Masks:
        """Return, in the rig's order, bool ``(h, w)`` images: True where the pixel is usable."""
        return self.read(frame)[1]

    def read(self, frame: str | None = None) -> tuple[Images, Masks]:
        """Return images and masks of a frame at once; each file is read once.

        Raises
        ------
        ValueError
            If the frame is unknown, a camera has no image in it, or an image is unreadable, not
            grey, of another size than the camera's, or not finite where it is usable.
        FileNotFoundError
            If an image or a correction's image is missing.
        """
        chosen = self.frame(frame)
        pairs = [self._read_one(chosen, name) for name in self.rig.names]
        return [image for image, _ in pairs], [mask for _, mask in pairs]

    def _read_one(self, frame: Frame, camera: str) -> tuple[NDArray, NDArray]:
        if camera not in frame.images:
            raise ValueError(
                f"{self._where}frame {frame.name!r}: camera {camera}: found no image, "
                "expected one for every camera of the rig"
            )
        path, size = frame.images[camera], self.recorded_sizes[camera]
        image, usable = self.corrections.corrected(path, camera, size, source=self.source)
        return _area_means(image, self.shrink), _all_of_area(usable, self.shrink)


def _last_number(name: str) -> int | None:
    """Return the number that a name ends with; None where it ends otherwise."""
    digits = re.search(r"[0-9]+$", name)
    return int(digits[0]) if digits else None


def _blocks(image: NDArray, factor: int) -> NDArray:
    """Return a view ``(rows, factor, columns, factor)`` of the whole blocks of an image."""
    rows, columns = (side // factor for side in image.shape)
    whole = image[: rows * factor, : columns * factor]
    return whole.reshape(rows, factor, columns, factor)


def _area_means(image: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    if factor == 1:
        return image
    return _blocks(image, factor).mean(axis=(1, 3), dtype=np.float64).astype(np.float32)


def _all_of_area(usable: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    return usable if factor == 1 else _blocks(usable, factor).all(axis=(1, 3))
