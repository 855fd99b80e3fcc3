"""Videos as films, decoded by OpenCV where PyAV is not installed."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import check_claim
from rigs.recordings.notes import lossy_note
from rigs.recordings.recording import FrameError, Reopened, check_index, check_size

if TYPE_CHECKING:
    import cv2

DECODING = 12
"""Bytes of memory a pixel, while a decoder turns a picture into colours and these into grey."""

TWO_BYTES = (
    "found raw pixels of two bytes each, which are grey levels of 16 bits or three colours of 5: "
    "the file does not say. Write it as TIFF, or give raw: in scan.yaml with header_bytes and "
    "gap_bytes of its frames"
)
"""The message on videos that decoders take for colours, and cameras mean as grey levels."""

_UNCLEAR = (b"RGB\x0f", b"RGB\x10", b"BGR\x0f", b"BGR\x10")
"""FFmpeg's names of raw pixels of two bytes each: 5 or 6 bits a colour."""

_MISSING = 0.1  # fraction of the pictures that a header states which may not be there


class OpenCVVideo(Reopened):
    """The pictures of a video as grey levels, see `Recording`.

    Pictures are decoded in their order, because seeking is inexact in many formats: one that
    stands before the last read is found from the beginning.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    ValueError
        If the file cannot be decoded, or ends long before the last picture that it states.
    """

    bit_depth: int | None = 8
    timestamps: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = (lossy_note("a video"),)

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = Path(path)
        self._lock = threading.Lock()
        with _SILENT:
            video = _opened(self.path)
            import cv2

            rate = video.get(cv2.CAP_PROP_FPS)
            self.frame_rate = rate if 0 < rate < 1e9 else None
            size = video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT)
            self.image_size = (int(size[0]), int(size[1]))
            stored = int(video.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) & 0xFFFFFFFF
            video.release()
        try:
            if stored.to_bytes(4, "little") in _UNCLEAR:
                raise ValueError(TWO_BYTES)
            check_claim(
                DECODING * self.image_size[0] * self.image_size[1], self.path.stat().st_size
            )
        except ValueError as error:
            raise ValueError(f"{self.path}: {error}") from None
        self._count: int | None = None
        self._video: cv2.VideoCapture | None = None
        self._next = 0

    @property
    def n_frames(self) -> int:
        """The number of pictures: decoded once, because the one in the header is often wrong."""
        if self._count is None:
            with _SILENT:
                self._count = _decodable(self.path)
        return self._count

    def read(self, index: int) -> NDArray:
        """Return the luminance of a picture, see `Recording.read`."""
        if index < 0 or self._count is not None:
            check_index(self.path, index, self.n_frames)
        with self._lock, _SILENT:
            if self._video is None or index < self._next:
                self.close()
                self._video, self._next = _opened(self.path), 0
            while self._next <= index:
                if not self._video.grab():
                    raise FrameError(
                        self.path,
                        index,
                        f"decoding stops at picture {self._next}, expected {index + 1}",
                    )
                self._next += 1
            decoded, image = self._video.retrieve()
        if not decoded:
            raise FrameError(self.path, index, "the picture cannot be decoded")
        if image.ndim == 3:
            import cv2

            image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        check_size(self.path, index, image, self.image_size)
        return image

    def close(self) -> None:
        """Close the file; reading opens it again."""
        if self._video is not None:
            self._video.release()
        self._video = None


def _opened(path: Path) -> cv2.VideoCapture:
    import cv2

    if not path.is_file():
        raise ValueError(f"{path}: found no such video")
    video = cv2.VideoCapture(str(path))
    if not video.isOpened():
        raise ValueError(f"{path}: not a readable video: damaged, or no decoder for it")
    return video


def _decodable(path: Path) -> int:
    """Return how many pictures of a video can be decoded."""
    import cv2

    video = _opened(path)
    stated = int(max(video.get(cv2.CAP_PROP_FRAME_COUNT), 0))
    count = 0
    while video.grab():
        count += 1
    video.release()
    if count == 0 or count < (1 - _MISSING) * stated:
        raise ValueError(
            f"{path}: decoding stops at picture {count}, expected {stated}: damaged or truncated"
        )
    return count


class _Silent:
    """Keeps OpenCV's and FFmpeg's own lines off the terminal: what matters is raised.

    The level is the process's: the first thread that enters lowers it, the last one restores it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._inside = 0
        self._level = 0

    def __enter__(self) -> None:
        from cv2.utils import logging

        with self._lock:
            if not self._inside:
                # read when the first video is opened
                os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
                self._level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        from cv2.utils import logging

        with self._lock:
            self._inside -= 1
            if not self._inside:
                logging.setLogLevel(self._level)


_SILENT = _Silent()
