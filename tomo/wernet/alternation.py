"""Training the default encoder at fixed voxels, a round at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.wernet.correction import CorrectionEncoder, ViewTokens
from tomo.wernet.parts import Map, add_gradients, cut
from tomo.wernet.ray_features import RayFeatures
from tomo.wernet.ray_weights import SEGMENTS_A_PART, correction_of

STEPS = 24
RAYS_A_STEP = 3000
"""A round sees so many rays, drawn anew each time: where there are more, not all of them."""

LEARNING_RATE = 3e-3
LAST_RATE = 0.02
"""The learning rate falls along half a cosine from round to round, to this share of it."""

PENALTY = 1e-3
"""Of the mean squared correction, against the mean squared relative residual."""


class Alternation:
    """The encoder's half of an alternation between weights and voxels.

    The loss of some rays, at fixed voxels ``x``::

        mean (p - m)² / mean m²  +  PENALTY mean c²,    p = sum_j length_j (1 + c_j)² x_j

    The penalty fixes the gauge: of all the ways to share a factor between weights and voxels it
    takes the one nearest the chord lengths, so that units are kept.

    Parameters
    ----------
    features : RayFeatures
    measured : (rays,) float32
    encoder : CorrectionEncoder
    tokens : ViewTokens
        Both are trained in place.
    rounds : int
        How many rounds the learning rate is to fall over.
    seed : int
        Of the rays' order.
    over_parts : Map
        See `tomo.wernet.parts.on_cores`.
    """

    def __init__(
        self,
        features: RayFeatures,
        measured: NDArray[np.float32],
        encoder: CorrectionEncoder,
        tokens: ViewTokens,
        *,
        rounds: int,
        seed: int,
        over_parts: Map,
    ) -> None:
        self.features, self.encoder, self.tokens = features, encoder, tokens
        self.rounds, self.over_parts = rounds, over_parts
        self.measured = torch.from_numpy(measured).to(features.length.device)
        self.power = float(np.mean(np.square(measured, dtype=np.float64))) or 1.0
        self.parameters = [*encoder.parameters(), tokens.trend]
        if features.tells_views:
            self.parameters += [tokens.hidden, tokens.level]
        self.optimiser = torch.optim.Adam(self.parameters, lr=LEARNING_RATE, betas=(0.9, 0.99))
        self.generator = torch.Generator().manual_seed(seed)
        self.crossing = features.count.nonzero()[:, 0].cpu()

    def round(self, number: int, volume: NDArray[np.float32], front: torch.Tensor) -> float:
        """Train with the voxels at ``volume`` (unknowns,); return the mean loss.

        Parameters
        ----------
        number : int
            Of the round, from 0.
        volume : (unknowns,) float32
        front : (S,) float32
            The emission in front of each segment.
        """
        share = 0.5 * (1 + math.cos(math.pi * min(number / self.rounds, 1.0)))
        for group in self.optimiser.param_groups:
            group["lr"] = LEARNING_RATE * (LAST_RATE + (1 - LAST_RATE) * share)
        values = torch.from_numpy(np.ascontiguousarray(volume)).to(self.measured.device)
        order = torch.randperm(len(self.crossing), generator=self.generator)
        steps = self.crossing[order[: STEPS * RAYS_A_STEP]].split(RAYS_A_STEP)
        losses = [self._step(rays.sort().values, values, front) for rays in steps]
        return float(np.mean(losses))

    def _step(self, rays: torch.Tensor, values: torch.Tensor, front: torch.Tensor) -> float:
        """Take one step of the optimiser; return the loss before it."""
        counts = self.features.count[rays.to(self.features.count.device)]
        n_rays, n_segments = len(rays), int(counts.sum())

        def of_part(part: slice) -> tuple[float, Sequence[torch.Tensor]]:
            some = rays[part].to(self.measured.device)
            packing, correction = correction_of(
                self.encoder, self.tokens, self.features, front, some
            )
            entry = packing.entry
            weight = self.features.length[entry] * (1 + correction).square()
            seen = packing.sum(weight * values[self.features.voxel[entry].long()])
            misfit = (seen - self.measured[some]).square().sum() / (self.power * n_rays)
            loss = misfit + PENALTY * correction.square().sum() / n_segments
            return loss.item(), torch.autograd.grad(loss, self.parameters)

        done = self.over_parts(of_part, cut(counts, SEGMENTS_A_PART))
        loss = sum(one for one, _ in done)
        if math.isfinite(loss):
            add_gradients(self.parameters, [gradients for _, gradients in done])
            self.optimiser.step()
        return loss

    def state(self) -> dict[str, Any]:
        """Return all that going on needs, as tensors and plain values."""
        return {
            "encoder": self.encoder.state_dict(),
            "tokens": self.tokens.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "generator": self.generator.get_state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Take up what `state` returned."""
        self.encoder.load_state_dict(state["encoder"])
        self.tokens.load_state_dict(state["tokens"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.generator.set_state(state["generator"])
