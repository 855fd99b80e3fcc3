"""Training the default encoder at fixed voxels, one outer iteration at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.wernet.default.encoder import CorrectionEncoder
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.default.ray_weights import packed_corrections
from tomo.wernet.micro_batches import ChunkMap, micro_batches, set_summed_gradients
from tomo.wernet.settings import WernetSettings


class EncoderTraining:
    """The encoder's half of the alternating minimisation over weights and voxels.

    Parameters
    ----------
    features : RayFeatures
    measured : (rays,) float32
    encoder : CorrectionEncoder
        Trained in place.
    settings : WernetSettings
        Steps, rays, penalty and learning rates.
    iterations : int
        Outer iterations over which the learning rate falls.
    seed : int
        Seed of the order of the rays.
    map_chunks : ChunkMap
        See `tomo.wernet.micro_batches.chunk_map`.
    held : (rays,) bool
        Rays that are not trained on.

    Notes
    -----
    The loss of some rays at the voxels ``x`` is::

        mean (p - m)² / mean m²  +  penalty mean e²,    p = d + sum_j length_j (1 + e_j)² x_j

    with the offset ``d`` of the present prediction, in the basis of the solve, from the sum over
    voxels of even emission: else the encoder would learn what these lack.

    Attributes
    ----------
    unit : float
        The root mean square of the measured pixels.
    """

    def __init__(
        self,
        features: RayFeatures,
        measured: NDArray[np.float32],
        encoder: CorrectionEncoder,
        *,
        settings: WernetSettings,
        iterations: int,
        seed: int,
        map_chunks: ChunkMap,
        held: NDArray[np.bool_],
    ) -> None:
        self.features, self.encoder, self.map_chunks = features, encoder, map_chunks
        self.settings, self.iterations, self.measured = settings, iterations, measured
        self.unit = math.sqrt(np.mean(np.square(measured, dtype=np.float64))) or 1.0
        self.trained = list(encoder.parameters())
        self.optimiser = torch.optim.Adam(
            self.trained, lr=settings.learning_rate, betas=(0.9, 0.99)
        )
        self.generator = torch.Generator().manual_seed(seed)
        usable = (features.count.cpu() > 0) & torch.from_numpy(~held)
        self.usable = usable.nonzero()[:, 0]

    def train(
        self,
        number: int,
        volume: NDArray[np.float32],
        upstream: torch.Tensor,
        offset: NDArray[np.float32],
    ) -> float:
        """Train for one outer iteration with the voxels fixed; return the mean loss.

        Parameters
        ----------
        number : int
            Number of the outer iteration, from 0.
        volume : (unknowns,) float32
            The means of the voxels.
        upstream : (S,) float32
            Upstream emission of each segment.
        offset : (rays,) float32
            What the prediction of each pixel has beside the sum over its segments.
        """
        progress = min(number / self.iterations, 1.0)
        cosine = 0.5 * (1 + math.cos(math.pi * progress))
        own = self.settings
        for group in self.optimiser.param_groups:
            group["lr"] = own.learning_rate * (own.last_rate + (1 - own.last_rate) * cosine)
        # Squares in single precision cannot hold 1e30 nor 1e-30; powers of two change no digit.
        exponent = math.frexp(self.unit)[1]
        scaled = (np.ldexp(each, -exponent) for each in (volume, self.measured - offset))
        fixed = [torch.from_numpy(each).to(upstream.device) for each in scaled]
        order = torch.randperm(len(self.usable), generator=self.generator)
        size = max(min(len(order) // own.steps, own.rays_per_step), 1)
        steps = self.usable[order[: own.steps * size]].split(size)
        return float(np.mean([self._step(rays.sort().values, upstream, *fixed) for rays in steps]))

    def _step(
        self,
        rays: torch.Tensor,
        upstream: torch.Tensor,
        volume: torch.Tensor,
        target: torch.Tensor,
    ) -> float:
        """Take one step of the optimiser, unless the loss is not finite; return the loss."""
        features, rays = self.features, rays.to(upstream.device)
        counts = features.count[rays]
        n_segments, power = int(counts.sum()), math.frexp(self.unit)[0] ** 2

        def of_chunk(chunk: slice) -> tuple[float, Sequence[torch.Tensor]]:
            some = rays[chunk]
            packing, correction = packed_corrections(self.encoder, features, upstream, some)
            weight = features.length[packing.segment] * (1 + correction).square()
            light = weight * volume[features.voxel[packing.segment].long()]
            misfit = (packing.sum(light) - target[some]).square().sum() / (power * len(rays))
            loss = misfit + self.settings.penalty * correction.square().sum() / n_segments
            return loss.item(), torch.autograd.grad(loss, self.trained)

        done = self.map_chunks(of_chunk, micro_batches(counts))
        loss = sum(part for part, _ in done)
        if math.isfinite(loss):
            set_summed_gradients(self.trained, [gradients for _, gradients in done])
            self.optimiser.step()
        return loss

    def state_dict(self) -> dict[str, Any]:
        """Return the state to resume from, as tensors and plain values."""
        return {
            "encoder": self.encoder.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "generator": self.generator.get_state(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Resume from a state."""
        self.encoder.load_state_dict(state["encoder"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.generator.set_state(state["generator"])
