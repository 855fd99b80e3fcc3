"""Films of Photron cameras: an .mraw file of pixels, described by a .cihx or .cih beside it."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import errors_of_libraries
from rigs.files.text import AT_ONCE, shortened
from rigs.files.xml_file import parse_xml
from rigs.recordings.film_formats.raw_film import bytes_of, pixels_of, read_part
from rigs.recordings.recording import Reopened

_STORED = {8: "uint8", 10: "uint10", 12: "uint12", 16: "uint16"}
_FIELDS = {
    "width": ("Image Width", "imageDataInfo/resolution/width"),
    "height": ("Image Height", "imageDataInfo/resolution/height"),
    "frames": ("Total Frame", "frameInfo/totalFrame"),
    "first": ("Start Frame", "frameInfo/startFrame"),
    "step": ("Save Step", "frameInfo/skipFrame"),
    "rate": ("Record Rate(fps)", "recordInfo/recordRate"),
    "bits": ("Color Bit", "imageDataInfo/colorInfo/bit"),
    "colours": ("Color Type", "imageDataInfo/colorInfo/type"),
    "depth": ("EffectiveBit Depth", "imageDataInfo/effectiveBit/depth"),
    "side": ("EffectiveBit Side", "imageDataInfo/effectiveBit/side"),
    "format": ("File Format", "imageFileInfo/fileFormat"),
}
"""What is read of a header: its name in a .cih, and its path in a .cihx."""


class Mraw(Reopened):
    """The frames of a Photron film, monochrome, of 8, 10, 12 or 16 bits; see `Recording`.

    Pixels of 16 bits are stored with the low byte first. Those of 12 bits at the high side of 16
    are returned as the 12 bits that were recorded. Frame ``i`` was recorded as number
    ``Start Frame + i Save Step`` after the trigger: its time is that over the record rate.
    """

    def __init__(self, path: str | os.PathLike) -> None:
        self._given = Path(path)
        header = described_by(self._given)
        self.path = self._given.with_suffix(".mraw")
        if self._given.suffix.lower() == ".mraw":
            self.path = self._given
        with errors_of_libraries(f"{header}: not a readable description of a Photron film"):
            found = _fields_of(header)
            self._use(found)
        if not self.path.is_file():
            raise ValueError(f"{header}: found no {self.path.name} beside it, expected its pixels")
        held = self.path.stat().st_size
        needed = self.n_frames * self._frame_bytes
        if held < needed:
            raise ValueError(
                f"{self.path}: found {held} bytes, expected {needed} for the {self.n_frames} "
                f"frames that {header.name} states: truncated"
            )

    def _opened_by(self) -> tuple:
        return (self._given,)

    def _use(self, found: dict[str, str]) -> None:
        width, height, self.n_frames, bits, depth = (
            _whole(found, name) for name in ("width", "height", "frames", "bits", "depth")
        )
        if found.get("format", "mraw").lower() != "mraw":
            raise ValueError(f"found file format {shortened(found['format'])}, expected MRaw")
        if found.get("colours", "mono").lower() not in ("mono", "monochrome", "raw"):
            raise ValueError(f"found colours {shortened(found['colours'])}, expected Mono")
        if bits not in _STORED or min(width, height, self.n_frames) < 1 or not 1 <= depth <= 16:
            raise ValueError(
                f"found {self.n_frames} frames of {width} x {height} pixels of {bits} bits, "
                f"{depth} of them recorded, expected some of 8, 10, 12 or 16 bits"
            )
        self._type = _STORED[bits]
        self._frame_bytes = bytes_of(self._type, width * height)
        self.image_size = (width, height)
        self.bit_depth = min(bits, depth)
        side = found.get("side", "lower").lower()
        if side not in ("lower", "higher"):
            raise ValueError(f"found bits at the {shortened(side)} side, expected lower or higher")
        self._shift = bits - self.bit_depth if side == "higher" else 0
        rate = float(found["rate"]) if "rate" in found else 0.0
        step = _whole(found, "step") if "step" in found else 1
        self.frame_rate, self.timestamps = None, None
        if math.isfinite(rate) and 0 < rate < 1e12 and step > 0:
            self.frame_rate = rate / step
            if "first" in found:
                numbers = _whole(found, "first") + step * np.arange(self.n_frames)
                self.timestamps = numbers / rate

    def _frame(self, index: int) -> NDArray:
        data = read_part(self.path, index * self._frame_bytes, self._frame_bytes)
        image = pixels_of(data, self.image_size, self._type)
        return image >> image.dtype.type(self._shift) if self._shift else image


def described_by(path: Path) -> Path:
    """Return the file that describes a Photron film: itself, or the one beside the pixels."""
    if path.suffix.lower() != ".mraw":
        return path
    beside = [path.with_suffix(suffix) for suffix in (".cihx", ".cih")]
    for one in beside:
        if one.is_file():
            return one
    raise ValueError(
        f"{path}: found no {beside[0].name} or {beside[1].name} beside it, expected the file that "
        "describes its pixels"
    )


def _fields_of(header: Path) -> dict[str, str]:
    """Return the fields of a header that there are, as text."""
    with open(header, "rb") as file:
        content = file.read(AT_ONCE + 1)
    if len(content) > AT_ONCE:
        raise ValueError(f"found more than {AT_ONCE} bytes, expected a description")
    text = content.decode("utf-8", "replace")  # comments may be in any encoding
    if header.suffix.lower() == ".cihx":
        start, end = text.find("<cih>"), text.rfind("</cih>")
        if start < 0 or end < start:
            raise ValueError("found no element <cih>, expected one")
        root = parse_xml(text[start : end + len("</cih>")], header)
        said = {name: root.findtext(path) for name, (_, path) in _FIELDS.items()}
        return {name: value.strip() for name, value in said.items() if value}
    pairs = re.findall(r"^([^:\r\n]{1,64}?) : ([^\r\n]{0,256})", text, re.MULTILINE)
    first = dict(reversed(pairs))  # programs that save a film again append their own sections
    return {name: first[key].strip() for name, (key, _) in _FIELDS.items() if first.get(key)}


def _whole(found: dict[str, str], name: str) -> int:
    text = found.get(name)
    if text is None:
        raise ValueError(f"found no {' or '.join(_FIELDS[name])}, expected a number")
    if not re.fullmatch(r"-?\d{1,9}", text):
        raise ValueError(f"{_FIELDS[name][0]}: found {shortened(text)}, expected a whole number")
    return int(text)
