"""A small scene that learning helps, and how WERNet's runs on it end."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from tomo.metrics import cosine_similarity
from tomo.operators import Projector
from tomo.solvers import Solution

if TYPE_CHECKING:
    import torch

VIEWS = 14
"""Enough that gains of single views can be told from the light."""


GAIN_SPREAD = 0.1


@dataclass(frozen=True, eq=False)
class Scene:
    """Equations, images and the truth.

    Attributes
    ----------
    projector : Projector
    measured : (pixels,) float32
    truth : (nx, ny, nz) float32
    """

    projector: Projector
    measured: NDArray[np.float32]
    truth: NDArray[np.float32]

    def classic(self) -> NDArray[np.float32]:
        """Return the volume that chord lengths give, ``(nx, ny, nz)``."""
        from tomo.selection import choose_by_held_out_views
        from tomo.selection.choose import solve_as_chosen

        choice = choose_by_held_out_views(self.projector, self.measured)
        return solve_as_chosen(self.projector, self.measured, choice).volume

    def error(self, volume: NDArray[np.float32]) -> float:
        """Return ``|f volume - truth| / |truth|`` with the best factor ``f``; infinite for NaN.

        What the cameras' gains have in common no image tells.
        """
        if not np.isfinite(volume).all():
            return np.inf
        return math.sqrt(1 - min(cosine_similarity(volume, self.truth), 1.0) ** 2)


def scene(views: int = VIEWS, edge: float = 0.5, empty_rays: bool = False) -> Scene:
    """Return images of a few blobs, whose cameras' gains nobody wrote down.

    ``edge`` is a voxel's in the rig's unit: the same scene in any unit. ``empty_rays`` keeps the
    pixels that see no voxel.
    """
    from phantoms import create
    from rigs import ring
    from tomo import LinearSystem, VoxelGrid
    from tomo.simulation import simulate
    from tomo.simulation.effects import Effects

    grid = VoxelGrid((8, 10, 8), edge)
    pixel, distance = 0.6 * edge, 200.0 * edge
    rig = ring(views, distance=distance, image_size=(24, 20), footprint=pixel, pitch_degrees=20)
    field = create("blobs", 3, grid.extent, grid.center)
    scan = simulate(rig, field, grid, effects=Effects(gain_spread=GAIN_SPREAD), seed=3)
    system = LinearSystem.from_rig(rig, grid, midpoints=True, skip=not empty_rays)
    measured = system.flatten([scan.images[name] for name in rig.names])
    return Scene(system.projector, measured, scan.truth)


@dataclass(frozen=True)
class Run:
    """One run and its end.

    Attributes
    ----------
    name : str
    found : Solution or None
    word : str
        Why it ended: its stop reason, or what it raised.
    fault : str
        What is wrong with that end, or nothing.
    """

    name: str
    found: Solution | None
    word: str
    fault: str = ""


def run(name: str, solve: Callable[[], Solution]) -> Run:
    """Run it; the end has to be a finite volume and a reason, or an error that says why."""
    from tomo.wernet.paper import TrainingDivergedError

    try:
        found = solve()
    except (ValueError, TrainingDivergedError) as error:
        return Run(name, None, str(error), "" if str(error) else f"{name}: without a word")
    except Exception as error:  # what is looked for
        return Run(name, None, "", f"{name}: {type(error).__name__}: {error}"[:120])
    if not np.isfinite(found.volume).all():
        return Run(name, found, found.stop_reason, f"{name}: a volume that is not finite")
    return Run(name, found, found.stop_reason, "" if found.stop_reason else f"{name}: no reason")


@contextmanager
def trained_with(rate: float | None = None, rays: int | None = None) -> Iterator[dict[str, int]]:
    """Train the default encoder at another learning rate, or with other batches.

    Yields
    ------
    dict
        Counts ``gradients`` and how many of them were ``not_finite`` though a step was taken.
    """
    from tomo.wernet.default import alternation, fixed_voxels

    counts = {"gradients": 0, "not_finite": 0}
    plain = fixed_voxels.FixedVoxels.set_gradients

    def counted(
        fixed: object, encoder: object, tokens: object, parameters: list[torch.Tensor],
        *others: Any
    ) -> tuple[float, float]:  # fmt: skip
        found = plain(fixed, encoder, tokens, parameters, *others)
        if np.isfinite(found[0]):
            counts["gradients"] += len(parameters)
            counts["not_finite"] += sum(not p.grad.isfinite().all() for p in parameters)
        return found

    with (
        patch.object(fixed_voxels.FixedVoxels, "set_gradients", counted),
        patch.object(fixed_voxels, "LEARNING_RATE", rate or fixed_voxels.LEARNING_RATE),
        patch.object(alternation, "RAYS_A_STEP", rays or alternation.RAYS_A_STEP),
    ):
        yield counts


def filled(encoder: torch.nn.Module, value: float) -> torch.nn.Module:
    """Return the encoder with every number of it replaced."""
    import torch

    with torch.no_grad():
        for parameter in encoder.parameters():
            parameter.fill_(value)
    return encoder
