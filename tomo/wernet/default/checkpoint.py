"""The state of a run in a file, from which an interrupted run resumes."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from rigs.files import atomic_path
from tomo.wernet.encoder_file import load_tensors

if TYPE_CHECKING:
    from tomo.operators import ProjectionOperator

FORMAT, VERSION = "wernet-checkpoint", 8


@dataclass(frozen=True)
class Checkpoint:
    """A file that holds the last complete state of one problem.

    Attributes
    ----------
    path : Path
    problem : str
        Checksums of images and rays, and the settings: a state of another problem is refused.
    """

    path: Path
    problem: str

    @classmethod
    def of(
        cls,
        path: str | Path,
        settings: Mapping[str, Any],
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
    ) -> Checkpoint:
        """Return the checkpoint of a problem."""
        images = zlib.crc32(np.ascontiguousarray(measured).data)
        rays = 0
        for part in projector.arrays:
            rays = zlib.crc32(np.ascontiguousarray(part).data, rays)
        own = {key: value for key, value in settings.items() if key != "device"}
        return cls(Path(path), f"{projector.shape} {images:08x} {rays:08x} {own}")

    def save(self, state: Mapping[str, Any]) -> None:
        """Write a state; the file keeps the one before until this is complete."""
        content = {"format": FORMAT, "version": VERSION, "problem": self.problem, "state": state}
        with atomic_path(self.path, durable=True) as temporary:
            torch.save(content, temporary)

    def load(self) -> Mapping[str, Any] | None:
        """Return the state; None where there is no file yet.

        Raises
        ------
        ValueError
            If the file is no checkpoint, or one of another version or problem.
        """
        if not self.path.exists():
            return None
        content = load_tensors(self.path, "a checkpoint")
        found, expected = (content.get("format"), content.get("version")), (FORMAT, VERSION)
        if found != expected:
            raise ValueError(f"{self.path}: format, version: found {found}, expected {expected}")
        if content.get("problem") != self.problem or not isinstance(content.get("state"), dict):
            raise ValueError(
                f"{self.path}: problem: found a checkpoint of other images, rays or settings, "
                "expected the one that was interrupted"
            )
        return content["state"]
