"""Videos as films, decoded by PyAV."""

from __future__ import annotations

import bisect
import os
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import check_claim, errors_of_libraries
from rigs.recordings.recording import Reopened, needs
from rigs.recordings.stills import lossy_note

if TYPE_CHECKING:
    import av

_DECODING = 12
"""Bytes of memory a pixel, while a decoder turns a picture into colours and these into grey."""

_TWO_BYTES = (
    "found raw pixels of two bytes each, which are grey levels of 16 bits or three colours of 5: "
    "the file does not say. Write it as TIFF, or give raw: in scan.yaml with header_bytes and "
    "gap_bytes of its frames"
)
"""The message on videos that decoders take for colours, and cameras mean as grey levels."""

_MISSING = 0.1  # fraction of the pictures that a header states which may not be there
_TIMED = {"mp4", "matroska"}  # FFmpeg's names of formats that say when each picture is shown
_FIVE_BITS = re.compile("(rgb|bgr)5[56]")  # FFmpeg's names of pixels of two bytes
_GREY = {8: "gray", 9: "gray9le", 10: "gray10le", 12: "gray12le", 14: "gray14le", 16: "gray16le"}


class Video(Reopened):
    """The pictures of a video as grey levels of 8 to 16 bits; see `Recording`.

    Decoding begins at the last picture before that depends on no other, in files that say of every
    picture when it is shown: MP4, QuickTime, Matroska, WebM, and any whose pictures all stand for
    themselves. Others, such as AVI, are decoded from their beginning, and have no times.
    """

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = Path(path)
        self._av = needs("av", self.path)
        self._lock = threading.Lock()
        self._open: av.container.InputContainer | None = None
        self._next = 0
        self._pictures: Iterator[av.VideoFrame] = iter(())
        self._times: list[int] = []  # when pictures are shown, in the file's units
        self._places: dict[int | None, int] = {}  # the picture that is shown at a time
        self._keys: list[int] = []  # pictures that depend on no other
        with errors_of_libraries(f"{self.path}: not a readable video"):
            with self._opened() as file:
                stream = file.streams.video[0]
                rate = stream.average_rate
                self.frame_rate = float(rate) if rate else None
                self.image_size = (stream.width, stream.height)
                check_claim(_DECODING * stream.width * stream.height, self.path.stat().st_size)
                if stream.codec_context.name == "rawvideo" and _FIVE_BITS.match(
                    stream.format.name
                ):
                    raise ValueError(_TWO_BYTES)
                bits = max((one.bits for one in stream.format.components), default=8)
            self.bit_depth = next((one for one in _GREY if one >= bits), 16)
            self.n_frames, self.timestamps = self._indexed()
        self.notes = (lossy_note("a video"),) if self.bit_depth == 8 else ()

    def _frame(self, index: int) -> NDArray:
        with self._lock:
            try:
                picture = self._picture(index)
            except Exception:
                self.close()  # a decoder that failed is not gone on with
                raise
            return picture.to_ndarray(format=_GREY[self.bit_depth])

    def close(self) -> None:
        """Close the file; reading opens it again."""
        if self._open is not None:
            self._open.close()
        self._open, self._next = None, 0

    def _picture(self, index: int) -> av.VideoFrame:
        """Return a decoded picture, going on where the last one was read where that is nearer."""
        before = bisect.bisect_right(self._keys, index) - 1
        key = self._keys[before] if before >= 0 else 0
        if self._open is None or index < self._next or key > self._next:
            self.close()
            self._open = self._opened()
            stream = self._open.streams.video[0]
            stream.codec_context.thread_count = 1  # same bits, and no threads left in a child
            if key:
                self._open.seek(self._times[key], stream=stream)
            self._pictures = self._open.decode(stream)
        for picture in self._pictures:
            place = self._places.get(picture.pts) if self._places else self._next
            if place is None:
                continue
            self._next = place + 1
            if place >= index:
                break
        else:
            raise ValueError("decoding stops before the picture")
        if place != index:
            raise ValueError("the picture cannot be decoded")
        return picture

    def _opened(self) -> av.container.InputContainer:
        file = self._av.open(str(self.path), metadata_errors="ignore")
        if not file.streams.video:
            file.close()
            raise ValueError("found no video in it, expected one")
        return file

    def _indexed(self) -> tuple[int, NDArray[np.float64] | None]:
        """Return how many pictures there are, and when each is shown, in seconds."""
        packets = []
        with self._opened() as file:
            stream = file.streams.video[0]
            stated, unit = stream.frames, stream.time_base
            for packet in file.demux(stream):
                if packet.size and not packet.is_discard:
                    packets.append((packet.pts, bool(packet.is_keyframe)))
            has_times = bool(_TIMED.intersection(file.format.name.split(",")))
        count = len(packets)
        if not count or count < (1 - _MISSING) * stated:
            raise ValueError(f"found {count} pictures, expected {stated}: truncated")
        times = {time for time, _ in packets if time is not None}
        if len(times) != count or unit is None:
            return count, None
        if not (has_times or all(is_key for _, is_key in packets)):
            return count, None
        self._times = sorted(times)
        self._places = {time: place for place, time in enumerate(self._times)}
        self._keys = sorted(
            self._places[time] for time, is_key in packets if is_key and time is not None
        )
        return count, (np.array(self._times) - self._times[0]) * float(unit)
