"""Films of Phantom cameras, .cine files of Vision Research."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import errors_of_libraries
from rigs.recordings.film_formats.raw_film import bytes_of, pixels_of, read_part
from rigs.recordings.recording import Reopened

_FILE = struct.Struct("<2s3HiIiI3I2I")
_BITMAP = struct.Struct("<IiiHHIIiiII")
_SETUP = struct.Struct("<140x2sH")  # up to "ST" and the length
_TIMES = 1002  # the tagged block with a time for every frame
_PACKED = {0: "", 256: "uint10", 1024: "uint12"}  # pixels by biCompression; by their bits for 0
_MOSAIC = 2  # value of the file's Compression: pixels under colour filters
_STEPS_OF_10_BITS = (
    "311111111111101111111111111111011111111111111101111111111111110111111111111111101111111111111"
    "110111111111111111101111111111111110111111111111011111111111111111211111111121111112111121112"
    "111211121121121121121211212121121212121212122121221212212212212212221222122212222212222222122"
    "222222222222222222222322222223222223222322232223223223223223232322323232323232323323232332332"
    "332332333233323332333332333333332333333333333333333343333333343333433334333433433343343433434"
    "334343434343434343443434434434434434443444344443444444344444444444444444444444444544444544445"
    "444544454454454454454545445454545454554545455455455455455545554555545555554555555555555555555"
    "555555565555556555565556555655655655656556565656565656565656656656566566656665666566665666666"
    "665666666666666667666666667666676666766676676676676766767676767676767676776767767767776777677"
    "767777767777777777767777787777777777787777787777877787787787787787878778787878788787878878878"
    "878878887888878888878888888888888888888888888988888988889888988988988988989898898988"
)
"""Steps of the table by which cameras shorten 12 bits, linear in light, to 10: a digit each.

From Vision Research's description of the format. Codes above are full scale.
"""


class _Setup(NamedTuple):
    """Fields of a cine's setup, with their place in bytes."""

    frame_rate: float
    bits: int
    filters: int
    black: int
    white: int
    crop: tuple[int, int]
    length: int


