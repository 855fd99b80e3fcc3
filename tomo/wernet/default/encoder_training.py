"""Training the default encoder at fixed voxels, one outer iteration at a time."""

from __future__ import annotations

import math
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

RAYS_PER_STEP = 3000
"""Rays of a step, drawn anew each iteration. Fewer: noisier gradients. More: time."""

PENALTY = 1e-3
"""Weight of the mean squared correction against the mean squared relative residual. Smaller: a
common factor drifts between weights and voxels. Larger: true corrections are shrunk."""


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
    per_view : bool
        Whether gains and embeddings of the views are trained with the encoder.
    held : (rays,) bool, optional
        Rays that are not trained on.
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
        per_view: bool = True,
        held: NDArray[np.bool_] | None = None,
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
        if per_view:
            self.trained += [view_parameters.embedding, view_parameters.log_gain]
        self.optimiser = torch.optim.Adam(self.trained, lr=LEARNING_RATE, betas=(0.9, 0.99))
        self.generator = torch.Generator().manual_seed(seed)
        usable = features.count.cpu() > 0
        if held is not None:
            usable &= torch.from_numpy(~held)
        self.nonempty = usable.nonzero()[:, 0]

    def train(self, number: int, volume: NDArray[np.float32], upstream: torch.Tensor) -> float:
        """Train for one outer iteration with the voxels fixed; return the mean loss.

        Parameters
        ----------
        number : int
            Number of the outer iteration, from 0.
        volume : (unknowns,) float32
        upstream : (S,) float32
            Upstream emission of each segment.
        """
        set_rate(self.optimiser, min(number / self.iterations, 1.0))
        volume = np.ldexp(np.ascontiguousarray(volume), -self.exponent)
        values = torch.from_numpy(volume).to(self.measured.device)
        fixed = FixedVoxels(self.features, upstream, values, self.measured, self.power, PENALTY)
        order = torch.randperm(len(self.nonempty), generator=self.generator)
        steps = self.nonempty[order[: STEPS * RAYS_PER_STEP]].split(RAYS_PER_STEP)
        return float(np.mean([self._step(rays.sort().values, fixed) for rays in steps]))

    def _step(self, rays: torch.Tensor, fixed: FixedVoxels) -> float:
        """Take one step of the optimiser, unless the loss is not finite; return the loss."""
        loss = fixed.set_gradients(
            self.encoder, self.view_parameters, self.trained, rays, self.map_chunks
        )
        if math.isfinite(loss):
            self.optimiser.step()
        return loss

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
