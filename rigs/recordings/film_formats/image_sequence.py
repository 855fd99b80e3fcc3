"""Still images as a recording: one file a frame."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.recordings.recording import FrameError, Reopened, check_index, check_size
from rigs.recordings.stills import image_notes, image_size, read_still


class ImageSequence(Reopened):
    """Files of one camera in the order of its frames; see `Recording`."""

    frame_rate: float | None = None
    timestamps: NDArray[np.float64] | None = None

    def __init__(self, paths: Sequence[Path], folder: Path) -> None:
        if not paths:
            raise ValueError(f"{folder}: found no image, expected one file a frame")
        self.paths = tuple(paths)
        self.folder = folder
        self.n_frames = len(paths)
        self.image_size = image_size(paths[0])
        first = read_still(paths[0])
        self.bit_depth = None if first.full_scale is None else first.full_scale.bit_length()
        self.is_mosaic = first.is_mosaic

    def _opened_by(self) -> tuple:
        return self.paths, self.folder

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Lines on what files say and reading does not heed: every file's header is read."""
        return tuple(image_notes({self.folder.name: self.paths}))

    def read(self, index: int) -> NDArray:
        """Return a frame, see `Recording.read`; colours must be equal."""
        check_index(self.folder, index, self.n_frames)
        path = self.paths[index]
        try:
            image = read_still(path).grey()
        except OSError as error:
            raise FrameError(path, index, f"cannot be read: {error.strerror}") from None
        except ValueError as error:
            raise FrameError(path, index, str(error).removeprefix(f"{path}: ")) from None
        check_size(path, index, image, self.image_size)
        return image
