"""Training the default encoder at fixed voxels, one outer iteration at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.wernet.default.correction import CorrectionEncoder, ViewParameters
from tomo.wernet.default.fixed_voxels import LEARNING_RATE, FixedVoxels, set_rate
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.micro_batches import ChunkMap

STEPS = 24
"""Steps of an outer iteration. Fewer: little is learned before voxels are solved for again. More:
the encoder learns the errors of the present voxels."""

LAST_STEPS = 6
"""Last steps of an iteration, whose misfit is reported: Adam's first, large steps are over."""

RAYS_PER_STEP = 3000
"""Rays of a step, drawn anew each iteration. Fewer: noisier gradients. More: time."""

PENALTY = 1e-3
"""Weight of the mean squared correction against the mean squared relative residual. Smaller: a
common factor drifts between weights and voxels. Larger: true corrections are shrunk."""


@dataclass(frozen=True, eq=False)
class TrainingResult:
    """The mean loss of one outer iteration, and the misfit of its last steps.

    Attributes
    ----------
    loss : float
    rays : sequence of (B,) int64
        Rays of each of the last steps; none where there were fewer steps than `STEPS`. In a first
        iteration the encoder had not been trained on them before.
    misfits : sequence of float
        Mean squared misfit of each of these, before the step.
    """

    loss: float
    rays: Sequence[torch.Tensor]
    misfits: Sequence[float]

    def misfit_ratio(self, others: NDArray[np.float64]) -> float:
        """Return the root mean misfit of the last steps over that of ``others`` (rays,).

        It is zero after an iteration of too few rays for all its steps, which says nothing yet.
        """
        if len(self.rays) < LAST_STEPS:
            return 0.0
        other = sum(float(np.mean(others[rays.numpy()])) for rays in self.rays)
        return math.sqrt(sum(self.misfits) / other) if other > 0 else math.inf


class EncoderTraining:
    """The encoder's half of the alternating minimisation over weights and voxels.

    The loss is that of `tomo.wernet.default.fixed_voxels`. Its penalty fixes the common factor
    that weights and voxels could share: the weights stay near the segment lengths, and units are
    kept.

    Parameters
    ----------
    features : RayFeatures
    measured : (rays,) float32
    encoder : CorrectionEncoder
        Trained in place, as are the view parameters.
    view_parameters : ViewParameters
    iterations : int
        Outer iterations over which the learning rate falls.
    seed : int
        Seed of the order of the rays.
    map_chunks : ChunkMap
        See `tomo.wernet.micro_batches.chunk_map`.
    """

    def __init__(
        self,
        features: RayFeatures,
        measured: NDArray[np.float32],
        encoder: CorrectionEncoder,
        view_parameters: ViewParameters,
        *,
        iterations: int,
        seed: int,
        map_chunks: ChunkMap,
    ) -> None:
        self.features, self.encoder, self.view_parameters = features, encoder, view_parameters
        self.iterations, self.map_chunks = iterations, map_chunks
        # Squares in single precision cannot hold 1e30 nor 1e-30; powers of two change no digit.
        size = float(np.sqrt(np.mean(np.square(measured, dtype=np.float64)))) or 1.0
        self.exponent = math.frexp(size)[1]
        measured = np.ldexp(measured, -self.exponent)
        self.measured = torch.from_numpy(measured).to(features.length.device)
        self.power = float(np.mean(np.square(measured, dtype=np.float64))) or 1.0
        self.trained = [*encoder.parameters(), view_parameters.coefficients]
        if features.per_view:
            self.trained += [view_parameters.embedding, view_parameters.log_gain]
        self.optimiser = torch.optim.Adam(self.trained, lr=LEARNING_RATE, betas=(0.9, 0.99))
        self.generator = torch.Generator().manual_seed(seed)
        self.nonempty = features.count.nonzero()[:, 0].cpu()

    def train(
        self,
        number: int,
        volume: NDArray[np.float32],
        upstream: torch.Tensor,
        neighbours: NDArray[np.float32] | None = None,
    ) -> TrainingResult:
        """Train for one outer iteration with the voxels fixed.

        Parameters
        ----------
        number : int
            Number of the outer iteration, from 0.
        volume : (unknowns,) float32
        upstream : (S,) float32
            Upstream emission of each segment.
        neighbours : (rays,) float32, optional
            Light that an image blur brings to each pixel from other rays, less the light that it
            takes away.
        """
        set_rate(self.optimiser, min(number / self.iterations, 1.0))
        volume = np.ldexp(np.ascontiguousarray(volume), -self.exponent)
        values = torch.from_numpy(volume).to(self.measured.device)
        measured = self.measured
        if neighbours is not None:
            neighbours = np.ldexp(neighbours, -self.exponent)
            measured = measured - torch.from_numpy(neighbours).to(measured.device)
        fixed = FixedVoxels(self.features, upstream, values, measured, self.power, PENALTY)
        order = torch.randperm(len(self.nonempty), generator=self.generator)
        steps = self.nonempty[order[: STEPS * RAYS_PER_STEP]].split(RAYS_PER_STEP)
        done = [self._step(rays.sort().values, fixed) for rays in steps]
        loss = float(np.mean([loss for loss, _ in done]))
        first = STEPS - LAST_STEPS if len(steps) == STEPS else STEPS
        return TrainingResult(loss, steps[first:], [misfit for _, misfit in done[first:]])

    def _step(self, rays: torch.Tensor, fixed: FixedVoxels) -> tuple[float, float]:
        """Take one step of the optimiser, unless the loss is not finite.

        Return the loss and the misfit before the step.
        """
        loss, misfit = fixed.set_gradients(
            self.encoder, self.view_parameters, self.trained, rays, self.map_chunks
        )
        if math.isfinite(loss):
            self.optimiser.step()
        return loss, misfit

    def state(self) -> dict[str, Any]:
        """Return the state to resume from, as tensors and plain values."""
        return {
            "encoder": self.encoder.state_dict(),
            "view_parameters": self.view_parameters.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "generator": self.generator.get_state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Resume from a `state`."""
        self.encoder.load_state_dict(state["encoder"])
        self.view_parameters.load_state_dict(state["view_parameters"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.generator.set_state(state["generator"])
