"""The state of a run in a file, from which an interrupted run resumes."""

from __future__ import annotations

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
from tomo.wernet.default.correction import CorrectionEncoder, ViewParameters
from tomo.wernet.default.ray_weights import RayWeights
from tomo.wernet.encoder_file import load_tensors, rebuilt

if TYPE_CHECKING:
    from tomo.operators import ProjectionOperator

_FORMAT, _VERSION = "wernet-checkpoint", 7


@dataclass(frozen=True, eq=False)
class JudgedWeights:
    """Learned weights of one outer iteration, and how well they predict left-out pixels.

    Attributes
    ----------
    index : int
        The outer iteration; 0 for parametric terms alone.
    errors : (blocks,) float64
        Squared errors of the left-out pixels.
    weights : RayWeights
    """

    index: int
    errors: NDArray[np.float64]
    weights: RayWeights


@dataclass(frozen=True, eq=False)
class State:
    """The content of a checkpoint.

    Attributes
    ----------
    iteration : int
        Outer iterations done.
    volume : (unknowns,) float32
    best : JudgedWeights, optional
    residual : float
        Relative residual of left-out pixels by the weights that were tried last.
    stop_reason : str
        Why the iterations ended; empty while they go on.
    training : dict
        State of `tomo.wernet.default.encoder_training.EncoderTraining`.
    has_terms : bool
        Whether parametric terms were found before the first iteration.
    """

    iteration: int
    volume: NDArray[np.float32]
    best: JudgedWeights | None
    residual: float
    stop_reason: str
    training: dict[str, Any]
    has_terms: bool = False


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
        path: str | Path | None,
        settings: Mapping[str, Any],
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
    ) -> Checkpoint | None:
        """Return the checkpoint of a problem; None without a path."""
        if path is None:
            return None
        images = zlib.crc32(np.ascontiguousarray(measured).data)
        rays = 0
        for part in projector.arrays:
            rays = zlib.crc32(np.ascontiguousarray(part).data, rays)
        own = {key: value for key, value in settings.items() if key != "device"}
        return cls(Path(path), f"{projector.shape} {images:08x} {rays:08x} {own}")

    def save(self, state: State) -> None:
        """Write a state; the file keeps the one before until this is complete."""
        content = {
            "format": _FORMAT,
            "version": _VERSION,
            "problem": self.problem,
            "iteration": state.iteration,
            "has_terms": state.has_terms,
            "volume": torch.from_numpy(state.volume.copy()),
            "best": None if state.best is None else _packed(state.best),
            "residual": state.residual,
            "stop_reason": state.stop_reason,
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
        if content.get("version") != _VERSION:
            raise ValueError(
                f"{self.path}: version: found {content.get('version')!r}, expected {_VERSION}"
            )
        if content.get("problem") != self.problem:
            raise ValueError(
                f"{self.path}: problem: found a checkpoint of other images, rays or settings, "
                "expected the one that was interrupted"
            )
        with self.damages():
            return _state(content)

    def damages(self) -> AbstractContextManager[None]:
        """Turn errors of a damaged state into one line of ValueError."""
        return errors_of_libraries(
            f"{self.path}: found a damaged checkpoint, expected a complete one"
        )


def _state(content: Mapping[str, Any]) -> State:
    """Return the state in the content of a file, checked."""
    kinds = {"iteration": int, "residual": float, "stop_reason": str, "training": dict}
    for name, kind in kinds.items():
        found = content[name]
        if not isinstance(found, kind) or isinstance(found, bool):
            raise ValueError(f"{name}: found {shortened(found)}")
    if content["iteration"] < 0:
        raise ValueError(f"iteration: found {content['iteration']}")
    return State(
        content["iteration"],
        _numbers(content["volume"], "volume", torch.float32),
        None if content["best"] is None else _unpacked(content["best"]),
        content["residual"],
        content["stop_reason"],
        content["training"],
        bool(content["has_terms"]),
    )


def _numbers(tensor: torch.Tensor, name: str, kind: torch.dtype) -> NDArray:
    """Return a tensor of a file as an array of finite numbers."""
    if tensor.dtype != kind or not tensor.isfinite().all():
        raise ValueError(f"{name}: found {tensor.dtype}, NaN or infinity, expected {kind}")
    return tensor.numpy()


def _packed(best: JudgedWeights) -> dict[str, Any]:
    weights = best.weights
    return {
        "numbers": [best.index, weights.unit],
        "errors": torch.from_numpy(best.errors.copy()),
        "encoder": [weights.encoder.settings, weights.encoder.state_dict()],
        "view_parameters": weights.view_parameters.state_dict(),
        "upstream_volume": torch.from_numpy(weights.volume.copy()),
        "per_view": bool(weights.per_view),
        "image_scale": weights.image_scale and list(weights.image_scale),
    }


def _unpacked(content: Mapping[str, Any]) -> JudgedWeights:
    encoder = rebuilt(CorrectionEncoder, *content["encoder"])
    parameters = ViewParameters(*content["view_parameters"]["embedding"].shape)
    parameters.load_state_dict(content["view_parameters"])
    index, unit = map(float, content["numbers"])
    upstream_volume = _numbers(content["upstream_volume"], "upstream_volume", torch.float32)
    per_view, scale = bool(content["per_view"]), content["image_scale"]
    if scale is not None:
        scale = float(scale[0]), float(scale[1])
    weights = RayWeights(encoder, parameters, upstream_volume, unit, per_view, scale)
    errors = _numbers(content["errors"], "errors", torch.float64)
    return JudgedWeights(int(index), errors, weights)
