"""The images of one frame as a plan takes them: corrected, its bad pixels left out."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal, overload

import numpy as np
from numpy.typing import NDArray

from tomo.measurement import NoiseModel
from tomo.model import Observation
from tomo.pipeline.load import LoadedScan, load
from tomo.pipeline.options import Options
from tomo.pipeline.screen import ScreenedScan
from tomo.scan import Scan
from tomo.scan.images import Images, Masks
from tomo.series.frames import key_places


@dataclass(frozen=True, eq=False)
class FrameImages:
    """The images of one frame.

    Attributes
    ----------
    name : str
        The frame's.
    images, masks : list of (height, width)
        Those of the cameras to reconstruct from; 0 where not usable.
    apart_images, apart_masks : list of (height, width)
        Those of the cameras that take no part.
    warnings : tuple of str
        What reading it found, such as many pixels at full scale.
    """

    name: str
    images: Images
    masks: Masks
    apart_images: Images
    apart_masks: Masks
    warnings: tuple[str, ...] = ()


def mean_of_frames(scan: Scan, loaded: list[LoadedScan]) -> LoadedScan:
    """Return the mean of frames as a frame of its own, its pixels usable in all of them.

    A projection is linear: the mean of the images is the image of the mean emission. Noise is
    lower in it, and what is wrong with pixels, cameras and gains in every frame stays.
    """
    masks = usable_in_all([one.masks for one in loaded])
    images = [
        np.where(mask, np.mean(each, axis=0, dtype=np.float64), 0).astype(np.float32)
        for mask, each in zip(
            masks, zip(*(one.images for one in loaded), strict=True), strict=True
        )
    ]
    return LoadedScan(scan, loaded[0].frame, images, masks)


def images_of(loaded: LoadedScan, screened: ScreenedScan) -> FrameImages:
    """Return a frame's images as the screening of other frames settled them.

    Pixels that it found bad are left out, cameras that it excluded take no part, and images that
    it corrected are corrected alike.
    """
    rig, images, masks = loaded.scan.rig, tuple(loaded.images), tuple(loaded.masks)
    if screened.pixels is not None:
        known = zip(masks, screened.pixels.masks, strict=True)
        masks = tuple(mask & usable for mask, usable in known)
    if screened.corrections is not None:
        noise = (NoiseModel(0.0),) * len(rig)
        frame = Observation(rig, images, masks, noise, screened.corrections.grid)
        found = screened.corrections.applied(frame, move=False)
        images, masks = found.images, found.masks
    both = zip(images, masks, strict=True)
    everything = dict(zip(rig.names, both, strict=True))

    def part(of: Scan | None) -> tuple[Images, Masks]:
        pairs = [everything[name] for name in of.rig.names] if of else []
        return [np.where(mask, image, np.float32(0)) for image, mask in pairs], [
            m for _, m in pairs
        ]

    used, apart = part(screened.scan), part(screened.apart)
    said = tuple(line for line in loaded.record.warnings if line not in loaded.scan.notes)
    return FrameImages(loaded.frame, *used, *apart, said)


class UnreadableError(ValueError):
    """A frame that cannot be read or decoded.

    Attributes
    ----------
    frame : str
        Its name.
    reason : str
        One line that names the file.
    """

    def __init__(self, frame: str, error: Exception) -> None:
        self.frame, self.reason = frame, " ".join(str(error).split())
        super().__init__(
            f"frame {frame}: {self.reason}; --skip-bad leaves out frames that cannot be read"
        )


@contextmanager
def naming(frame: str) -> Iterator[None]:
    """Turn what goes wrong in reading a frame's images into an `UnreadableError`."""
    try:
        yield
    except (ValueError, OSError) as error:
        raise UnreadableError(frame, error) from error


@overload
def read_frame(scan: Scan, place: int, skip_bad: Literal[False]) -> LoadedScan: ...
@overload
def read_frame(scan: Scan, place: int, skip_bad: bool) -> LoadedScan | None: ...
def read_frame(scan: Scan, place: int, skip_bad: bool) -> LoadedScan | None:
    """Return a frame by its place in the scan; None where it cannot be read and may be left out.

    Raises
    ------
    UnreadableError
        If it cannot be read or decoded.
    """
    frame = scan.frames[place].name
    try:
        with naming(frame):
            return load(scan, frame)
    except UnreadableError:
        if skip_bad:
            return None
        raise


def reader_of(
    scan: Scan, screened: ScreenedScan, skip_bad: bool = False
) -> Callable[[int], FrameImages | None]:
    """Return what reads a frame by its place in the scan; None for one that is left out."""

    def read(place: int) -> FrameImages | None:
        loaded = read_frame(scan, place, skip_bad)
        return None if loaded is None else images_of(loaded, screened)

    return read


def readable_keys(scan: Scan, places: Sequence[int], options: Options) -> tuple[int, ...]:
    """Return the places of the key frames, see `readable`."""
    return readable(scan, key_places(places, options), places, options.skip_bad)


def readable(
    scan: Scan, wanted: Sequence[int], places: Sequence[int], skip_bad: bool
) -> tuple[int, ...]:
    """Return some of the frames; each bad one gives way to the next that is readable.

    Parameters
    ----------
    scan : Scan
    wanted : sequence of int
        Those frames, by their places in the scan, ascending.
    places : sequence of int
        All frames.
    skip_bad : bool
        Whether frames may be left out; all are returned otherwise.

    Raises
    ------
    ValueError
        If no frame can be read.
    """
    if not skip_bad:
        return tuple(wanted)
    found: list[int] = []
    for key, end in zip(wanted, (*wanted[1:], places[-1] + 1), strict=True):
        stretch = [place for place in places if key <= place < end]
        good = (place for place in stretch if read_frame(scan, place, True) is not None)
        found += itertools.islice(good, 1)
    if not found:
        read_frame(scan, wanted[0], False)  # raises, with the reason
        raise ValueError(f"{scan.source}: frames: found none that can be read, expected one")
    return tuple(found)


def usable_in_all(masks: list[Masks]) -> list[NDArray[np.bool_]]:
    """Return the pixels that are usable in every frame, one image a camera."""
    return [np.logical_and.reduce(each) for each in zip(*masks, strict=True)]
