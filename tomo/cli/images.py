"""Options of images: which, and what is corrected of them where no scan.yaml says so."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tomo.cli.console import say

if TYPE_CHECKING:
    from tomo import Scan


@dataclass(frozen=True)
class Images:
    """Images and rig, in place of a scan.

    Images
    ------
    rig : FILE
        A rig.yaml, with --images, in place of SCAN.
    images : FOLDER
        Images CAMERA/FRAME.tif or CAMERA_FRAME.tif, or films CAMERA.tif, with --rig; or where
        those of a transforms.json are.
    pattern : PATTERN
        How the files of --images are named, where not as CAMERA/FRAME.tif, CAMERA_FRAME.tif or
        CAMERA.tif: '{frame}/{camera}.png', say.
    """

    rig: Path | None = None
    images: Path | None = None
    pattern: str | None = None

    def scan(self, scan: Path | None) -> Scan:
        """Return the scan that is named, or these images; what a pattern finds is said."""
        from rigs.recordings.layout import cameras_and_frames
        from tomo import load_scan, scan_of_images

        if self.pattern is not None and self.rig is None:
            raise ValueError(
                f"--pattern: found {self.pattern!r}, expected --rig and --images with it"
            )
        if scan is not None and self.rig is None:
            return load_scan(scan, self.images)
        if scan is None and self.rig is not None and self.images is not None:
            found = scan_of_images(self.rig, self.images, self.pattern)
            if self.pattern is not None:
                names = found.rig.names
                each = {n: [f.name for f in found.frames if n in f.images] for n in names}
                say(cameras_and_frames(each))
            return found
        raise ValueError("SCAN: expected either a scan, or --rig and --images together")


@dataclass(frozen=True)
class Corrections:
    """What is corrected of images.

    Corrections, each for all cameras or CAMERA=VALUE,CAMERA=VALUE
    --------------------------------------------------------------
    dark : FOLDER|FILE|LEVEL
        Dark frames: a folder of CAMERA.tif, or several images a camera, whose mean is taken; a
        file, {camera} for the camera's name; or a level in full scales, like 0.0244 or 100/4095.
    flat : FOLDER|FILE|LEVEL
        Images of even light, dark taken off, that images are divided by; as --dark.
    gain : FACTOR
        Images times this: 1.02 for a camera that records 2 % too little.
    mask : FOLDER|FILE
        Images that are zero where the pixel is unusable; as --dark.
    saturation : LEVEL
        Pixels at or above it are left out; in full scales, of images as recorded.
    bit_depth : BITS
        Bits that the camera uses of integer images where files do not say: 12 of 16, say.
    bayer : ORDER
        Images are mosaics of colour filters in this order, like RGGB: the pixels of --channel are
        used, with rays of their own.
    channel : r|g|b|N
        The colour to reconstruct of images in colour, or the channel of images and films with
        several, from 0.
    """

    dark: str | None = None
    flat: str | None = None
    gain: str | None = None
    mask: str | None = None
    saturation: str | None = None
    bit_depth: str | None = None
    bayer: str | None = None
    channel: str | None = None

    def of(self, scan: Scan) -> Scan:
        """Return the scan with these corrections; others stay as they are."""
        options = asdict(self).items()
        given = {name: value_of(name, text) for name, text in options if text is not None}
        colours = {name: given.pop(name) for name in ("channel", "bayer") if name in given}
        if given:
            scan = scan.with_corrections(**given)
        return scan.of_channel(colours.get("channel"), colours.get("bayer")) if colours else scan


def value_of(name: str, text: str) -> Any:
    """Return a correction's value as a scan.yaml has it: ``a=1,b=2`` is one for each camera."""
    pairs = [one.partition("=") for one in text.split(",")]
    if Path(text).exists() or not all(mark for _, mark, _ in pairs):
        return _plain(name, text)
    return {camera.strip(): _plain(name, value.strip()) for camera, _, value in pairs}


def _plain(name: str, text: str) -> Any:
    """Return a number, a path that exists, or the name of a colour."""
    if name == "bayer":
        return text.upper()
    if name == "channel":
        return text.lower()
    of_full = re.fullmatch(r"(\d+(?:\.\d+)?)/(\d+)", text, re.ASCII)
    if of_full and int(of_full[2]) and not Path(text).exists():
        return float(of_full[1]) / int(of_full[2])
    try:
        return int(text) if re.fullmatch(r"\d{1,9}", text, re.ASCII) else float(text)
    except ValueError:
        pass
    if name in ("dark", "flat", "mask") and "{camera}" not in text and not Path(text).exists():
        raise FileNotFoundError(
            f"--{name}: found {text!r}, expected a folder or file that is there"
            + ("" if name == "mask" else ", or a number")
        )
    return text
