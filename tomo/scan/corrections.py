"""How the files of a camera become intensities: dark frames, flat fields, gains and masks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from rigs.recordings.mosaic import COLOURS, Mosaic, is_channel
from rigs.recordings.still import CHANNELS
from tomo.measurement import DeadLines, find_dead_lines
from tomo.measurement.stored_bits import FULL, StoredBits, stored_bits
from tomo.scan.image_source import (
    ImageSource,
    MeanImage,
    holds_integers,
    images_by_camera,
    read_intensities,
)

_OF_IMAGES = ("dark", "flat", "mask")
"""Corrections that may be images."""


@dataclass(frozen=True)
class Corrections:
    """How raw pixels become intensities: ``(raw - dark) / flat * gain``.

    Images of corrections are files, or arrays ``(height, width)`` where a scan is in memory. In
    a path ``{camera}`` stands for each camera's name. A folder stands for each camera's images in
    it, or all where it is one camera's: their mean is taken.

    Each is one value for all cameras, or a mapping from camera to value; a camera that the
    mapping leaves out is not corrected. All are in the scale of the image as read, in which
    integers are divided by their full scale.

    Attributes
    ----------
    dark : float or Path, or a mapping to these
        The camera's reading without light; a number or an image.
    flat : float or Path, or a mapping to these
        Its response to equal light, dark already taken off; 1 is nominal. Pixels where it is not
        positive are unusable.
    gain : float, or a mapping to float
        The factor on the image: 1.02 for a camera that records 2 % too little. It is the
        inverse of a camera's gain in ``report.json``, which is what the camera records too much.
    mask : Path, or a mapping to Path
        An image that is non-zero where the pixel is usable.
    saturation : float, or a mapping to float
        Raw pixels at or above it are unusable; 1, an integer image's full scale, where none is
        given for images of integers.
    bit_depth : int, or a mapping to int
        Bits that the camera really uses of an integer image: 12 of 16, say.
    bayer : str, or a mapping to str
        The order of the colours on a sensor with colour filters, see `rigs.recordings.Mosaic`:
        the pixels of ``channel`` become an image with rays of its own.
    channel : str, or a mapping to str
        ``r``, ``g`` or ``b``: the colour of an image in colour or of a mosaic, which has ``g2``
        too. ``"0"``, ``"1"`` ...: the channel of a film that has several.
    """

    dark: float | Path | NDArray | Mapping[str, float | Path | NDArray] | None = None
    flat: float | Path | NDArray | Mapping[str, float | Path | NDArray] | None = None
    gain: float | Mapping[str, float] | None = None
    mask: Path | NDArray | Mapping[str, Path | NDArray] | None = None
    saturation: float | Mapping[str, float] | None = None
    bit_depth: int | Mapping[str, int] | None = None
    bayer: str | Mapping[str, str] | None = None
    channel: str | Mapping[str, str] | None = None

    def __post_init__(self) -> None:
        """Take text for the path of an image, but not for the name of colours."""
        for name in _OF_IMAGES:
            value = getattr(self, name)
            if isinstance(value, Mapping):
                object.__setattr__(self, name, {c: _as_path(one) for c, one in value.items()})
            else:
                object.__setattr__(self, name, _as_path(value))

    def of(self, correction: str, camera: str) -> Any:
        """Return the value of one correction for one camera; None where there is none."""
        return for_camera(getattr(self, correction), camera)

    def by_camera(self, cameras: Sequence[str]) -> Corrections:
        """Return the corrections with the images that folders and ``{camera}`` stand for."""
        images = {name: getattr(self, name) for name in _OF_IMAGES}
        return replace(
            self, **{name: images_by_camera(name, one, cameras) for name, one in images.items()}
        )

    def settled(self, rig: Rig) -> tuple[Corrections, Rig]:
        """Return the corrections with each camera's own images, and the cameras of one colour."""
        found = self.by_camera(rig.names)
        pairs = [(camera, found.mosaic(camera.name)) for camera in rig]
        cameras = tuple(one if mosaic is None else mosaic.camera(one) for one, mosaic in pairs)
        return found, replace(rig, cameras=cameras)

    @property
    def colours(self) -> dict[str, str | Mapping[str, str]]:
        """``bayer`` and ``channel``, where they are given."""
        given = {"bayer": self.bayer, "channel": self.channel}
        return {name: value for name, value in given.items() if value is not None}

    def mosaic(self, camera: str) -> Mosaic | None:
        """Return which pixels of a camera's sensor are used; None where all are."""
        bayer, channel = self.of("bayer", camera), self.of("channel", camera)
        if bayer is None:
            if channel is not None and (channel == "g2" or not is_channel(channel)):
                expected = f"one of {', '.join(CHANNELS)}, or a film's channel, counted from 0"
                raise ValueError(
                    f"camera {camera}: channel: found {channel!r}, expected {expected}"
                )
            return None
        try:
            mosaic = Mosaic(bayer, COLOURS[0] if channel is None else channel)
        except ValueError as error:
            raise ValueError(f"camera {camera}: {error}") from None
        if channel is None:
            raise ValueError(
                f"camera {camera}: channel: found none, expected one of {', '.join(COLOURS)} with "
                f"bayer {bayer}: channel='g', or corrections: {{channel: g}} in scan.yaml"
            )
        return mosaic

    def corrected(
        self,
        image: ImageSource,
        camera: str,
        size: tuple[int, int],
        source: Path | None = None,
        per_count: float | None = None,
    ) -> tuple[
        NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_], DeadLines, StoredBits | None
    ]:
        """Read a camera's image, unless it is in memory, and correct it.

        ``size`` is ``(width, height)``. Errors about corrections name ``source``. A count is worth
        ``per_count``, where given, in place of a fraction of full scale.

        Returns
        -------
        image : (height, width) float32
            Zero where it is not usable; a mosaic's is that of the colour alone.
        usable : (height, width) bool
        full : (height, width) bool
            True where an integer pixel is at full scale: its light is not known.
        dead_lines : DeadLines
        bits : StoredBits or None
            None of images that are not of 16 bits, and where the corrections say them.
        """
        self._check_scale(image, camera, source)
        mask = self._value("mask", camera, size)
        usable = np.ones(size[::-1], bool) if mask is None else mask != 0
        bits = self.of("bit_depth", camera)
        colours = {name: self.of(name, camera) for name in ("channel", "bayer")}
        raw, full_scale = read_intensities(image, camera, size, bits, colours, usable)
        mosaic = self.mosaic(camera)
        if mosaic is not None:
            raw, usable = mosaic.pixels(raw), mosaic.pixels(usable)
        dark, flat, gain = (self.pixels(name, camera, size) for name in ("dark", "flat", "gain"))
        full = _plateau(raw >= 1) if holds_integers(image) else np.zeros(raw.shape, bool)
        usable = usable & ~full
        dead_lines = find_dead_lines(raw, usable)
        if dead_lines:
            usable &= ~dead_lines.pixels(usable.shape)
        saturation = self.of("saturation", camera)
        is_known = full_scale != FULL or bits is not None or saturation is not None
        stored = None if is_known else stored_bits(np.rint(raw * np.float32(FULL)))
        if saturation is not None:
            usable = usable & (raw < saturation)
        values = raw if dark is None else raw - dark
        if flat is not None:
            lit = np.broadcast_to(flat, values.shape) > 0
            values = values / np.where(lit, flat, 1)
            usable = usable & lit
        if gain is not None:
            values = values * gain
        if per_count is not None:
            values = values * np.float64(full_scale * per_count)
        return np.where(usable, values, 0).astype(np.float32), usable, full, dead_lines, stored

    def _check_scale(self, image: ImageSource, camera: str, source: Path | None) -> None:
        """Refuse corrections in a camera's counts: they would never, or always, be reached."""
        for name in ("dark", "saturation"):
            value = self.of(name, camera)
            if isinstance(value, Real) and float(value) > 1 and holds_integers(image):
                where = "" if source is None else f"{source}: "
                place = "the images in memory" if isinstance(image, np.ndarray) else image
                raise ValueError(
                    f"{where}corrections.{name}: camera {camera}: found {value:g}, expected "
                    f"at most 1, the full scale of integers like those in {place}; "
                    f"{counts_in_words(float(value), self.of('bit_depth', camera))}"
                )

    def pixels(
        self, name: str, camera: str, size: tuple[int, int]
    ) -> NDArray[np.float32] | np.float32 | None:
        """Return a correction as a number, or as an image of the pixels in use; None without."""
        value, mosaic = self._value(name, camera, size), self.mosaic(camera)
        if mosaic is None or not isinstance(value, np.ndarray) or not value.ndim:
            return value
        return mosaic.pixels(value)

    def _value(
        self, name: str, camera: str, size: tuple[int, int]
    ) -> NDArray[np.float32] | np.float32 | None:
        """Return a correction as a number or an image ``(height, width)``; None without one."""
        value = self.of(name, camera)
        if not isinstance(value, (Path, np.ndarray, MeanImage)):
            return None if value is None else np.float32(value)
        # a mask's numbers are no intensities: they have a depth of their own
        bits = None if name == "mask" else self.of("bit_depth", camera)
        colours = {name: self.of(name, camera) for name in ("channel", "bayer")}
        if isinstance(value, MeanImage):
            return value.read(camera, size, bits, colours)
        return read_intensities(value, camera, size, bits, colours, is_correction=True)[0]


