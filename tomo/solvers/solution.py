"""The result of a solver: the volume, its history, and its cost."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tomo.grid import Volume, VoxelGrid


class LearnedWeights(Protocol):
    """Ray-voxel weights that a solver learned in place of the segment lengths."""

    def projector(self, projector: Any) -> Any:
        """Return the operator of the same segments with the learned weights."""


Callback = Callable[[int, NDArray[np.float32], float], bool | None]
"""Called as ``callback(index, volume, relative_residual)`` after each update, and before the
first with index 0; ``volume`` holds the active voxels, flat, and must not be changed: NumPy's
array, or one on the device where products are computed there, which `tomo._compute.arrays.host`
copies. Return True to stop."""


@dataclass(frozen=True)
class Iteration:
    """One line of a solver's history.

    Attributes
    ----------
    index : int
        Number of updates of the volume; 0 is the start.
    relative_residual : float
        ``||measured - A @ volume|| / ||measured||`` of that volume.
    seconds : float
        Wall time since the solver started.
    distance : float, optional
        The volume's distance from a known truth, where whoever called the solver watched it.
    """

    index: int
    relative_residual: float
    seconds: float
    distance: float | None = None


@dataclass(frozen=True, eq=False)
class Solution:
    """The emission in every voxel and the record of how it was found.

    Attributes
    ----------
    volume : Volume
        Emission per unit length, ``(nx, ny, nz)`` float32, made of any array: a pixel is the sum
        of ``volume x segment length``.
    grid : VoxelGrid
        The grid of the volume.
    history : tuple of Iteration
        One entry an iteration, the start included.
    settings : mapping
        The method and all its arguments.
    stop_reason : str
        Why the solver stopped, in words.
    quality : mapping
        Figures against a truth or held-out views, where there are any.
    seconds : mapping
        Wall time of each stage.
    peak_memory : int
        The process's largest resident memory so far, in bytes; 0 when not measured.
    weights : LearnedWeights, optional
        Ray weights learned in place of the segment lengths, see `tomo.wernet`; None where the
        segment lengths were used.
    encoder : torch.nn.Module, optional
        Trained encoder of WERNet, which `tomo.wernet.save_encoder` writes; None where none was
        trained or its weights were not kept.
    """

    volume: NDArray[np.float32]
    grid: VoxelGrid
    history: tuple[Iteration, ...]
    settings: Mapping[str, Any]
    stop_reason: str = ""
    quality: Mapping[str, float] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    peak_memory: int = 0
    weights: LearnedWeights | None = None
    encoder: Any = None

    def __post_init__(self) -> None:
        """Put the volume on the grid."""
        object.__setattr__(self, "volume", Volume(self.volume, self.grid))

    def __repr__(self) -> str:
        """Name the method, the size and the relative residual."""
        method = self.settings.get("method", "?")
        residual = self.relative_residual
        return f"<Solution: {method}, {self.grid.shape}, relative residual {residual:.3g}>"

    @property
    def relative_residual(self) -> float:
        """Relative residual of the volume; NaN without a history."""
        return self.history[-1].relative_residual if self.history else float("nan")
