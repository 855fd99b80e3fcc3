"""Scan: the images of calibrated cameras, in memory or in files that are read when asked for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.higher import higher
from tomo.grid import VoxelGrid
from tomo.scan.arrays import as_data_array, corrections_with, frames_of, truth_on
from tomo.scan.corrections import Corrections, recorded
from tomo.scan.films import FilmFrame, Frame
from tomo.scan.images import ScanImages
from tomo.scan.radiometry import Radiometry
from tomo.scan.write import check_cameras, save_scan

if TYPE_CHECKING:
    from os import PathLike

    from xarray import DataArray, Dataset

    from rigs import CameraLike, Rig


@dataclass(frozen=True)
class Scan(ScanImages):
    """A calibrated image set; images are read when asked for, and nothing is kept.

    Parameters
    ----------
    rig : Rig
        The cameras of the images that this scan gives back, shrunk where those are shrunk. Where
        corrections take one colour of mosaics, those of the sensors are given, without
        ``recorded_sizes``, and become those of the colour.
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
    peak : float, optional
        The largest value of corrected images for PSNR and SSIM; their brightest pixel when None.
    origin : mapping
        What loads the scan again beside ``source``: see `tomo.scan.files.scan_again`.
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
    peak: float | None = None
    origin: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that names belong together; whether files can be read shows when they are."""
        if self.recorded_sizes is None:
            sizes = {camera.name: tuple(camera.image_size) for camera in self.rig}
            object.__setattr__(self, "recorded_sizes", sizes)
            try:
                corrections, rig = self.corrections.settled(self.rig)
            except ValueError as error:
                raise ValueError(f"{self.where}{error}") from None
            object.__setattr__(self, "corrections", corrections)
            object.__setattr__(self, "rig", rig)
        if not len(self.rig):
            raise ValueError(f"{self.where}cameras: found none, expected at least one")
        if not self.frames:
            raise ValueError(f"{self.where}frames: found none, expected at least one")
        for name, count in Counter(frame.name for frame in self.frames).items():
            if count > 1:
                raise ValueError(f"{self.where}frame {name!r}: found twice, expected once")

    def __repr__(self) -> str:
        """Return up to three lines: frames, cameras, and where they are."""
        moments = self.frame_names
        shown = ", ".join(moments if len(moments) < 4 else (*moments[:2], "...", moments[-1]))
        lines = [
            f"<Scan: {len(moments)} frame{'s' * (len(moments) != 1)} ({shown}) of {self.rig!r}"
        ]
        if self.grid is not None:
            lines.append(repr(self.grid))
        lines.append("in memory" if self.source is None else f"from {self.source}")
        return "\n  ".join(lines) + ">"

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
        images : mapping, Dataset or DataArray
            Camera name to an image ``(h, w)``, or to several ``(frames, h, w)``: floating point,
            or uint8 or uint16, which are divided by their full scale. Frames are called
            ``frame_000``, ``frame_001`` ... A Dataset has a variable a camera, a DataArray the
            dimension ``camera`` with their names.
        masks : mapping, optional
            Camera name to ``(h, w)``, non-zero where a pixel is usable.
        corrections, radiometry : optional
            Their images may be arrays too.
        truth : (nx, ny, nz) array, optional
            The true volume on ``grid``.

        Raises
        ------
        ValueError
            If shapes do not fit cameras or grid, or cameras differ in their frames.
        """
        frames = frames_of(rig, images)
        corrections = corrections_with(masks, corrections or Corrections(), rig)
        true = None if truth is None else truth_on(grid, truth)
        return cls(rig, frames, corrections, grid, true, effects=effects, radiometry=radiometry)

    def to_xarray(self, frame: str | None = None) -> DataArray:
        """Return the corrected images of a frame, ``(camera, row, column)``; NaN is not usable.

        Raises ValueError if the cameras' images differ in size, or xarray is not installed.
        """
        return as_data_array(self.where, self.rig, self.frame(frame).name, *self.read(frame))

    def _repr_html_(self) -> str:
        """Return what a notebook shows: thumbnails of the first frame, and a table."""
        return higher("scan_html")(self)

    def save(self, folder: str | PathLike) -> Path:
        """Write a scan in memory, nothing of it shrunk, as a scan folder, see `save_scan`."""
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
            peak=self.peak,
            frame_rate=self.frame_rate,
        )

    def without(self, *cameras: str) -> Scan:
        """Return the scan without some cameras, in the rig's order: hold-outs."""
        return self._part(cameras, are_kept=False)

    def only(self, *cameras: str) -> Scan:
        """Return the scan of these cameras alone, in the rig's order."""
        return self._part(cameras, are_kept=True)

    def _part(self, named: Collection[str], *, are_kept: bool) -> Scan:
        """Return the scan of the cameras named, or of the others; all have to be there."""
        for name in named:
            if name not in self.rig.names:
                known = ", ".join(self.rig.names)
                raise ValueError(f"{self.where}camera: found {name!r}, expected one of {known}")
        cameras = tuple(camera for camera in self.rig if (camera.name in named) == are_kept)
        return replace(self, rig=replace(self.rig, cameras=cameras))

    def scaled(self, factor: int) -> Scan:
        """Return the scan with images shrunk ``factor``-fold by area means, and their cameras.

        Sides that ``factor`` does not divide lose their last ``side % factor`` rows or columns, at
        the bottom and on the right; the camera is cropped alike before it is scaled. A shrunk
        pixel is usable only when all of its pixels are.
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
                    f"{self.where}camera {camera.name}: scale: found {factor}, expected at most "
                    f"{min(camera.image_size)}, the image's shorter side"
                )
            cameras.append(camera.shrunk(factor))
        rig = replace(self.rig, cameras=tuple(cameras))
        return replace(self, rig=rig, shrink=self.shrink * factor)

    def with_corrections(self, **given: Any) -> Scan:
        """Return the scan, not shrunk yet, with some corrections in place of its own.

        Parameters
        ----------
        **given
            Fields of `Corrections`, as a scan.yaml has them; paths are relative to the present
            folder.

        Examples
        --------
        ``scan.with_corrections(dark="dark", bit_depth=12)`` takes the images in the folder
        ``dark`` for those without light, and 4095 for full scale.
        """
        from tomo.scan._schema import checked_corrections  # loads pydantic

        try:
            found = checked_corrections(given)
        except ValueError as error:
            raise ValueError(f"{self.where}corrections.{error}") from None
        for name in given:
            if isinstance(found[name], Mapping):
                check_cameras(f"{self.where}corrections.{name}", "", found[name], self.rig)
        if self.shrink != 1:
            raise ValueError(
                f"{self.where}scale: found {self.shrink}, expected 1 before corrections"
            )
        none: Any = None  # the sizes of the rig, which is that of whole images
        rig = replace(self.rig, cameras=tuple(map(self.recorded_camera, self.rig)))
        found = {name: found[name] for name in given}
        known = (self.origin.get("corrections") or {}) | recorded(found)
        return replace(
            self,
            rig=rig,
            corrections=replace(self.corrections, **found),
            recorded_sizes=none,
            origin={**self.origin, "corrections": known},
        )

    def of_channel(self, channel: str | None, bayer: str | None = None) -> Scan:
        """Return the scan of one colour of images in colour, or of sensors with colour filters.

        Parameters
        ----------
        channel : {"r", "g", "b"}, or "0", "1" ... of films with several channels
            A mosaic without one is refused.
        bayer : {"RGGB", "BGGR", "GRBG", "GBRG"}, optional
            The order of the colours on the sensors, see `rigs.recordings.Mosaic`: cameras and
            images are then those of the colour's pixels alone.
        """
        for name in ("channel", "bayer"):
            known = getattr(self.corrections, name)
            if known is not None:
                raise ValueError(
                    f"{self.where}corrections.{name}: found {known}, expected none beside {name}"
                )
        return self.with_corrections(channel=channel, bayer=bayer)

    def recorded_camera(self, camera: CameraLike) -> CameraLike:
        """Return the camera of images as recorded, from one of this scan's images."""
        mosaic = self.corrections.mosaic(camera.name)
        if self.shrink == 1 and mosaic is None:
            return camera
        camera = camera.scaled(self.shrink)
        whole = camera if mosaic is None else mosaic.sensor(camera)
        return replace(whole, image_size=self.recorded_sizes[camera.name])
