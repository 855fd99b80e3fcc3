"""Learned ray weights, as a projector like any other."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import torch
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo.operators import Projector
from tomo.wernet.default.compiled_forward import compiled_corrections
from tomo.wernet.default.correction import CorrectionEncoder, ViewParameters
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.micro_batches import ChunkMap, chunk_map, micro_batches
from tomo.wernet.packing import Packing


@dataclass(frozen=True, eq=False)
class RayWeights:
    """Weights ``length (1 + c)²`` with learned corrections ``c``.

    Attributes
    ----------
    encoder : CorrectionEncoder
    view_parameters : ViewParameters
        Gains, coefficients and embeddings of the training views.
    volume : (unknowns,) float32
        The emission that the upstream emission is computed from.
    unit : float
        Unit of the upstream emission.
    per_view : bool
    image_scale : (float, float), optional
        See `RayFeatures`; that of the rays that weights are asked for when None.
    """

    encoder: CorrectionEncoder
    view_parameters: ViewParameters
    volume: NDArray[np.float32]
    unit: float
    per_view: bool
    image_scale: tuple[float, float] | None = None

    def __repr__(self) -> str:
        """Name the sizes."""
        views = len(self.view_parameters.log_gain)
        return f"<RayWeights: {views} views, {self.encoder.settings}>"

    def projector(self, projector: Projector, *, same_views: bool = True) -> Projector:
        """Return the projector of the same rays with the learned weights.

        Parameters
        ----------
        projector : Projector
            Its entries are segment lengths and its segments have midpoints; its unknowns are those
            of ``volume``.
        same_views : bool
            Whether its views are those of the training; others take the mean view parameters.
        """
        device = self.view_parameters.log_gain.device
        features = RayFeatures.of(
            projector, device, per_view=self.per_view, image_scale=self.image_scale
        )
        parameters = self.view_parameters
        if not same_views:
            parameters = parameters.mean(projector.n_views)
        upstream = features.upstream_emission(self.volume, self.unit)
        with chunk_map(device) as map_chunks:
            correction = corrections(self.encoder, parameters, features, upstream, map_chunks)
        return reweighted(projector, correction)


def packed_corrections(
    encoder: CorrectionEncoder,
    view_parameters: ViewParameters,
    features: RayFeatures,
    upstream: torch.Tensor,
    rays: torch.Tensor,
) -> tuple[Packing, torch.Tensor]:
    """Return the packing of some rays and the corrections of their segments, ``(E,)``.

    Notes
    -----
    With ``e`` of the encoder, the coefficients ``k`` of the terms ``t``, and the logarithm ``g``
    of the view's gain::

        1 + c = (1 + e) exp(k . t + g)

    Gains, absorption and vignetting are exactly factors of this form.
    """
    packing, described = features.packed(rays, upstream)
    segment = packing.segment
    view = packing.per_segment(features.view[rays])
    embedding = packing.to_rows(view_parameters.embedding[view])
    rows = encoder(packing.to_rows(described), packing.mask, embedding)
    off_axis = packing.per_segment(features.off_axis[rays])
    terms = torch.stack((features.depth[segment], upstream[segment], off_axis), dim=1)
    exponent = terms @ view_parameters.coefficients + view_parameters.log_gain[view]
    return packing, (1 + rows[packing.row]) * exponent.exp() - 1


def parametric_corrections(
    view_parameters: ViewParameters, features: RayFeatures, upstream: torch.Tensor
) -> NDArray[np.float32]:
    """Return the corrections by gains and global terms alone, the encoder's being zero: (S,)."""
    found = np.zeros(len(features.voxel), np.float32)
    tensors = (
        features.start, features.count, features.view, features.depth, upstream,
        features.off_axis, view_parameters.coefficients.detach(),
        view_parameters.log_gain.detach(),
    )  # fmt: skip
    _correct(*(tensor.cpu().numpy() for tensor in tensors), found)
    return found


def corrections(
    encoder: CorrectionEncoder,
    view_parameters: ViewParameters,
    features: RayFeatures,
    upstream: torch.Tensor,
    map_chunks: ChunkMap,
) -> NDArray[np.float32]:
    """Return the correction of every segment, ``(S,)``."""
    if encoder.is_zero:
        return parametric_corrections(view_parameters, features, upstream)
    if features.length.device.type == "cpu":
        return compiled_corrections(encoder, view_parameters, features, upstream)
    found = np.zeros(len(features.voxel), np.float32)
    nonempty = features.count.nonzero()[:, 0]

    def fill(chunk: slice) -> None:
        with torch.no_grad():
            packing, values = packed_corrections(
                encoder, view_parameters, features, upstream, nonempty[chunk]
            )
        found[packing.segment.cpu().numpy()] = values.cpu().numpy()

    map_chunks(fill, micro_batches(features.count[nonempty]))
    return found


def reweighted(projector: Projector, correction: NDArray[np.float32]) -> Projector:
    """Return a stored projector with ``length (1 + correction)²`` in place of its lengths."""
    return projector.with_lengths(projector.segments.length * np.square(1 + correction))


@compiled(parallel=True)
def _correct(
    start, count, view, depth, upstream, off_axis, coefficients, log_gain, correction
) -> None:
    """Write ``exp(coefficients . terms + log_gain) - 1`` to ``correction`` (S,)."""
    by_depth, by_upstream = np.float64(coefficients[0]), np.float64(coefficients[1])
    for ray in numba.prange(len(start)):
        own = np.float64(log_gain[view[ray]]) + np.float64(coefficients[2]) * off_axis[ray]
        for s in range(start[ray], start[ray] + count[ray]):
            correction[s] = np.expm1(by_depth * depth[s] + by_upstream * upstream[s] + own)
