"""The loss of an encoder at voxels that stay as they are, and its gradient."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from tomo.wernet.default.correction import CorrectionEncoder, ViewTokens
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.default.ray_weights import correction_of
from tomo.wernet.micro_batches import Map, add_gradients, cut

LEARNING_RATE = 3e-3
LAST_RATE = 0.02
"""The learning rate falls along half a cosine, to this share of it."""


@dataclass(frozen=True, eq=False)
class FixedVoxels:
    """Rays, what their pixels measured, and the voxels that are to predict them.

    The loss of some rays, at the voxels ``x``::

        mean (p - m)² / power  +  penalty mean c²,    p = sum_j length_j (1 + c_j)² x_j

    Attributes
    ----------
    features : RayFeatures
    front : (S,) float32
        The emission in front of each segment.
    volume : (unknowns,) float32
    measured : (rays,) float32
    power : float
        What a squared misfit is counted in.
    penalty : float
        Of the mean squared correction.
    """

    features: RayFeatures
    front: torch.Tensor
    volume: torch.Tensor
    measured: torch.Tensor
    power: float
    penalty: float

    def set_gradients(
        self,
        encoder: CorrectionEncoder,
        tokens: ViewTokens,
        parameters: Sequence[torch.nn.Parameter],
        rays: torch.Tensor,
        over_parts: Map,
    ) -> tuple[float, float]:
        """Set the gradients of ``parameters``; return the loss of ``rays`` (B,) and its misfit.

        The misfit is the loss without the penalty. Gradients of a loss that is not finite mean
        nothing.
        """
        counts = self.features.count[rays.to(self.features.count.device)]
        n_rays, n_segments = len(rays), int(counts.sum())

        def of_part(part: slice) -> tuple[float, float, Sequence[torch.Tensor]]:
            some = rays[part].to(self.measured.device)
            packing, correction = correction_of(encoder, tokens, self.features, self.front, some)
            entry = packing.entry
            weight = self.features.length[entry] * (1 + correction).square()
            seen = packing.sum(weight * self.volume[self.features.voxel[entry].long()])
            misfit = (seen - self.measured[some]).square().sum() / (self.power * n_rays)
            loss = misfit + self.penalty * correction.square().sum() / n_segments
            return loss.item(), misfit.item(), torch.autograd.grad(loss, parameters)

        done = over_parts(of_part, cut(counts))
        add_gradients(parameters, [gradients for _, _, gradients in done])
        return sum(loss for loss, _, _ in done), sum(misfit for _, misfit, _ in done)


def set_rate(optimiser: torch.optim.Optimizer, done: float) -> None:
    """Set the learning rate that goes with a share ``done``, 0 to 1, of the training."""
    share = 0.5 * (1 + math.cos(math.pi * done))
    for group in optimiser.param_groups:
        group["lr"] = LEARNING_RATE * (LAST_RATE + (1 - LAST_RATE) * share)
