"""The images of a scan: found by their frames, read and corrected, and what their numbers mean."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.io import VolumeFilm, read_volume
from tomo.io.volume_film import SUFFIX
from tomo.measurement import DeadLines, StoredBits
from tomo.scan.advice import FILE, OPTIONS, PYTHON
from tomo.scan.corrections import Corrections
from tomo.scan.films import Frame
from tomo.scan.image_source import find_frame, holds_integers
from tomo.scan.radiometry import Radiometry

if TYPE_CHECKING:
    from rigs import Rig

Images = list[NDArray[np.float32]]
Masks = list[NDArray[np.bool_]]


class ScanImages:
    """The part of `Scan` that reads; nothing that is read is kept. `Scan` says what fields are."""

    rig: Rig
    frames: tuple[Frame, ...]
    corrections: Corrections
    grid: VoxelGrid | None
    truth: Path | NDArray[np.float32] | None
    source: Path | None
    shrink: int
    recorded_sizes: Mapping[str, tuple[int, int]]
    notes: tuple[str, ...]
    radiometry: Radiometry | None
    peak: float | None

    @property
    def frame_names(self) -> tuple[str, ...]:
        """The names of the frames, in order."""
        return tuple(frame.name for frame in self.frames)

    @cached_property
    def _by_name(self) -> dict[str, Frame]:
        """Frames by their names: a film of ten thousand is not searched for each."""
        return {frame.name: frame for frame in self.frames}

    @property
    def where(self) -> str:
        """What messages begin with: the file or folder of the scan, nothing in memory."""
        return "" if self.source is None else f"{self.source}: "

    @property
    def way(self) -> str:
        """How corrections are given to the scan, one of `tomo.scan.advice.WAYS`."""
        if self.source is None:
            return PYTHON
        return FILE if self.source.suffix.lower() in (".yaml", ".yml") else OPTIONS

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
        found = self._by_name.get(name) or find_frame(self.frames, name)
        if found is None:
            known = ", ".join(self.frame_names)
            raise ValueError(f"{self.where}frame: found {name!r}, expected one of {known}")
        return found

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
        """
        images, masks, *_ = self.read_with_faults(frame)
        return images, masks

    def read_with_faults(
        self, frame: str | None = None
    ) -> tuple[
        Images, Masks, dict[str, float], dict[str, DeadLines], dict[str, StoredBits | None]
    ]:
        """Return what `read` does, the fraction of bright pixels at full scale, dead lines, bits.

        All by camera. Pixels are bright at full scale and above half of the brightest other one.
        Dead lines are those of images as recorded, of cameras that have some. Bits: see
        `Corrections.corrected`.
        """
        chosen, names = self.frame(frame), self.rig.names
        found = [self._read_one(chosen, name) for name in names]
        images, masks, *others = map(list, zip(*found, strict=True))
        saturated, dead, bits = (dict(zip(names, each, strict=True)) for each in others)
        lines = {name: each for name, each in dead.items() if each}
        return images, masks, saturated, lines, bits

    def holds_integers(self, frame: str | None = None) -> bool:
        """Tell whether all images of a frame hold integers, which reading scales to 0..1."""
        return all(holds_integers(image) for image in self.frame(frame).images.values())

    def value_unit(self, frame: str | None = None) -> str:
        """Return the unit of a volume from these images: theirs over the unit of length."""
        if self.radiometry is not None:
            return self.radiometry.value_unit
        return f"{self.image_unit(frame)} per {self.rig.length_unit}"

    def image_unit(self, frame: str | None = None) -> str:
        """Return the unit of corrected images: of light, full scales of integers, or their own."""
        if self.radiometry is not None:
            return f"{self.radiometry.value_unit} {self.rig.length_unit}"
        return "full scales" if self.in_full_scales(frame) else "image units"

    def in_full_scales(self, frame: str | None = None) -> bool:
        """Tell whether 1 is the full scale of all images of a frame, once they are corrected."""
        is_scaled = self.corrections.gain is not None or self.radiometry is not None
        return not is_scaled and self.holds_integers(frame)

    @cached_property
    def per_count(self) -> dict[str, float] | None:
        """What a count of each camera is worth, see `Radiometry.per_count`; None without one."""
        if self.radiometry is None:
            return None
        return self.radiometry.per_count(
            self.recorded_sizes, self.corrections, self.rig.length_unit, self.source
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Lines that a user should know: of films, and of cameras without a calibration."""
        known = self.radiometry
        note = None if known is None else known.note(self.rig.names)
        return self.notes if note is None else (*self.notes, note)

    @property
    def sets_scale(self) -> tuple[bool, ...] | None:
        """Which cameras set the scale, those with a known radiance; None where all are alike."""
        known = () if self.radiometry is None else self.radiometry.calibrated(self.rig.names)
        each = tuple(name in known for name in self.rig.names)
        return each if any(each) and not all(each) else None

    def read_truth(self, frame: str | None = None) -> tuple[NDArray[np.float32], VoxelGrid] | None:
        """Return the true volume of a frame and the grid that it lies on; None without one.

        A film of volumes has one a frame, anything else is the same for all frames. A file that
        names another unit of light than the scan's volumes is refused.
        """
        if not isinstance(self.truth, Path):
            return None if self.truth is None else (self.truth, self.grid)
        if self.truth.suffix == SUFFIX:
            film = VolumeFilm(self.truth)
            return film.read(self.frames.index(self.frame(frame))), film.grid
        data, grid, _ = read_volume(self.truth)
        unit = data.value_unit
        if self.radiometry is not None and unit not in ("", self.radiometry.value_unit):
            raise ValueError(
                f"{self.truth}: value_unit: found {unit}, expected {self.radiometry.value_unit}, "
                "the scan's"
            )
        return data, grid

    def _read_one(
        self, frame: Frame, camera: str
    ) -> tuple[NDArray, NDArray, float, DeadLines, StoredBits | None]:
        if camera not in frame.images:
            raise ValueError(
                f"{self.where}frame {frame.name!r}: camera {camera}: found no image, "
                "expected one for every camera of the rig"
            )
        path, size = frame.images[camera], self.recorded_sizes[camera]
        per_count = None if self.per_count is None else self.per_count[camera]
        image, usable, full, dead, bits = self.corrections.corrected(
            path, camera, size, self.source, per_count
        )
        count = np.count_nonzero(full)
        bright = np.count_nonzero(image > 0.5 * image.max(initial=0.0)) if count else 0
        saturated = count / (count + bright) if count else 0.0
        return _means(image, self.shrink), _all(usable, self.shrink), saturated, dead, bits


def blocks_of_pixels(image: NDArray, factor: int) -> NDArray:
    """Return a view ``(rows, factor, columns, factor)`` of the whole blocks of an image."""
    rows, columns = (side // factor for side in image.shape)
    whole = image[: rows * factor, : columns * factor]
    return whole.reshape(rows, factor, columns, factor)


def _means(image: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Return the means of an image over blocks of ``factor`` x ``factor`` pixels."""
    if factor == 1:
        return image
    return blocks_of_pixels(image, factor).mean(axis=(1, 3), dtype=np.float64).astype(np.float32)


def _all(usable: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """Return the blocks of ``factor`` x ``factor`` pixels that are usable throughout."""
    return usable if factor == 1 else np.asarray(blocks_of_pixels(usable, factor).all(axis=(1, 3)))
