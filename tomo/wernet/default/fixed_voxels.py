"""The loss of an encoder at fixed voxels, and its gradient."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from tomo.wernet.default.correction import CorrectionEncoder, ViewParameters
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.default.ray_weights import packed_corrections
from tomo.wernet.micro_batches import ChunkMap, micro_batches, set_summed_gradients

LEARNING_RATE = 3e-3
"""Adam's first step. Larger: corrections overshoot at once. Smaller: 24 steps teach too little."""

LAST_RATE = 0.02
"""The learning rate falls along half a cosine to this fraction of the first. Larger: the last
corrections jitter. Smaller: the last steps are wasted."""


@dataclass(frozen=True, eq=False)
class FixedVoxels:
    """Rays, their measured pixels, and the fixed voxels that predict them.

    Attributes
    ----------
    features : RayFeatures
    upstream : (S,) float32
        Upstream emission of each segment.
    volume : (unknowns,) float32
    measured : (rays,) float32
    power : float
        Mean square of the images.
    penalty : float
        Weight of the mean squared correction.

    Notes
    -----
    The loss of some rays at the voxels ``x`` is::

        mean (p - m)² / power  +  penalty mean c²,    p = sum_j length_j (1 + c_j)² x_j
    """

    features: RayFeatures
    upstream: torch.Tensor
    volume: torch.Tensor
    measured: torch.Tensor
    power: float
    penalty: float

    def set_gradients(
        self,
        encoder: CorrectionEncoder,
        view_parameters: ViewParameters,
        trained: Sequence[torch.nn.Parameter],
        rays: torch.Tensor,
        map_chunks: ChunkMap,
    ) -> float:
        """Set the gradients of the ``trained`` parameters for the loss of some rays (B,).

        Returns
        -------
        loss : float
            The gradients of a loss that is not finite are not usable.
        """
        counts = self.features.count[rays.to(self.features.count.device)]
        n_rays, n_segments = len(rays), int(counts.sum())

        def of_chunk(chunk: slice) -> tuple[float, Sequence[torch.Tensor]]:
            some = rays[chunk].to(self.measured.device)
            packing, correction = packed_corrections(
                encoder, view_parameters, self.features, self.upstream, some
            )
            segment = packing.segment
            weight = self.features.length[segment] * (1 + correction).square()
            predicted = packing.sum(weight * self.volume[self.features.voxel[segment].long()])
            misfit = (predicted - self.measured[some]).square().sum() / (self.power * n_rays)
            loss = misfit + self.penalty * correction.square().sum() / n_segments
            return loss.item(), torch.autograd.grad(loss, trained)

        done = map_chunks(of_chunk, micro_batches(counts))
        set_summed_gradients(trained, [gradients for _, gradients in done])
        return sum(loss for loss, _ in done)


def set_rate(optimiser: torch.optim.Optimizer, progress: float) -> None:
    """Set the learning rate for a ``progress`` of training from 0 to 1."""
    cosine = 0.5 * (1 + math.cos(math.pi * progress))
    for group in optimiser.param_groups:
        group["lr"] = LEARNING_RATE * (LAST_RATE + (1 - LAST_RATE) * cosine)
