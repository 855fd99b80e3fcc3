"""The outer iterations of the default WERNet: learn weights, solve for voxels, judge both."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.selection import Choice
from tomo.selection.folds import surely_lower
from tomo.wernet.default.left_out import Judged, LeftOut
from tomo.wernet.default.ray_weights import (
    RayWeights,
    corrections,
    mean_of_voxels,
    reweighted,
)
from tomo.wernet.default.training import EncoderTraining

LARGEST_CORRECTION = 1e3
"""Corrections above it count as divergence: weights are then a million times the segment
lengths. Squares of much larger ones overflow single precision."""

HALVED = 0.5
"""Fraction of left-out pixels' squared error when smoothness was chosen, below which it is chosen
anew: where weights explain images, volumes may be finer. Smaller: they stay too smooth, and the
encoder learns what they miss. Larger: time."""

PATIENCE = 2
"""Outer iterations without a surely better prediction after which they end. Fewer: slow starters
are dropped. More: time."""


@dataclass(frozen=True, eq=False)
class JudgedWeights:
    """The learned weights of an outer iteration, its number from 1, and their squared errors.

    ``errors`` (blocks,) are those of the left-out pixels.
    """

    number: int
    errors: NDArray[np.float64]
    weights: RayWeights


@dataclass(eq=False)
class OuterIterations:
    """The progress of the alternating minimisation, and the best weights so far.

    Parameters
    ----------
    pixels : LeftOut
        The pixels to learn from, and those to judge by.
    training : EncoderTraining
    first : Choice
        How voxels are solved for with segment lengths.
    limit : int
        Number of outer iterations at most.
    train : bool
        Whether the encoder is trained; else its weights are judged as they are.
    stop_reason : str
        Why there are to be no more iterations; empty while there are.
    done : int
        Outer iterations done.
    best : JudgedWeights, optional
        None while segment lengths predict left-out pixels best.
    unknowns, ratio : (unknowns,) and (S,) float32, optional
        The last solve, and its weights over the lengths; None before the first.
    residual : float
        Relative residual of left-out pixels by the weights that were tried last; NaN: none were.
    choice : Choice, optional
        How voxels are solved for with weights; ``first`` when None.
    """

    pixels: LeftOut
    training: EncoderTraining
    first: Choice
    limit: int
    train: bool = True
    stop_reason: str = ""
    done: int = 0
    best: JudgedWeights | None = None
    unknowns: NDArray[np.float32] | None = None
    ratio: NDArray[np.float32] | None = None
    residual: float = math.nan
    choice: Choice | None = None

    @cached_property
    def lengths(self) -> Judged:
        """The solve with segment lengths."""
        return self.pixels.judge(self.pixels.projector, self.first)

    @cached_property
    def chosen_for(self) -> float:
        """Squared error of left-out pixels when smoothness was chosen last."""
        return float(self.lengths.errors.sum())

    def run(
        self,
        add: Callable[[int, NDArray[np.float32], float], bool],
        save: Callable[[], None] | None = None,
    ) -> None:
        """Iterate until there is a reason to stop.

        Parameters
        ----------
        add : callable
            ``add(number, unknowns, residual)`` after every iteration returns whether to stop.
        save : callable, optional
            Called after every iteration that trained.
        """
        while not self.stop_reason and self.done < self.limit:
            found = self.iterate()
            if found is None:
                self.stop_reason = f"diverged in outer iteration {self.done}"
                return
            if save and self.train:
                save()
            if add(self.done, found.unknowns, found.training_residual):
                self.stop_reason = f"stopped by the callback after outer iteration {self.done}"

    def iterate(self) -> Judged | None:
        """Learn and solve once more; None where training diverged."""
        own, projector = self.training, self.pixels.projector
        before = self.lengths.unknowns if self.unknowns is None else self.unknowns
        volume = projector.active.expand(before).reshape(projector.grid.shape)
        means = projector.active.compress(projector.voxel_means(volume))
        upstream = own.features.upstream_emission(means, own.unit)
        loss = 0.0
        if self.train:
            present = projector
            if self.ratio is not None:
                present = reweighted(projector, self.ratio)
            offset = present @ before - present.without_blur @ means
            loss = own.train(self.done, means, upstream, offset)
        self.done += 1
        correction = corrections(own.encoder, own.features, upstream, own.map_chunks)
        largest = np.abs(correction).max(initial=0.0)
        if not (math.isfinite(loss) and largest <= LARGEST_CORRECTION):
            return None
        encoder, scale = copy.deepcopy(own.encoder), own.features.image_scale
        gauge = mean_of_voxels(correction, projector)
        weights = RayWeights(encoder, means, own.unit, scale, gauge)
        self.ratio = weights.ratio(correction, projector)
        weighted = reweighted(projector, self.ratio)
        found = self.pixels.judge(weighted, self.choice or self.first)
        if surely_lower(found.errors, (self.best or self.lengths).errors):
            if found.errors.sum() < HALVED * self.chosen_for:
                self.choice = self.pixels.choose(weighted)
                found = self.pixels.judge(weighted, self.choice)
                self.chosen_for = float(found.errors.sum())
            self.best = JudgedWeights(self.done, found.errors, weights)
        elif self.done - (self.best.number if self.best else 0) >= PATIENCE:
            more = " more" if self.best else ""
            self.stop_reason = f"nothing{more} to learn after outer iteration {self.done}"
        self.unknowns, self.residual = found.unknowns, self.pixels.residual(found.errors)
        return found

    def state_dict(self) -> dict[str, Any]:
        """Return the state to resume from, as tensors and plain values."""
        best = self.best and {
            "number": self.best.number,
            "errors": torch.from_numpy(self.best.errors),
            "encoder": self.best.weights.encoder.state_dict(),
            "volume": torch.from_numpy(self.best.weights.volume),
            "gauge": torch.from_numpy(self.best.weights.gauge),
        }
        return {
            "done": self.done,
            "residual": self.residual,
            "stop_reason": self.stop_reason,
            "unknowns": torch.from_numpy(self.unknowns),
            "ratio": torch.from_numpy(self.ratio),
            "best": best,
            "choice": self.choice and list(self.choice.setting),
            "chosen_for": self.chosen_for,
            "training": self.training.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Resume from a state."""
        own, best = self.training, state["best"]
        own.load_state_dict(state["training"])
        self.done, self.residual = int(state["done"]), float(state["residual"])
        self.stop_reason = str(state["stop_reason"])
        self.unknowns, self.ratio = (state[name].numpy() for name in ("unknowns", "ratio"))
        self.choice = state["choice"] and Choice(*state["choice"])
        self.chosen_for = float(state["chosen_for"])
        if best is not None:
            encoder = copy.deepcopy(own.encoder)
            encoder.load_state_dict(best["encoder"])
            volume, gauge = best["volume"].numpy(), best["gauge"].numpy()
            scale = own.features.image_scale
            weights = RayWeights(encoder, volume, own.unit, scale, gauge)
            self.best = JudgedWeights(int(best["number"]), best["errors"].numpy(), weights)
