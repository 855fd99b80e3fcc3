"""Training the default encoder at fixed voxels, a round at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.wernet.default.correction import CorrectionEncoder, ViewTokens
from tomo.wernet.default.fixed_voxels import LEARNING_RATE, FixedVoxels, set_rate
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.micro_batches import Map

STEPS = 24
LAST_STEPS = 6
"""Of a round: by then Adam's first, large steps are made good."""

RAYS_A_STEP = 3000
"""A round sees so many rays, drawn anew each time: where there are more, not all of them."""

PENALTY = 1e-3
"""Of the mean squared correction, against the mean squared relative residual."""


@dataclass(frozen=True, eq=False)
class Training:
    """What a round of training gave: the mean loss, and how its last steps found their rays.

    Attributes
    ----------
    loss : float
    rays : sequence of (B,) int64
        Of each of the last steps, none where there were fewer steps than `STEPS`; in a first round
        they had not been trained on before.
    misfits : sequence of float
        The mean squared misfit of each, before the step.
    """

    loss: float
    rays: Sequence[torch.Tensor]
    misfits: Sequence[float]

    def share_of(self, others: NDArray[np.float64]) -> float:
        """Return the misfit of the last steps over that of ``others`` (rays,), as root means.

        Zero after a round with too few rays for all its steps: it says nothing yet.
        """
        if len(self.rays) < LAST_STEPS:
            return 0.0
        other = sum(float(np.mean(others[rays.numpy()])) for rays in self.rays)
        return math.sqrt(sum(self.misfits) / other) if other > 0 else math.inf


class Alternation:
    """The encoder's half of an alternation between weights and voxels.

    The loss is that of `tomo.wernet.default.fixed_voxels`, with ``mean m²`` as its power. The
    penalty fixes the gauge: of all the ways to share a factor between weights and voxels it takes
    the one nearest the chord lengths, so that units are kept.

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
        See `tomo.wernet.micro_batches.on_cores`.
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
        # Squares in single precision know no 1e30 nor 1e-30; powers of two change no digit.
        size = float(np.sqrt(np.mean(np.square(measured, dtype=np.float64)))) or 1.0
        self.exponent = math.frexp(size)[1]
        measured = np.ldexp(measured, -self.exponent)
        self.measured = torch.from_numpy(measured).to(features.length.device)
        self.power = float(np.mean(np.square(measured, dtype=np.float64))) or 1.0
        self.parameters = [*encoder.parameters(), tokens.trend]
        if features.tells_views:
            self.parameters += [tokens.hidden, tokens.level]
        self.optimiser = torch.optim.Adam(self.parameters, lr=LEARNING_RATE, betas=(0.9, 0.99))
        self.generator = torch.Generator().manual_seed(seed)
        self.crossing = features.count.nonzero()[:, 0].cpu()

    def round(
        self,
        number: int,
        volume: NDArray[np.float32],
        front: torch.Tensor,
        beside: NDArray[np.float32] | None = None,
    ) -> Training:
        """Train with the voxels at ``volume`` (unknowns,).

        Parameters
        ----------
        number : int
            Of the round, from 0.
        volume : (unknowns,) float32
        front : (S,) float32
            The emission in front of each segment.
        beside : (rays,) float32, optional
            What pixels see of other lines than their own, less what others see of theirs.
        """
        set_rate(self.optimiser, min(number / self.rounds, 1.0))
        volume = np.ldexp(np.ascontiguousarray(volume), -self.exponent)
        values = torch.from_numpy(volume).to(self.measured.device)
        measured = self.measured
        if beside is not None:
            beside = np.ldexp(beside, -self.exponent)
            measured = measured - torch.from_numpy(beside).to(measured.device)
        fixed = FixedVoxels(self.features, front, values, measured, self.power, PENALTY)
        order = torch.randperm(len(self.crossing), generator=self.generator)
        steps = self.crossing[order[: STEPS * RAYS_A_STEP]].split(RAYS_A_STEP)
        done = [self._step(rays.sort().values, fixed) for rays in steps]
        loss = float(np.mean([loss for loss, _ in done]))
        last = LAST_STEPS if len(steps) == STEPS else 0
        return Training(
            loss, steps[STEPS - last :], [misfit for _, misfit in done[STEPS - last :]]
        )

    def _step(self, rays: torch.Tensor, fixed: FixedVoxels) -> tuple[float, float]:
        """Take one step of the optimiser, unless the loss is not finite; return it and its misfit.

        Both are those before the step.
        """
        loss, misfit = fixed.set_gradients(
            self.encoder, self.tokens, self.parameters, rays, self.over_parts
        )
        if math.isfinite(loss):
            self.optimiser.step()
        return loss, misfit

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
