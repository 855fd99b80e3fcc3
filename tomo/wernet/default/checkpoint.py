"""The state of a training run in a file, so that a run that was killed can go on."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from rigs.files import atomic_path
from rigs.files.size_guard import errors_of_libraries
from rigs.files.text import shortened
from tomo.selection import Choice
from tomo.selection.candidates import Candidate
from tomo.wernet.default.correction import CorrectionEncoder, ViewTokens
from tomo.wernet.default.ray_weights import RayWeights
from tomo.wernet.encoder_file import load_tensors, rebuilt

if TYPE_CHECKING:
    from tomo.operators import ProjectionOperator

_FORMAT, _VERSION = "wernet-checkpoint", 5


@dataclass(frozen=True, eq=False)
class Learned:
    """What one judged round gave.

    Attributes
    ----------
    index : int
        The round.
    held_out_residual, relative_residual : float
        Of left-out views, and of all with the volume.
    volume : (nx, ny, nz) float32
    solved_by : mapping
        The settings of the classic solve.
    weights : RayWeights
    """

    index: int
    held_out_residual: float
    relative_residual: float
    volume: NDArray[np.float32]
    solved_by: Mapping[str, Any]
    weights: RayWeights


@dataclass(frozen=True, eq=False)
class State:
    """What a checkpoint holds: rounds done, voxels, how they are solved for, and the training.

    ``ended`` says why training ended, and is empty while it has not; ``guessed`` is whether a
    first guess was solved with before the rounds.
    """

    round: int
    volume: NDArray[np.float32]
    choice: Choice
    best: Learned | None
    previous: float
    ended: str
    training: dict[str, Any]
    guessed: bool = False


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
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
    ) -> Checkpoint | None:
        """Return the checkpoint of a problem; None without a path."""
        if path is None:
            return None
        images = zlib.crc32(np.ascontiguousarray(measured))
        rays = 0
        for part in projector.arrays:
            rays = zlib.crc32(np.ascontiguousarray(part), rays)
        told = {key: value for key, value in settings.items() if key != "device"}
        return cls(Path(path), f"{projector.shape} {images:08x} {rays:08x} {told}")

    def save(self, state: State) -> None:
        """Write a state; the one before stays until this is whole."""
        content = {
            "format": _FORMAT,
            "version": _VERSION,
            "problem": self.problem,
            "round": state.round,
            "guessed": state.guessed,
            "volume": torch.from_numpy(state.volume.copy()),
            "choice": list(state.choice.candidate),
            "best": None if state.best is None else _packed(state.best),
            "previous": state.previous,
            "ended": state.ended,
            "training": state.training,
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
        with self.damages():
            return _state(content)

    def damages(self) -> AbstractContextManager[None]:
        """Turn what a damaged state raises when it is taken up into one line of ValueError."""
        what = "found a damaged checkpoint, expected a whole one"
        return errors_of_libraries(f"{self.path}: {what}")


def _state(content: Mapping[str, Any]) -> State:
    """Return the state that the content of a file is, checked."""
    chosen = Candidate(*content["choice"])
    for name, found, kind in (
        ("round", content["round"], int),
        ("ended", content["ended"], str),
        ("previous", content["previous"], float),
        ("training", content["training"], dict),
        ("choice: method", chosen.method, str),
        ("choice: width", chosen.width, int | float),
        ("choice: iterations", chosen.iterations, int),
        ("choice: residual", chosen.held_out_residual, int | float),
        ("choice: strength", chosen.strength, int | float | None),
    ):
        if not isinstance(found, kind) or isinstance(found, bool):
            raise ValueError(f"{name}: found {shortened(found)}")
    numbers = (content["round"], chosen.iterations, chosen.width, chosen.strength or 0.0)
    if not all(0 <= number < math.inf for number in numbers):
        raise ValueError(
            f"round, choice: found {content['round']}, {shortened(content['choice'])}"
        )
    return State(
        content["round"],
        _numbers(content["volume"], "volume"),
        Choice(*chosen, reason="as before the interruption"),
        None if content["best"] is None else _unpacked(content["best"]),
        content["previous"],
        content["ended"],
        content["training"],
        bool(content["guessed"]),
    )


def _numbers(tensor: torch.Tensor, name: str) -> NDArray[np.float32]:
    """Return a tensor of a file as an array of finite numbers."""
    if tensor.dtype != torch.float32 or not tensor.isfinite().all():
        raise ValueError(f"{name}: found {tensor.dtype}, NaN or infinity, expected float32")
    return tensor.numpy()


def _packed(best: Learned) -> dict[str, Any]:
    weights = best.weights
    return {
        "numbers": [best.index, best.held_out_residual, best.relative_residual, weights.unit],
        "volume": torch.from_numpy(best.volume.copy()),
        "solved_by": dict(best.solved_by),
        "encoder": [weights.encoder.settings, weights.encoder.state_dict()],
        "tokens": weights.tokens.state_dict(),
        "seen": torch.from_numpy(weights.volume.copy()),
        "tells_views": bool(weights.tells_views),
        "widest": weights.widest and list(weights.widest),
    }


def _unpacked(content: Mapping[str, Any]) -> Learned:
    encoder = rebuilt(CorrectionEncoder, *content["encoder"])
    tokens = ViewTokens(*content["tokens"]["hidden"].shape)
    tokens.load_state_dict(content["tokens"])
    index, held_out, residual, unit = map(float, content["numbers"])
    seen = _numbers(content["seen"], "seen")
    tells_views, widest = bool(content["tells_views"]), content["widest"]
    if widest is not None:
        widest = float(widest[0]), float(widest[1])
    weights = RayWeights(encoder, tokens, seen, unit, tells_views, widest)
    volume, solved_by = _numbers(content["volume"], "volume"), dict(content["solved_by"])
    return Learned(int(index), held_out, residual, volume, solved_by, weights)
