"""Learned ray weights, as a projector like any other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.operators import Projector
from tomo.wernet.default.encoder import CorrectionEncoder
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.micro_batches import ChunkMap, chunk_map, micro_batches
from tomo.wernet.packing import Packing


@dataclass(frozen=True, eq=False)
class RayWeights:
    """Weights ``length (1 + e)² / g`` with the corrections ``e`` of an encoder.

    Attributes
    ----------
    encoder : CorrectionEncoder
    volume : (unknowns,) float32
        The means of the voxels that the upstream emission is computed from.
    unit : float
        Unit of the upstream emission.
    image_scale : float
        See `RayFeatures`.
    gauge : (unknowns,) float32
        ``g``, see `mean_of_voxels`. No image tells a factor of all weights of a voxel from one of
        its emission: the mean weight in each voxel is therefore the mean length.
    """

    encoder: CorrectionEncoder
    volume: NDArray[np.float32]
    unit: float
    image_scale: float
    gauge: NDArray[np.float32]

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<RayWeights: {self.encoder.settings}>"

    def projector(self, projector: Projector) -> Projector:
        """Return the projector of the same rays with the learned weights.

        Parameters
        ----------
        projector : Projector
            Of these or other views. Its entries are segment lengths and its segments have
            midpoints; its unknowns are those of ``volume``.
        """
        device = self.encoder.last.weight.device
        features = RayFeatures.of(projector, device, image_scale=self.image_scale)
        upstream = features.upstream_emission(self.volume, self.unit)
        with chunk_map(device) as map_chunks:
            correction = corrections(self.encoder, features, upstream, map_chunks)
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


def packed_corrections(
    encoder: CorrectionEncoder, features: RayFeatures, upstream: torch.Tensor, rays: torch.Tensor
) -> tuple[Packing, torch.Tensor]:
    """Return the packing of some rays and the corrections of their segments, ``(E,)``."""
    packing, described = features.packed(rays, upstream)
    return packing, encoder(packing.to_rows(described), packing.mask)[packing.row]


def corrections(
    encoder: CorrectionEncoder,
    features: RayFeatures,
    upstream: torch.Tensor,
    map_chunks: ChunkMap,
) -> NDArray[np.float32]:
    """Return the correction of every segment, ``(S,)``."""
    found = np.zeros(len(features.voxel), np.float32)
    nonempty = features.count.nonzero()[:, 0]

    def fill(chunk: slice) -> None:
        with torch.no_grad():
            packing, values = packed_corrections(encoder, features, upstream, nonempty[chunk])
        found[packing.segment.cpu().numpy()] = values.cpu().numpy()

    map_chunks(fill, micro_batches(features.count[nonempty]))
    return found


def reweighted(projector: Any, ratio: NDArray[np.float32]) -> Any:
    """Return a stored projector with ``length ratio`` in place of its lengths, (S,)."""
    return projector.with_lengths(projector.segments.length * ratio)