def counts_in_words(counts: float, bits: int | None) -> str:
    """Return what to write for a number of counts, by the bits of the camera or the usual ones."""
    depths = [bits] if bits else [one for one in (8, 12, 16) if counts < 2**one]
    each = [f"{counts:g} counts of {one} bits are {counts / (2**one - 1):.3g}" for one in depths]
    return " and ".join(each) or "it is beyond 16 bits"


def recorded(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return corrections as JSON holds them, paths from the root; arrays are left out."""

    def plain(name: str, value: Any) -> Any:
        if isinstance(value, Mapping):
            return {camera: plain(name, one) for camera, one in value.items()}
        is_path = name in _OF_IMAGES and isinstance(value, str | Path)
        return str(Path(value).absolute()) if is_path else value

    each = {name: plain(name, value) for name, value in given.items()}
    return {name: value for name, value in each.items() if not _has_arrays(value)}


def _has_arrays(value: Any) -> bool:
    each = value.values() if isinstance(value, Mapping) else (value,)
    return any(isinstance(one, np.ndarray) for one in each)


def _as_path(value: Any) -> Any:
    """Return a path where text names one."""
    return Path(value) if isinstance(value, str) else value


def for_camera(value: Any, camera: str) -> Any:
    """Return one camera's of a value that is one for all, or a mapping from cameras."""
    return value.get(camera) if isinstance(value, Mapping) else value


def _plateau(full: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the pixels with a neighbour at full scale too: lenses spread light over several."""
    beside = np.zeros_like(full)
    beside[1:] |= full[:-1]
    beside[:-1] |= full[1:]
    beside[:, 1:] |= full[:, :-1]
    beside[:, :-1] |= full[:, 1:]
    return full & beside