class Cine(Reopened):
    """The frames of a Phantom .cine file, monochrome, of 8, 10, 12 or 16 bits; see `Recording`.

    Times are from the trigger on. Frames packed in 10 bits are made linear, in 12 bits, by the
    table of the format, which is that of "Cine File Format" by Vision Research. Rows of frames
    that are not packed are stored from the bottom up, as in a Windows bitmap.
    """

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = Path(path)
        with errors_of_libraries(f"{self.path}: not a readable Phantom film"):
            self._read_headers()

    def _read_headers(self) -> None:
        mark, _, kind, version, _, _, _, count, bitmap, setup, table, *trigger = _FILE.unpack(
            read_part(self.path, 0, _FILE.size)
        )
        if mark != b"CI":
            raise ValueError(f"found {mark!r} at its beginning, expected 'CI'")
        if count < 1:
            raise ValueError("found no frame, expected some")
        _, width, height, _, bits, packing, *_ = _BITMAP.unpack(
            read_part(self.path, bitmap, _BITMAP.size)
        )
        if width < 1 or height == 0:
            raise ValueError(f"found {width} x {height} pixels, expected at least one")
        if bits not in (8, 16) or kind not in (0, _MOSAIC):
            raise ValueError(
                f"found {bits} bits a pixel, compression {kind}, expected grey values of 8 or 16 "
                "bits, not compressed: save the film as raw, not as colours or JPEG"
            )
        if packing not in _PACKED:
            raise ValueError(f"found packing {packing}, expected 0, 256 (10 bits) or 1024 (12)")
        self._packed, self._turned = _PACKED[packing], not packing and height > 0
        self._type = self._packed or f"uint{bits}"
        self.n_frames, self.image_size = count, (width, abs(height))
        found = self._read_setup(setup)
        depth = bytes_of(self._type, 8) if packing else (found.bits if bits == 16 else 8)
        self.bit_depth = 12 if self._packed == "uint10" else depth if 1 <= depth <= bits else bits
        self.frame_rate = found.frame_rate if 0 < found.frame_rate < 1e12 else None
        self.is_mosaic = kind == _MOSAIC
        width_of_place = 8 if version else 4
        places = read_part(self.path, table, count * width_of_place)
        self._places = np.frombuffer(places, f"<u{width_of_place}")
        self.timestamps = self._read_times(setup + found.length, table, trigger)
        self.notes = tuple(self._notes(found))

    def _read_setup(self, start: int) -> _Setup:
        mark, length = _SETUP.unpack(read_part(self.path, start, _SETUP.size))
        if mark != b"ST":
            raise ValueError(f"found {mark!r} in the setup, expected 'ST'")
        setup = read_part(self.path, start, length)

        def field(kind: str, place: int) -> float:
            """Return a field; 0 where the setup of an older camera ends before."""
            is_there = place + struct.calcsize(kind) <= length
            return struct.unpack_from(kind, setup, place)[0] if is_there else 0

        rate = field("<d", 10400)
        return _Setup(
            frame_rate=rate if np.isfinite(rate) and rate > 0 else float(field("<I", 768)),
            bits=int(field("<I", 896)),
            filters=int(field("<I", 808)),
            black=int(field("<i", 5732)),
            white=int(field("<i", 5736)),
            crop=(int(field("<I", 1580)), int(field("<I", 1584))),
            length=length,
        )

    def _read_times(self, start: int, stop: int, trigger: list[int]) -> NDArray[np.float64] | None:
        """Return the frames' times from the trigger on, in seconds, where the file has them."""
        while start + 8 <= stop:
            size, kind, _ = struct.unpack("<IHH", read_part(self.path, start, 8))
            if size < 8:
                raise ValueError(f"found a tagged block of {size} bytes, expected 8 or more")
            if kind == _TIMES and size - 8 >= 8 * self.n_frames:
                data = read_part(self.path, start + 8, 8 * self.n_frames)
                fraction, second = np.frombuffer(data, "<u4").astype(np.int64).reshape(-1, 2).T
                # whole seconds since 1970 leave no room for nanoseconds in a float
                seconds = second - trigger[1]
                return seconds + (fraction - trigger[0]) / 2.0**32
            start += size
        return None

    def _notes(self, found: _Setup) -> list[str]:
        """Return lines on what the file says of the pixels, which are returned as stored."""
        said = []
        full = 2**self.bit_depth - 1
        black, white = (64, 4064) if self._packed == "uint10" else (found.black, found.white)
        if 0 < black < white <= full or 0 <= black < white < full:
            said.append(
                f"the film says that black is {black} and white {white} of {full}; pixels are "
                f"used as stored. Corrections that say so are dark: {black / full:.4g}, "
                f"saturation: {white / full:.4g}"
            )
        if any(found.crop):
            said.append(
                f"the image begins at column {found.crop[0]}, row {found.crop[1]} of the sensor: "
                "the rig has to be of this part of it"
            )
        return said

    def _frame(self, index: int) -> NDArray:
        place = int(self._places[index])
        (start,) = struct.unpack("<I", read_part(self.path, place, 4))
        if start < 8:
            raise ValueError(f"found {start} bytes before the pixels, expected 8 or more")
        (size,) = struct.unpack("<I", read_part(self.path, place + start - 4, 4))
        width, height = self.image_size
        row = bytes_of(self._type, width)
        if not self._packed and size == height * (row + -row % 4):
            row += -row % 4  # rows of bitmaps may be filled up to four bytes
        needed = height * row if not self._packed else bytes_of(self._type, width * height)
        if size < needed:
            raise ValueError(f"found {size} bytes of pixels, expected {needed}")
        data = read_part(self.path, place + start, needed)
        wide = row // bytes_of(self._type, 1) if not self._packed else width
        image = pixels_of(data, (wide, height), self._type)[:, :width]
        if self._packed == "uint10":
            return _linear_codes()[image]
        return np.ascontiguousarray(image[::-1] if self._turned else image)


def _linear_codes() -> NDArray[np.uint16]:
    """Return what the 1024 codes of 10 bits stand for, of 4095."""
    found = np.full(1024, 4095, np.uint16)
    steps = np.frombuffer(_STEPS_OF_10_BITS.encode(), np.uint8) - ord("0")
    found[0] = 2
    found[1 : len(steps) + 1] = 2 + np.cumsum(steps)
    return found
