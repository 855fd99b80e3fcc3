"""What is asked of a reconstruction, in one piece."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

from tomo.grid import VoxelGrid
from tomo.operators import choose_form
from tomo.pipeline.asked import (
    blur_of,
    cameras_to_refine,
    check_basis,
    check_carving,
    check_device,
    check_grid,
    check_hold_out,
    check_learning,
    check_numbers,
    check_unseen,
    compared_with,
    repeats_of,
)
from tomo.pipeline.methods import Method, method_named
from tomo.scan import Scan

_AS_ASKED = (
    "skip",
    "margin",
    "dark_level",
    "votes",
    "suspects",
    "align",
    "refine_prior",
    "fit_gain",
    "weigh",
    "unseen",
    "supersample",
    "device",
    "freeze_encoder",
    "seed",
    "time_limit",
    "uncertainty",
)
"""What a report repeats of a request word for word."""


@dataclass(frozen=True)
class Request:
    """The arguments of `tomo.pipeline.reconstruct`, which says what they mean."""

    method: str
    frame: str | None
    hold_out: Sequence[str]
    iterations: int | None
    compare: Sequence[tuple[str, int | None]]
    tracer: str
    projector: str
    skip: bool
    margin: float | str
    dark_level: float | str
    votes: int | str
    suspects: bool
    align: bool
    refine_cameras: Sequence[str] | None
    refine_prior: float | None
    fit_gain: bool | None
    weigh: bool
    blur: float | str
    basis: str
    unseen: str
    supersample: int
    device: str
    encoder: str | PathLike | None
    freeze_encoder: bool
    checkpoint: str | PathLike | None
    resume: bool
    seed: int
    time_limit: float | None
    uncertainty: int | str

    def check(self, scan: Scan, grid: VoxelGrid | None) -> None:
        """Refuse, before any image is read, what cannot be done with a scan on a grid.

        Raises
        ------
        ValueError
            One line that names the argument.
        """
        methods = self.methods
        check_numbers(self.seed, self.time_limit)
        check_unseen(self.unseen)
        _ = self.repeats
        check_device(self.device, methods)
        learning = {name: value for name, value in self.learning.items() if name != "device"}
        check_learning(self.main, learning)
        check_hold_out(self.hold_out, scan)
        check_carving(
            skip=self.skip,
            margin=self.margin,
            dark_level=self.dark_level,
            votes=self.votes,
            views=len(scan.rig) - len(set(self.hold_out)),
        )
        _ = self.diameter
        check_basis(self.basis, self.blur, self.main)
        self.refined(scan)
        check_grid(grid, scan)
        choose_form(  # before coarser grids, or single steps, are refused in its place
            tuple(camera for camera in scan.rig if camera.name not in self.hold_out),
            grid,
            wanted=self.projector,
            needs_matrix=self.needs_matrix or self.needs_midpoints,
            supersample=self.supersample,
            midpoints=self.needs_midpoints,
        )

    @property
    def main(self) -> Method:
        """The method of the reconstruction."""
        return method_named(self.method)

    @property
    def others(self) -> list[tuple[Method, int | None]]:
        """The methods to run beside it, and their iterations."""
        return compared_with(self.compare)

    @property
    def methods(self) -> list[Method]:
        """All methods, that of the reconstruction first."""
        return [self.main, *(other for other, _ in self.others)]

    @property
    def needs_midpoints(self) -> bool:
        """Whether any method needs the middle of every crossing."""
        return any(one.needs_midpoints for one in self.methods)

    @property
    def needs_matrix(self) -> bool:
        """Whether any method goes through the matrix's entries."""
        return any(one.needs_matrix for one in self.methods)

    @property
    def repeats(self) -> int:
        """How often to repeat the solve with new noise."""
        return repeats_of(self.uncertainty, self.main)

    @property
    def diameter(self) -> float | None:
        """The diameter of the discs that images are blurred by; None: to be found in them."""
        return blur_of(self.blur, self.methods)

    def refined(self, scan: Scan) -> tuple[str, ...]:
        """Return the cameras to refine."""
        return cameras_to_refine(self.refine_cameras, self.refine_prior, self.hold_out, scan)

    @property
    def carving(self) -> dict[str, Any] | None:
        """The settings of `tomo.hull.carve`; None where nothing is carved."""
        if not self.skip:
            return None
        return {"margin": self.margin, "threshold": self.dark_level, "votes": self.votes}

    @property
    def learning(self) -> dict[str, Any]:
        """The arguments that only methods that learn take."""
        return {
            "device": self.device,
            "encoder": self.encoder,
            "freeze_encoder": self.freeze_encoder,
            "checkpoint": self.checkpoint,
            "resume": self.resume,
        }

    def settings(self, scan: Scan, grid: VoxelGrid) -> dict[str, Any]:
        """Return what a report says was asked for."""
        return {
            "asked": {"method": self.method, "iterations": self.iterations},
            "frame": scan.frame(self.frame).name,
            "hold_out": list(self.hold_out),
            **{name: getattr(self, name) for name in _AS_ASKED},
            "scale": scan.shrink,
            "encoder": None if self.encoder is None else str(self.encoder),
            "grid": {"shape": grid.shape, "spacing": grid.spacing, "center": grid.center},
        }
