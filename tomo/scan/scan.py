"""Scan: the images of calibrated cameras, in memory or in files that are read when asked for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.higher import higher
from tomo.grid import VoxelGrid
from tomo.io import VolumeFilm, read_volume_with_unit
from tomo.io.volume_film import SUFFIX
from tomo.io.xarray_volumes import xarray_or_pip_line
from tomo.measurement import DeadLines
from tomo.scan.arrays import all_of_area, area_means, stacks_of
from tomo.scan.corrections import Corrections, holds_integers, is_of_8_bits
from tomo.scan.films import FilmFrame
from tomo.scan.frames import Frame, find_frame
from tomo.scan.radiometry import Radiometry
from tomo.scan.write import save_scan

if TYPE_CHECKING:
    from os import PathLike

    from xarray import DataArray, Dataset

    from rigs import CameraLike, Rig

Images = list[NDArray[np.float32]]
Masks = list[NDArray[np.bool_]]


@dataclass(frozen=True)
class Scan:
    """A calibrated image set; images are read when asked for, and nothing is kept.

    Parameters
    ----------
    rig : Rig
        The cameras of the images that this scan gives back, shrunk where those are shrunk. Where
        corrections take one colour of mosaics, those of the sensors are given, without
        ``recorded_sizes``, and become those of the colour.
    frames : tuple of Frame
    corrections : Corrections
    grid : VoxelGrid, optional
        Where a volume is worth reconstructing.
    truth : Path or (nx, ny, nz) array, optional
        The volume that the images were simulated from; an array lies on ``grid``. A film of
        volumes, ``.zarr``, has one a frame.
    source : Path, optional
        The file or folder that the scan came from; errors name it.
    shrink : int
        By how much the images are shrunk when read.
    recorded_sizes : mapping, optional
        Camera to ``(width, height)`` of the files; that of the rig as given when None.
    effects : mapping, optional
        The effects that the images were simulated with: the fields of
        `tomo.simulation.effects.Effects`, and ``gains``, camera to gain. Only compared with, as
        the truth is.
    frame_rate : float, optional
        Frames a second.
    notes : tuple of str
        Lines that a user should know of the films.
    radiometry : Radiometry, optional
        What makes radiances of counts; images are then those radiances, in the unit of the volume
        times that of length.
    """

    rig: Rig
    frames: tuple[Frame, ...]
    corrections: Corrections = field(default_factory=Corrections)
    grid: VoxelGrid | None = None
    truth: Path | NDArray[np.float32] | None = None
    source: Path | None = None
    shrink: int = 1
    # None stands for the sizes of the rig, which take its place
    recorded_sizes: Mapping[str, tuple[int, int]] = None  # type: ignore[assignment]
    effects: Mapping[str, Any] | None = None
    frame_rate: float | None = None
    notes: tuple[str, ...] = ()
    radiometry: Radiometry | None = None

    def __post_init__(self) -> None:
        """Check that names belong together; whether files can be read shows when they are."""
        if self.recorded_sizes is None:
            sizes = {camera.name: tuple(camera.image_size) for camera in self.rig}
            object.__setattr__(self, "recorded_sizes", sizes)
            object.__setattr__(self, "rig", self._rig_of_colours())
        if not len(self.rig):
            raise ValueError(f"{self._where}cameras: found none, expected at least one")
        if not self.frames:
            raise ValueError(f"{self._where}frames: found none, expected at least one")
        for name, count in Counter(frame.name for frame in self.frames).items():
            if count > 1:
                raise ValueError(f"{self._where}frame {name!r}: found twice, expected once")

    @classmethod
    def from_arrays(
        cls,
        rig: Rig,
        images: Mapping[str, ArrayLike] | DataArray | Dataset,
        grid: VoxelGrid | None = None,
        *,
        masks: Mapping[str, ArrayLike] | None = None,
        corrections: Corrections | None = None,
        truth: ArrayLike | None = None,
        effects: Mapping[str, Any] | None = None,
        radiometry: Radiometry | None = None,
    ) -> Scan:
        """Return the scan of images in memory; it reads as one of files does, bit for bit.

        Parameters
        ----------
        rig : Rig
        images : mapping, Dataset or DataArray
            Camera name to an image ``(h, w)``, or to several ``(frames, h, w)``: floating point,
            or uint8 or uint16, which are divided by their full scale. Frames are called
            ``frame_000``, ``frame_001`` ... A Dataset has a variable a camera, a DataArray the
            dimension ``camera`` with their names.
        grid : VoxelGrid, optional
        masks : mapping, optional
            Camera name to ``(h, w)``, non-zero where a pixel is usable.
        corrections : Corrections, optional
            Its images may be arrays too.
        truth : (nx, ny, nz) array, optional
            The true volume on ``grid``.
        effects : mapping, optional
            See `Scan`.
        radiometry : Radiometry, optional
            Its images may be arrays too.

        Raises
        ------
        ValueError
            If images or a mask are not of their camera's size, cameras have different numbers of
            frames, masks are given twice, or a truth does not lie on the grid.
        """
        stacks = stacks_of(rig, images, "images")
        corrections = Corrections() if corrections is None else corrections
        if masks is not None:
            if corrections.mask is not None:
                raise ValueError("masks: found masks in corrections too, expected one of the two")
            usable = stacks_of(rig, masks, "masks")
            corrections = replace(corrections, mask={n: mask[0] for n, mask in usable.items()})
        if truth is not None:
            truth = np.asarray(truth, np.float32)
            if grid is None or truth.shape != grid.shape:
                expected = "a grid that it lies on" if grid is None else f"the grid's {grid.shape}"
                raise ValueError(f"truth: found shape {truth.shape}, expected {expected}")
        frames = tuple(
            Frame(f"frame_{number:03d}", {name: stack[number] for name, stack in stacks.items()})
            for number in range(len(next(iter(stacks.values()), ())))
        )
        for name in rig.names:
            if corrections.of("channel", name) and not corrections.of("bayer", name):
                raise ValueError(f"camera {name}: channel: found grey arrays, expected bayer too")
        return cls(rig, frames, corrections, grid, truth, effects=effects, radiometry=radiometry)

    def to_xarray(self, frame: str | None = None) -> DataArray:
        """Return the corrected images of a frame, ``(camera, row, column)``; NaN is not usable.

        Raises
        ------
        ValueError
            As `read` raises, if the cameras' images differ in size, or xarray is not installed.
        """
        sizes = {camera.image_size for camera in self.rig}
        if len(sizes) > 1:
            found = ", ".join(f"{width} x {height}" for width, height in sorted(sizes))
            raise ValueError(
                f"{self._where}images: found sizes {found}, expected one for an array of all: "
                "take some cameras by only(...)"
            )
        images, masks = self.read(frame)
        values = np.where(np.array(masks), np.array(images), np.float32(np.nan))
        coordinates = {"camera": list(self.rig.names)}
        about = {"frame": self.frame(frame).name}
        return xarray_or_pip_line().DataArray(
            values, coordinates, ("camera", "row", "column"), "image", about
        )

    def _repr_html_(self) -> str:
        """Return what a notebook shows: thumbnails of the first frame, and a table."""
        return higher("scan_html")(self)

    def save(self, folder: str | PathLike) -> Path:
        """Write a scan in memory as a scan folder, see `save_scan`; return its scan.yaml.

        Raises
        ------
        ValueError
            If an image or the truth is a file, or images are shrunk.
        """
        is_divided = any(self.corrections.mosaic(name) for name in self.rig.names)
        files = [
            image
            for image in (*(i for f in self.frames for i in f.images.values()), self.truth)
            if isinstance(image, Path | FilmFrame)
        ]
        if files or self.shrink != 1 or is_divided:
            found = f"images shrunk {self.shrink}-fold"
            if files or is_divided:
                found = f"the file {files[0]}" if files else "one colour of a mosaic"
            raise ValueError(f"{folder}: scan: found {found}, expected a scan in memory as it is")
        return save_scan(
            folder,
            self.rig,
            {frame.name: cast("Mapping[str, NDArray]", frame.images) for frame in self.frames},
            grid=self.grid,
            truth=cast("NDArray | None", self.truth),
            corrections=None if self.corrections == Corrections() else self.corrections,
            effects=self.effects,
            radiometry=self.radiometry,
        )

    @property
    def frame_names(self) -> tuple[str, ...]:
        """The names of the frames, in order."""
        return tuple(frame.name for frame in self.frames)

    @cached_property
    def _by_name(self) -> dict[str, Frame]:
        """Frames by their names: a film of ten thousand is not searched for each."""
        return {frame.name: frame for frame in self.frames}

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
        found = self._by_name.get(name) or find_frame(self.frames, name)
        if found is None:
            known = ", ".join(self.frame_names)
            raise ValueError(f"{self._where}frame: found {name!r}, expected one of {known}")
        return found

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

    def of_channel(self, channel: str | None, bayer: str | None = None) -> Scan:
        """Return the scan of one colour of images in colour, or of sensors with colour filters.

        Parameters
        ----------
        channel : {"r", "g", "b"}
            A mosaic without one is refused.
        bayer : {"RGGB", "BGGR", "GRBG", "GBRG"}, optional
            The order of the colours on the sensors, see `rigs.recordings.Mosaic`: cameras and
            images are then those of the colour's pixels alone.

        Raises
        ------
        ValueError
            If a name is unknown, or the scan's corrections name colours already.
        """
        for name in ("channel", "bayer"):
            known = getattr(self.corrections, name)
            if known is not None:
                raise ValueError(
                    f"{self._where}corrections.{name}: found {known}, expected none with --{name}"
                )
        if self.shrink != 1:
            raise ValueError(
                f"{self._where}scale: found {self.shrink}, expected 1 before a colour"
            )
        corrections = replace(self.corrections, channel=channel, bayer=bayer)
        none: Any = None  # the sizes of the rig
        return replace(self, corrections=corrections, recorded_sizes=none)

    def recorded_camera(self, camera: CameraLike) -> CameraLike:
        """Return the camera of images as recorded, from one of this scan's images."""
        mosaic = self.corrections.mosaic(camera.name)
        if self.shrink == 1 and mosaic is None:
            return camera
        camera = camera.scaled(self.shrink)
        whole = camera if mosaic is None else mosaic.sensor(camera)
        return replace(whole, image_size=self.recorded_sizes[camera.name])

    def _rig_of_colours(self) -> Rig:
        """Return the rig, its cameras those of one colour where they record mosaics."""
        try:
            pairs = [(camera, self.corrections.mosaic(camera.name)) for camera in self.rig]
            cameras = tuple(
                camera if mosaic is None else mosaic.camera(camera) for camera, mosaic in pairs
            )
        except ValueError as error:
            raise ValueError(f"{self._where}{error}") from None
        return replace(self.rig, cameras=cameras)

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
        images, masks, *_ = self.read_with_faults(frame)
        return images, masks

    def read_with_faults(
        self, frame: str | None = None
    ) -> tuple[Images, Masks, dict[str, float], dict[str, DeadLines]]:
        """Return what `read` does, the fraction of bright pixels at full scale, and dead lines.

        Both by camera. Pixels are bright at full scale and above half of the brightest other one;
        the fraction is 0 for images of no integers. Dead lines are those of images as recorded,
        before they are shrunk; only cameras that have some are named.
        """
        chosen, names = self.frame(frame), self.rig.names
        found = [self._read_one(chosen, name) for name in names]
        images, masks, saturated, dead = map(list, zip(*found, strict=True))
        lines = {name: each for name, each in zip(names, dead, strict=True) if each}
        return images, masks, dict(zip(names, saturated, strict=True)), lines

    def holds_integers(self, frame: str | None = None) -> bool:
        """Tell whether all images of a frame hold integers, which reading scales to 0..1."""
        return all(holds_integers(image) for image in self.frame(frame).images.values())

    def value_unit(self, frame: str | None = None) -> str:
        """Return the unit of a volume from these images: theirs over the unit of length.

        Integers are divided by their full scale; other images have a unit of their own, and those
        of a scan with `radiometry` one of light.
        """
        if self.radiometry is not None:
            return self.radiometry.value_unit
        unit = "full scales" if self.in_full_scales(frame) else "image units"
        return f"{unit} per {self.rig.length_unit}"

    def in_full_scales(self, frame: str | None = None) -> bool:
        """Tell whether 1 is the full scale of all images of a frame, once they are corrected."""
        is_scaled = self.corrections.gain is not None or self.radiometry is not None
        return not is_scaled and self.holds_integers(frame)

    def in_8_bits(self, frame: str | None = None) -> bool:
        """Tell whether 1 stands for 255, the full scale of all images of a frame.

        Wider numbers say nothing of a camera: 12 bits are often stored in 16.
        """
        images = self.frame(frame).images.values()
        return self.in_full_scales(frame) and all(map(is_of_8_bits, images))

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

        A film of volumes has one a frame, anything else is the same for all frames.

        Raises
        ------
        ValueError
            If a file names another unit of light than volumes of the scan have.
        """
        if not isinstance(self.truth, Path):
            return None if self.truth is None else (self.truth, self.grid)
        if self.truth.suffix == SUFFIX:
            film = VolumeFilm(self.truth)
            return film.read(self.frames.index(self.frame(frame))), film.grid
        data, grid, _, unit = read_volume_with_unit(self.truth)
        if self.radiometry is not None and unit not in ("", self.radiometry.value_unit):
            raise ValueError(
                f"{self.truth}: value_unit: found {unit}, expected {self.radiometry.value_unit}, "
                "the scan's"
            )
        return data, grid

    def _read_one(self, frame: Frame, camera: str) -> tuple[NDArray, NDArray, float, DeadLines]:
        if camera not in frame.images:
            raise ValueError(
                f"{self._where}frame {frame.name!r}: camera {camera}: found no image, "
                "expected one for every camera of the rig"
            )
        path, size = frame.images[camera], self.recorded_sizes[camera]
        per_count = None if self.per_count is None else self.per_count[camera]
        image, usable, full, dead = self.corrections.corrected(
            path, camera, size, self.source, per_count
        )
        count = np.count_nonzero(full)
        bright = np.count_nonzero(image > 0.5 * image.max(initial=0.0)) if count else 0
        saturated = count / (count + bright) if count else 0.0
        return area_means(image, self.shrink), all_of_area(usable, self.shrink), saturated, dead
