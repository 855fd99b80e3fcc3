"""The outer iterations of the default WERNet: learn weights, solve for voxels, judge both."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.selection import Choice
from tomo.selection.folds import surely_lower
from tomo.selection.left_out import Judged, LeftOut
from tomo.wernet.encoder import Encoder
from tomo.wernet.model import WERNet
from tomo.wernet.rays import RayBatch, Rays
from tomo.wernet.settings import WernetSettings
from tomo.wernet.training import PartMap, parts_of, step
from tomo.wernet.weights import RayWeights, corrections, mean_of_voxels, reweighted

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

    ``pixels`` are those to learn from, and those to judge by, ``first`` how voxels are solved for
    with segment lengths, ``choice`` with weights; None: as ``first``. Where not to ``train``, the
    encoder's weights are judged as they are. ``best`` is None while segment lengths predict
    left-out pixels best. ``unknowns`` (unknowns,) and ``ratio`` (S,) are the last solve, and its
    weights over the lengths; ``residual`` is that of left-out pixels by the weights tried last,
    NaN before.
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

    def run(self, add: Callable[[int, NDArray[np.float32], float], bool]) -> None:
        """Iterate until there is a reason to stop.

        ``add(number, unknowns, residual)`` after every iteration returns whether to stop.
        """
        while not self.stop_reason and self.done < self.limit:
            found = self.iterate()
            if found is None:
                self.stop_reason = f"diverged in outer iteration {self.done}"
                return
            if add(self.done, found.unknowns, found.training_residual):
                self.stop_reason = f"stopped by the callback after outer iteration {self.done}"

    def iterate(self) -> Judged | None:
        """Learn and solve once more; None where training diverged."""
        own, projector = self.training, self.pixels.projector
        before = self.lengths.unknowns if self.unknowns is None else self.unknowns
        volume = projector.active.expand(before).reshape(projector.grid.shape)
        means = projector.active.compress(projector.voxel_means(volume))
        rays = own.rays.with_upstream(means, own.unit)
        loss = 0.0
        if self.train:
            present = projector
            if self.ratio is not None:
                present = reweighted(projector, self.ratio)
            offset = present @ before - present.without_blur @ means
            loss = own.train(self.done, rays, means, offset)
        self.done += 1
        correction = corrections(own.encoder, rays, own.map_parts)
        largest = np.abs(correction).max(initial=0.0)
        if not (math.isfinite(loss) and largest <= LARGEST_CORRECTION):
            return None
        encoder, scale = copy.deepcopy(own.encoder), own.rays.features.image_scale
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


class EncoderTraining:
    """The encoder's half of the alternating minimisation over weights and voxels, in place.

    ``rays`` are those of all pixels, seen as "optics", ``measured`` (rays,) what they show; those
    ``held`` (rays,) are not trained on. The learning rate falls over ``iterations`` outer ones.
    The loss of some rays at the voxels ``x`` is::

        mean (p - m)² / mean m²  +  penalty mean e²,    p = d + sum_j length_j (1 + e_j)² x_j

    with the offset ``d`` of the present prediction, in the basis of the solve, from the sum over
    voxels of even emission: else the encoder would learn what these lack. ``unit`` is the root
    mean square of the measured pixels.
    """

    def __init__(
        self,
        rays: Rays,
        measured: NDArray[np.float32],
        encoder: Encoder,
        settings: WernetSettings,
        *,
        iterations: int,
        seed: int,
        map_parts: PartMap,
        held: NDArray[np.bool_],
    ) -> None:
        self.rays, self.encoder, self.settings = rays, encoder, settings
        self.iterations, self.measured, self.map_parts = iterations, measured, map_parts
        self.unit = math.sqrt(np.mean(np.square(measured, dtype=np.float64))) or 1.0
        rate, trained = settings.learning_rate, list(encoder.parameters())
        self.optimiser = torch.optim.Adam(trained, lr=rate, betas=(0.9, 0.99))
        self.generator = torch.Generator().manual_seed(seed)
        self.usable = rays.crossing[torch.from_numpy(~held)[rays.crossing]]

    def train(
        self,
        number: int,
        rays: Rays,
        volume: NDArray[np.float32],
        offset: NDArray[np.float32],
    ) -> float:
        """Train for one outer iteration, from 0, with the voxels fixed; return the mean loss.

        ``rays`` have the emission before each segment, ``volume`` (unknowns,) are the voxels'
        means, ``offset`` (rays,) is what a pixel's prediction has beside the sum over its
        segments.
        """
        settings, place = self.settings, rays.length.device
        cosine = 0.5 * (1 + math.cos(math.pi * min(number / self.iterations, 1.0)))
        for group in self.optimiser.param_groups:
            fraction = settings.last_rate + (1 - settings.last_rate) * cosine
            group["lr"] = settings.learning_rate * fraction
        # Squares in single precision cannot hold 1e30 nor 1e-30; powers of two change no digit.
        mantissa, exponent = math.frexp(self.unit)
        model = WERNet(np.ldexp(volume, -exponent), self.encoder).to(place)
        model.voxels.requires_grad_(False)
        target = torch.from_numpy(np.ldexp(self.measured - offset, -exponent)).to(place)

        def loss_of(part: RayBatch) -> tuple[torch.Tensor, torch.Tensor]:
            correction = model.encode(part)
            assert correction is not None
            misfit = (model.pixels(part, correction) - target[part.number]).square().sum()
            loss = misfit / (mantissa**2 * n_rays)
            loss = loss + settings.penalty * correction.square().sum() / n_segments
            return loss, loss

        losses = []
        order = torch.randperm(len(self.usable), generator=self.generator)
        size = max(min(len(order) // settings.steps, settings.rays_per_step), 1)
        for some in self.usable[order[: settings.steps * size]].split(size):
            batch = rays.take(some.sort().values)
            n_rays, n_segments = len(batch), len(batch.voxel)
            losses.append(step(self.optimiser, parts_of(batch), loss_of, self.map_parts))
        return float(torch.stack(losses).mean())
