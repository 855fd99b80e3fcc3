"""What the figures and the report of a reconstruction show: plain values, ready to draw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.pipeline.view import View

if TYPE_CHECKING:
    from tomo.pipeline.learned_weights import LearnedWeights


@dataclass(frozen=True, eq=False)
class Convergence:
    """How one method went, one entry an iteration.

    Attributes
    ----------
    label : str
        The method.
    iterations, relative_residual, seconds : (N,) sequences
    cosine_distance : (N,) sequence, optional
        Against a truth.
    """

    label: str
    iterations: Sequence[float]
    relative_residual: Sequence[float]
    seconds: Sequence[float]
    cosine_distance: Sequence[float] | None = None

    def __post_init__(self) -> None:
        """Check that all columns are equally long."""
        n = len(self.iterations)
        for field in ("relative_residual", "seconds", "cosine_distance"):
            column = getattr(self, field)
            if column is not None and len(column) != n:
                raise ValueError(
                    f"history {self.label}: {field}: found {len(column)} entries, expected {n}"
                )


@dataclass(frozen=True, eq=False)
class Results:
    """Everything the figures and the report show.

    Attributes
    ----------
    rig : Rig
    grid : VoxelGrid
    volume : (nx, ny, nz)
        What was reconstructed.
    views : sequence of View, or of mappings with its fields
    history : sequence of Convergence, or of mappings with its fields
    truth : (nx, ny, nz), optional
    comparisons : sequence of (label, volume)
        What other methods made of the same images.
    method : str
        What to call the reconstruction in figures.
    learned : LearnedWeights, optional
        Weights learned in place of segment lengths.
    deviation : (nx, ny, nz), optional
        The standard deviation of every voxel.
    value_unit : str
        The unit of the volume's values; empty if unknown.
    half_width : (nx, ny, nz), optional
        The half-width of every voxel's 90 % interval.
    """

    rig: Rig
    grid: VoxelGrid
    volume: NDArray
    views: Sequence[View] = ()
    history: Sequence[Convergence] = ()
    truth: NDArray | None = None
    comparisons: Sequence[tuple[str, NDArray]] = ()
    method: str = "reconstruction"
    learned: LearnedWeights | None = None
    deviation: NDArray | None = None
    value_unit: str = ""
    half_width: NDArray | None = None

    if TYPE_CHECKING:  # views and histories may be given as mappings

        def __init__(
            self,
            rig: Rig,
            grid: VoxelGrid,
            volume: NDArray,
            views: Sequence[View | Mapping] = (),
            history: Sequence[Convergence | Mapping] = (),
            truth: NDArray | None = None,
            comparisons: Sequence[tuple[str, NDArray]] = (),
            method: str = "reconstruction",
            learned: LearnedWeights | None = None,
            deviation: NDArray | None = None,
            value_unit: str = "",
            half_width: NDArray | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        """Take mappings for views and histories too, and check shapes."""
        views = tuple(v if isinstance(v, View) else View(**v) for v in self.views)
        history = tuple(
            h if isinstance(h, Convergence) else Convergence(**h) for h in self.history
        )
        object.__setattr__(self, "views", views)
        object.__setattr__(self, "history", history)
        volumes = [("volume", self.volume), *self.comparisons]
        if self.truth is not None:
            volumes.append(("truth", self.truth))
        for name in ("deviation", "half_width"):
            if getattr(self, name) is not None:
                volumes.append((name, getattr(self, name)))
        for name, volume in volumes:
            if volume.shape != self.grid.shape:
                raise ValueError(
                    f"results {name}: found shape {volume.shape}, expected the grid's "
                    f"{self.grid.shape}"
                )
