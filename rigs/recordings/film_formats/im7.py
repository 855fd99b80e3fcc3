"""Images of LaVision's DaVis, .im7 files: one file of frames, or a folder of such files.

DaVis' packing of images as differences from pixel to pixel, compiled: a byte or nibble each.
"""

from __future__ import annotations

import os
import re
import struct
import threading
import zlib
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.compiled import compiled
from rigs.files.size_guard import check_claim, decompressed, errors_of_libraries
from rigs.files.text import END
from rigs.recordings.film_formats.raw_film import pixels_of, read_part
from rigs.recordings.layout import natural
from rigs.recordings.recording import Reopened

_HEADER = struct.Struct("<4h4i3h226x")  # 256 bytes
_FORMATS = {-2: "uint8", -3: "float32", -4: "uint16", -5: "float64", 0: "uint16"}
_PLAIN, _DIFFERENCES, _ZLIB, _PACKED_12 = range(4)  # ways of packing
_TIME = re.compile(rb"AcqTimeSeries(\d{1,3})=(-?\d{1,15}(?:\.\d{1,9})?) \xb5s")


class Im7(Reopened):
    """The frames of DaVis' .im7 files; see `Recording`.

    A file holds the frames of one moment, of all cameras: frames are numbered through the first
    file, then the second, in the order of the numbers in their names. With four frames a file,
    ``first: 1`` and ``step: 4`` are those of the second camera of single exposures. The layout is
    that of LaVision's ``ReadIM7.h``: a header of 256 bytes, then the rows of all frames as they
    are, compressed by zlib, packed in 12 bits, or as differences of one nibble or byte.
    """

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = Path(path)
        self.paths = im7_files(self.path)
        if not self.paths:
            raise ValueError(f"{self.path}: found no .im7 file, expected one a moment")
        self._lock = threading.Lock()
        self._last: tuple[int, NDArray] = -1, np.zeros(0)  # the file read last, and its frames
        with errors_of_libraries(f"{self.paths[0]}: not a readable image of DaVis"):
            self.image_size, self._each, self._type, _ = _header(self.paths[0])
        self.n_frames = len(self.paths) * self._each
        bits = {"uint8": 8, "uint16": 16}
        self.bit_depth = bits.get(self._type)

    @cached_property
    def timestamps(self) -> NDArray[np.float64] | None:  # type: ignore[override]
        """Seconds from the start of the series, where every file has them."""
        found = []
        for path in self.paths:
            with open(path, "rb") as file:
                file.seek(max(0, path.stat().st_size - END))
                said = {int(one): float(time) for one, time in _TIME.findall(file.read())}
            if len(said) < self._each:  # a damaged header may claim billions
                return None
            found += [said.get(number) for number in range(self._each)]
        return None if None in found else np.array(found) * 1e-6

    @cached_property
    def notes(self) -> tuple[str, ...]:  # type: ignore[override]
        """A line where a file holds several frames: which camera has which."""
        if self._each == 1:
            return ()
        return (
            f"each .im7 file holds {self._each} frames, of all cameras and exposures: `first` and "
            "`step` in scan.yaml choose those of one camera",
        )

    def _path_of(self, index: int) -> Path:
        return self.paths[index // self._each]

    def _frame(self, index: int) -> NDArray:
        place, number = divmod(index, self._each)
        with self._lock:
            if self._last[0] != place:
                size, each, kind, _ = found = _header(self.paths[place])
                if (size, each, kind) != (self.image_size, self._each, self._type):
                    raise ValueError(
                        f"found {each} frames of {size[0]} x {size[1]} {kind} pixels, expected "
                        f"{self._each} of {self.image_size[0]} x {self.image_size[1]} "
                        f"{self._type}, as in the first file"
                    )
                self._last = place, _frames(self.paths[place], *found)
            return self._last[1][number].copy()


def im7_files(path: Path) -> tuple[Path, ...]:
    """Return the .im7 files in a folder in natural order, or the one file."""
    if not path.is_dir():
        return (path,)
    inside = (one for one in path.iterdir() if one.suffix.lower() == ".im7")
    return tuple(
        sorted((one for one in inside if one.name[0] != "."), key=lambda one: natural(one.name))
    )


def _header(path: Path) -> tuple[tuple[int, int], int, str, int]:
    """Return image size, number of frames, type of pixels and way of packing."""
    version, packing, kind, is_sparse, width, height, depth, frames, *_ = _HEADER.unpack(
        read_part(path, 0, _HEADER.size)
    )
    if version != 0 or is_sparse:
        raise ValueError(f"found version {version}, expected 0, as DaVis 7 and later write")
    if kind not in _FORMATS:
        raise ValueError(f"found buffers of kind {kind}, expected grey images, kind -4 or -3")
    if min(width, height, frames) < 1 or depth != 1:
        raise ValueError(f"found {frames} frames {width} x {height} x {depth}, expected flat ones")
    if packing not in range(4) or (packing in (1, 3) and _FORMATS[kind] != "uint16"):
        raise ValueError(f"found packing {packing} of kind {kind}, expected 0 to 3")
    return (width, height), frames, _FORMATS[kind], packing


def _frames(path: Path, size: tuple[int, int], each: int, kind: str, packing: int) -> NDArray:
    """Return all frames of a file, ``(frames, height, width)``."""
    stored = path.stat().st_size - _HEADER.size
    rows = (size[0], size[1] * each)
    claimed = rows[0] * rows[1] * np.dtype(kind).itemsize
    check_claim(claimed, stored)
    shape = (each, size[1], size[0])
    if packing == _PLAIN:
        return pixels_of(read_part(path, _HEADER.size, claimed), rows, kind).reshape(shape)
    data = read_part(path, _HEADER.size, stored)
    if packing == _ZLIB:
        (length,) = struct.unpack_from("<I", data)
        if length > len(data) - 4:
            raise ValueError(f"found {len(data) - 4} bytes, expected {length}: truncated")
        try:
            unpacked = decompressed(data[4 : 4 + length], claimed)
        except zlib.error as error:
            raise ValueError(f"damaged: {error}") from None
        return pixels_of(bytes(unpacked), rows, kind).reshape(shape)
    packed = np.frombuffer(data, np.uint8)
    if packing == _DIFFERENCES:
        start = 2 + int(packed[0]) * int(packed[1])  # after a small image for previews
        image, done = _summed(packed[start:], rows[0] * rows[1])
    else:
        image, done = _of_words(packed, rows)
    if not done:
        raise ValueError("found an end inside the pixels: truncated")
    return image.reshape(shape)


def _of_words(packed: NDArray[np.uint8], rows: tuple[int, int]) -> tuple[NDArray, bool]:
    """Return pixels of 12 bits, four in three words of 16, and whether there are enough."""
    # the last pixels of a row that are fewer than four are words of their own
    width, count = rows
    words_of_groups, rest = 3 * (width // 4), width % 4
    needed = 2 * count * (words_of_groups + rest)
    if packed.size < needed:
        return np.zeros(0, np.uint16), False
    words = packed[:needed].view("<u2").reshape(count, -1)
    first, second, third = words[:, :words_of_groups].reshape(count, -1, 3).transpose(2, 0, 1)
    image = np.zeros((count, width), np.uint16)
    grouped = image[:, : width - rest].reshape(count, -1, 4)
    grouped[..., 0] = first & 0xFFF
    grouped[..., 1] = first >> 12 | (second & 0xFF) << 4
    grouped[..., 2] = second >> 8 | (third & 0xF) << 8
    grouped[..., 3] = third >> 4
    image[:, : width - rest] = grouped.reshape(count, -1)
    image[:, width - rest :] = words[:, words_of_groups:]
    return image, True


@compiled
def _summed(data, count):
    """Return pixels from differences, and whether there are enough of them."""
    # A byte is a difference to the pixel before. Byte -128: a pixel of two bytes follows; 127: so
    # many of them as the next byte says; -127: from here on a nibble is a difference, until a low
    # nibble is 8.
    image = np.zeros(count, np.uint16)
    at, last, wide, nibbles, byte, is_low = 0, 0, 0, False, 0, False
    for place in range(count):
        if wide == 0:
            if nibbles and is_low:
                step = byte & 15
                is_low = False
                if step == 8:
                    nibbles = False
                else:
                    last += step - 16 if step > 8 else step
            elif nibbles:
                if at >= data.size:
                    return image, False
                byte = np.int64(data[at])
                at += 1
                step = byte >> 4
                is_low = True
                last += step - 16 if step >= 8 else step
            if not nibbles:
                if at >= data.size:
                    return image, False
                byte = np.int64(data[at])
                at += 1
                if byte == 128:
                    wide = 1
                elif byte == 127:
                    if at >= data.size:
                        return image, False
                    wide = np.int64(data[at])
                    wide = 256 if wide == 0 else wide  # a byte that is counted down to 0
                    at += 1
                elif byte == 129:
                    if at >= data.size:
                        return image, False
                    byte = np.int64(data[at])
                    at += 1
                    step = byte >> 4
                    nibbles, is_low = True, True
                    last += step - 16 if step >= 8 else step
                else:
                    last += byte - 256 if byte > 127 else byte
        if wide > 0:
            if at + 1 >= data.size:
                return image, False
            last = np.int64(data[at]) | np.int64(data[at + 1]) << 8
            at += 2
            wide -= 1
        last &= 0xFFFF
        image[place] = last
    return image, True
