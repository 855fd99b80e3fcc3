"""Learned ray weights, as a projector like any other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.operators import Projector
from tomo.wernet.encoder import Encoder
from tomo.wernet.rays import RayBatch, Rays
from tomo.wernet.training import PartMap, part_map, parts_of

AT_ONCE = 1 << 14
"""Rays that are packed together. More: memory. Fewer: time."""


@dataclass(frozen=True, eq=False)
class RayWeights:
    """Weights ``length (1 + e)² / g`` with the corrections ``e`` of an encoder that sees "optics".

    ``volume`` (unknowns,) are the means of the voxels that the upstream emission is computed from,
    ``unit`` is its unit, ``image_scale`` as of `tomo.wernet.features.RayFeatures`. ``gauge``
    (unknowns,) is ``g``, see `mean_of_voxels`. No image tells a factor of all weights of a voxel
    from one of its emission: the mean weight in each voxel is therefore the mean length.
    """

    encoder: Encoder
    volume: NDArray[np.float32]
    unit: float
    image_scale: float
    gauge: NDArray[np.float32]

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<RayWeights: {self.encoder.settings}>"

    def projector(self, projector: Projector) -> Projector:
        """Return the projector of the same rays with the learned weights.

        The given one, of these or other views, has segment lengths for entries, segments
        with midpoints, and the unknowns of ``volume``.
        """
        device = self.encoder.last.weight.device
        rays = Rays.of(projector, "optics", device=device, image_scale=self.image_scale)
        rays = rays.with_upstream(self.volume, self.unit)
        with part_map(device) as map_parts:
            correction = corrections(self.encoder, rays, map_parts)
        return reweighted(projector, self.ratio(correction, projector))

    def ratio(self, correction: NDArray[np.float32], projector: Projector) -> NDArray[np.float32]:
        """Return the weights over the lengths, (S,), of the encoder's corrections."""
        return np.square(1 + correction) / self.gauge[projector.segments.voxel]


def mean_of_voxels(correction: NDArray[np.float32], projector: Projector) -> NDArray[np.float32]:
    """Return the mean of ``(1 + e)²`` in each voxel, (unknowns,); longer segments count more."""
    segments, unknowns = projector.segments, projector.shape[1]
    length = segments.length.astype(np.float64)
    lengths = np.bincount(segments.voxel, length, unknowns)
    weights = np.bincount(segments.voxel, length * np.square(1 + correction), unknowns)
    ones = np.ones(unknowns)
    return np.divide(weights, lengths, ones, where=weights > 0).astype(np.float32)


def corrections(encoder: Encoder, rays: Rays, map_parts: PartMap) -> NDArray[np.float32]:
    """Return the correction of every segment, ``(S,)``."""

    @torch.no_grad()
    def correct(part: RayBatch) -> NDArray[np.float32]:
        return encoder(part.features, part.mask)[part.row].cpu().numpy()

    found = []
    for some in torch.arange(len(rays)).split(AT_ONCE):  # in order: segments come as they are
        found += map_parts(correct, parts_of(rays.take(some)))
    return np.concatenate(found)


def reweighted(projector: Any, ratio: NDArray[np.float32]) -> Any:
    """Return a stored projector with ``length ratio`` in place of its lengths, (S,)."""
    return projector.with_lengths(projector.segments.length * ratio)
