"""WERNet itself: the voxels and the encoder, trained together."""

from __future__ import annotations

import torch
from torch import nn

from tomo.wernet.paper.encoder import WeightEncoder
from tomo.wernet.paper.samples import PackedBatch, SampleBatch, Weigh


class WERNet(nn.Module):
    """Projections from voxels that are parameters and weights that an encoder gives.

    ``p = sum_j encoder(ray)_j x[voxel_j]`` over the segments ``j`` of a ray.

    Parameters
    ----------
    encoder : WeightEncoder
        Used as it is, not copied.
    voxels : (voxels,) float
        Initial values, flat; copied.
    normalise_gradient : bool
        See `tomo.wernet.paper.weighted_sum`.
    freeze_encoder : bool
        Give the encoder no gradient, and its batch normalisation the running statistics.
    """

    def __init__(
        self,
        encoder: WeightEncoder,
        voxels: torch.Tensor,
        normalise_gradient: bool = True,
        freeze_encoder: bool = False,
    ):
        super().__init__()
        self.encoder = encoder
        self.voxels = nn.Parameter(voxels.detach().clone())
        self.normalise_gradient = normalise_gradient
        self.freeze_encoder = freeze_encoder

    def train(self, mode: bool = True) -> WERNet:
        """Switch between training and evaluation; a frozen encoder stays in evaluation."""
        super().train(mode)
        if self.freeze_encoder:
            self.encoder.eval()
        return self

    def forward(self, batch: PackedBatch | SampleBatch) -> torch.Tensor:
        """Return the projections of a batch's rays, ``(rays,)``."""
        encoder = _without_gradient(self.encoder) if self.freeze_encoder else self.encoder
        return batch.project(encoder, self.voxels, self.normalise_gradient)


def _without_gradient(encoder: WeightEncoder) -> Weigh:
    def weigh(features: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        with torch.no_grad():
            return encoder(features, mask)

    return weigh
