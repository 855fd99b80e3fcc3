"""The state of a training run in a file, so that a run that was killed can go on."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.io.atomic import atomic_path
from tomo.solve.stopping import Choice
from tomo.wernet.encoder_file import load_tensors

if TYPE_CHECKING:
    from tomo.projector import Projector

_FORMAT, _VERSION = "wernet-checkpoint", 1


@dataclass(frozen=True, eq=False)
class State:
    """What a checkpoint holds: rounds done, voxels, how they were solved for, and the training."""

    round: int
    volume: NDArray[np.float32]
    choice: Choice
    training: dict[str, Any]


@dataclass(frozen=True)
class Checkpoint:
    """A file that holds the last good state of one problem.

    Attributes
    ----------
    path : Path
    problem : str
        Images, rays and settings in short: a state of another problem is refused.
    """

    path: Path
    problem: str

    @classmethod
    def of(
        cls,
        path: str | Path | None,
        settings: Mapping[str, Any],
        projector: Projector,
        measured: NDArray[np.float32],
    ) -> Checkpoint | None:
        """Return the checkpoint of a problem; None without a path."""
        if path is None:
            return None
        images = zlib.crc32(np.ascontiguousarray(measured))
        rays = zlib.crc32(np.ascontiguousarray(projector.segments.voxel))
        told = {key: value for key, value in settings.items() if key != "device"}
        return cls(Path(path), f"{projector.shape} {images:08x} {rays:08x} {told}")

    def save(
        self, number: int, volume: NDArray[np.float32], choice: Choice, training: dict[str, Any]
    ) -> None:
        """Write the state after round ``number``; the one before stays until this is whole."""
        content = {
            "format": _FORMAT,
            "version": _VERSION,
            "problem": self.problem,
            "round": number,
            "volume": torch.from_numpy(volume.copy()),
            "choice": [choice.method, choice.width, choice.iterations, choice.held_out_residual],
            "training": training,
        }
        with atomic_path(self.path) as temporary:
            torch.save(content, temporary)

    def load(self) -> State | None:
        """Return the state; None where there is no file yet.

        Raises
        ------
        ValueError
            If the file is no checkpoint, or one of another problem.
        """
        if not self.path.exists():
            return None
        content = load_tensors(self.path, "a checkpoint")
        if not isinstance(content, dict) or content.get("format") != _FORMAT:
            raise ValueError(f"{self.path}: format: found no {_FORMAT!r}, expected a checkpoint")
        if content.get("version") != _VERSION or content.get("problem") != self.problem:
            raise ValueError(
                f"{self.path}: problem: found a checkpoint of other images, rays or settings, "
                "expected the one that was interrupted"
            )
        method, width, iterations, residual = content["choice"]
        choice = Choice(method, width, iterations, residual, reason="as before the interruption")
        return State(content["round"], content["volume"].numpy(), choice, content["training"])
