"""Still images as a recording: one file a frame."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

from numpy.typing import NDArray

from rigs.recordings.recording import Reopened
from rigs.recordings.stills import image_notes, image_size, read_still


class ImageSequence(Reopened):
    """Files of one camera in the order of its frames; see `Recording`."""

    def __init__(self, paths: Sequence[Path], folder: Path) -> None:
        if not paths:
            raise ValueError(f"{folder}: found no image, expected one file a frame")
        self.paths = tuple(paths)
        self.path = folder
        self.n_frames = len(paths)
        self.image_size = image_size(paths[0])
        first = read_still(paths[0])
        self._full_scale = first.full_scale
        self.bit_depth = None if first.full_scale is None else first.full_scale.bit_length()
        self.is_mosaic = first.is_mosaic

    def _opened_by(self) -> tuple:
        return self.paths, self.path

    @cached_property
    def notes(self) -> tuple[str, ...]:  # type: ignore[override]
        """Lines on what files say and reading does not heed: every file's header is read."""
        return tuple(image_notes({self.path.name: self.paths}))

    def _path_of(self, index: int) -> Path:
        return self.paths[index]

    def _frame(self, index: int) -> NDArray:
        still = read_still(self.paths[index])
        if still.full_scale != self._full_scale:
            raise ValueError(
                f"full scale: found {still.full_scale}, expected {self._full_scale} as in "
                f"{self.paths[0].name}"
            )
        return still.grey()  # colours must be equal
