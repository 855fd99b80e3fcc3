"""Learned ray-voxel weights, as a projector like any other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.operators import Projector
from tomo.wernet.default import along_rays
from tomo.wernet.default.correction import CorrectionEncoder, ViewTokens
from tomo.wernet.default.fast_forward import streamed_corrections
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.micro_batches import Map, cut, on_cores
from tomo.wernet.packing import Packing


@dataclass(frozen=True, eq=False)
class RayWeights:
    """Weights ``length (1 + c)²`` with the correction ``c`` of an encoder.

    Attributes
    ----------
    encoder : CorrectionEncoder
    tokens : ViewTokens
        Of the views that it was trained with.
    volume : (unknowns,) float32
        Of what it takes the emission in front.
    unit : float
        In which that emission is counted.
    tells_views : bool
    widest : (float, float), optional
        See `RayFeatures`. Without it the widest of the rays that weights are asked for counts.
    """

    encoder: CorrectionEncoder
    tokens: ViewTokens
    volume: NDArray[np.float32]
    unit: float
    tells_views: bool
    widest: tuple[float, float] | None = None

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<RayWeights: {len(self.tokens.level)} views, {self.encoder.settings}>"

    def projector(self, projector: Projector, *, same_views: bool = True) -> Projector:
        """Return the projector of the same rays with the learned weights.

        Parameters
        ----------
        projector : Projector
            Of chord lengths, its segments with midpoints; on the active voxels of ``volume``.
        same_views : bool
            Whether its views are those trained with; others take the mean token.
        """
        device = self.tokens.level.device
        features = RayFeatures.of(
            projector, device, tells_views=self.tells_views, widest=self.widest
        )
        tokens = self.tokens if same_views else self.tokens.mean(projector.n_views)
        front = features.emission_in_front(self.volume, self.unit)
        with on_cores(device) as over_parts:
            correction = corrections(self.encoder, tokens, features, front, over_parts)
        return reweighted(projector, correction)


def correction_of(
    encoder: CorrectionEncoder,
    tokens: ViewTokens,
    features: RayFeatures,
    front: torch.Tensor,
    rays: torch.Tensor,
) -> tuple[Packing, torch.Tensor]:
    """Return the packing of some rays and the corrections of their segments, ``(E,)``.

    With ``e`` of the encoder, levels and trends multiply: ``1 + c = (1 + e) exp(trend + level)``.
    Gains and light that dims along its way are products of such factors exactly.
    """
    packing, described = features.packed(rays, front)
    view = packing.per_segment(features.view[rays])
    rows = encoder(packing.spread(described), packing.inside, packing.spread(tokens.hidden[view]))
    off_axis = packing.per_segment(features.off_axis[rays])
    trends = torch.stack((features.depth[packing.entry], front[packing.entry], off_axis), dim=1)
    exponent = trends @ tokens.trend + tokens.level[view]
    return packing, (1 + rows[packing.row]) * exponent.exp() - 1


def trend_corrections(
    tokens: ViewTokens, features: RayFeatures, front: torch.Tensor
) -> NDArray[np.float32]:
    """Return the corrections that an encoder of zeros leaves: trends and levels, ``(S,)``."""
    found = np.zeros(len(features.voxel), np.float32)
    tensors = (
        features.start, features.count, features.view, features.depth, front, features.off_axis,
        tokens.trend.detach(), tokens.level.detach(),
    )  # fmt: skip
    along_rays.trend_corrections(*(tensor.cpu().numpy() for tensor in tensors), found)
    return found


def corrections(
    encoder: CorrectionEncoder,
    tokens: ViewTokens,
    features: RayFeatures,
    front: torch.Tensor,
    over_parts: Map,
) -> NDArray[np.float32]:
    """Return the correction of every segment, ``(S,)``."""
    if encoder.is_zero:
        return trend_corrections(tokens, features, front)
    if features.length.device.type == "cpu":
        return streamed_corrections(encoder, tokens, features, front)
    found = np.zeros(len(features.voxel), np.float32)
    crossing = features.count.nonzero()[:, 0]

    def fill(part: slice) -> None:
        with torch.no_grad():
            packing, values = correction_of(encoder, tokens, features, front, crossing[part])
        found[packing.entry.cpu().numpy()] = values.cpu().numpy()

    over_parts(fill, cut(features.count[crossing]))
    return found


def reweighted(projector: Projector, correction: NDArray[np.float32]) -> Projector:
    """Return a stored projector with ``length (1 + correction)²`` in place of its lengths."""
    return projector.with_lengths(projector.segments.length * np.square(1 + correction))
