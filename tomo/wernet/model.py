"""WERNet: voxels, and the weights by which rays see them, as one torch module."""

from __future__ import annotations

import numpy as np
import scipy.sparse
import torch
from numpy.typing import ArrayLike
from torch import nn

from tomo.wernet.encoder import Encoder
from tomo.wernet.rays import RayBatch

Start = torch.Tensor | ArrayLike | None


class WERNet(nn.Module):
    """The image of a volume: every factor between a voxel and a pixel; each may be learned.

    A ray ``i`` of view ``v`` with the segments ``j`` shows::

        p_i = o_v + exp(g_v) (1 - f_v r_i²) sum_j w_ij t_ij x_j

        w_ij = a_ij (1 + e_ij)²         anchored at the segment length a
        w_ij = e_ij²                    the paper's: the encoder alone
        t_ij = exp(-sum_(n before j) k_n a_in - k_j a_ij / 2)

    with the voxels ``x``, the encoder's output ``e``, the gain ``g`` and the fall-off ``f`` to the
    corners, where ``r`` is one, the background ``o`` and the extinction ``k`` of gas. A factor
    whose argument is None is left out. Parameters are called as the effects of `tomo.model` are.

    Parameters
    ----------
    voxels : (unknowns,) or (frames, unknowns) float
        First values; copied.
    encoder : Encoder, optional
        Used as it is, not copied. None: weights are the segment lengths.
    anchored : bool
        Whether the encoder corrects segment lengths; else it gives the weights by itself.
    gain, fall_off, background : (views,) float, optional
        First values.
    absorber : (nodes,) float, optional
        First extinction of gas, in 1 / length. Gas is seen in voxels that rays have segments in:
        dark ones count where no voxel is left out.
    absorber_means : (unknowns, nodes) sparse array, optional
        From nodes to means in the voxels, see `tomo.model.Absorber.means_in`; None: a node is a
        voxel.
    normalise_gradient : bool
        Divide the gradient to a voxel by the norm of its ray's weights, as the paper does. The
        step that voxels take then does not depend on how large weights happen to be. For a
        squared error it is the direction of a Kaczmarz step, whose divisor is the norm squared.

    Raises
    ------
    ValueError
        If the paper's weights are asked for without an encoder.

    Notes
    -----
    Everything is computed in the precision of ``voxels``; ``.double()`` and autocast both work.

    References
    ----------
    Pan, Li, Xu, "Weight Encode Reconstruction Network for Computed Tomography in a Semi-Case-Wise
    and Learning-Based Way", arXiv 2010.00893.
    """

    def __init__(
        self,
        voxels: torch.Tensor | ArrayLike,
        encoder: Encoder | None = None,
        *,
        anchored: bool = True,
        gain: Start = None,
        fall_off: Start = None,
        background: Start = None,
        absorber: Start = None,
        absorber_means: scipy.sparse.sparray | None = None,
        normalise_gradient: bool = False,
    ):
        super().__init__()
        if encoder is None and not anchored:
            raise ValueError("encoder: found none, expected one, which gives the weights")
        self.voxels = nn.Parameter(_copied(voxels))
        self.encoder, self.anchored = encoder, anchored
        self.normalise_gradient = normalise_gradient
        self.gain, self.fall_off = _parameter(gain), _parameter(fall_off)
        self.background, self.absorber = _parameter(background), _parameter(absorber)
        means = None
        if absorber_means is not None:
            found = scipy.sparse.coo_array(absorber_means)
            place = torch.from_numpy(np.stack(found.coords).astype(np.int64))
            value = torch.tensor(found.data, dtype=torch.float32)
            sparse = torch.sparse_coo_tensor(place, value, found.shape, check_invariants=True)
            means = sparse.coalesce()
        self.absorber_means: torch.Tensor | None
        self.register_buffer("absorber_means", means, persistent=False)

    def train(self, mode: bool = True) -> WERNet:
        """Switch between training and evaluation; an encoder that is not trained stays in it.

        Batch normalisation of a frozen encoder then goes by its running statistics.
        """
        super().train(mode)
        encoder = self.encoder
        if encoder is not None and not any(one.requires_grad for one in encoder.parameters()):
            encoder.eval()
        return self

    def forward(self, rays: RayBatch) -> torch.Tensor:
        """Return the pixels of some rays, ``(B,)``."""
        return self.pixels(rays, self.encode(rays))

    def encode(self, rays: RayBatch) -> torch.Tensor | None:
        """Return what the encoder gives for each segment, ``(E,)``; None without one."""
        if self.encoder is None:
            return None
        return self.encoder(
            _as(rays.features, self.voxels), _as(rays.mask, self.voxels)
        ).index_select(0, rays.row)

    def pixels(self, rays: RayBatch, encoded: torch.Tensor | None) -> torch.Tensor:
        """Return the pixels of some rays, ``(B,)``, with what the encoder gave."""
        length = _as(rays.length, self.voxels)
        weights = length
        if encoded is not None:
            weights = length * (1 + encoded).square() if self.anchored else encoded.square()
        if self.absorber is not None:
            weights = weights * self._transmission(rays, length, self.absorber)
        # index_select adds gradients in the order of the entries on a CPU: the same bits again.
        values = self.voxels.reshape(-1).index_select(0, rays.voxel)
        if self.normalise_gradient:
            values = _with_scaled_gradient(values, weights, rays)
        pixels = rays.sum(weights * values)
        if self.gain is not None:
            pixels = pixels * self.gain.index_select(0, rays.view).exp()
        if self.fall_off is not None:
            if rays.squared_radius is None:
                raise ValueError(
                    "squared_radius: found none, expected it in Rays.of: a fall-off needs it"
                )
            loss = self.fall_off.index_select(0, rays.view)
            pixels = pixels * (1 - loss * _as(rays.squared_radius, pixels))
        if self.background is not None:
            pixels = pixels + self.background.index_select(0, rays.view)
        return pixels

    def _transmission(
        self, rays: RayBatch, length: torch.Tensor, extinction: torch.Tensor
    ) -> torch.Tensor:
        """Return the fraction of each segment's light that arrives, ``(E,)``."""
        if self.absorber_means is not None:
            extinction = (_as(self.absorber_means, extinction) @ extinction[:, None])[:, 0]
        voxel = rays.voxel % len(extinction)  # the same gas in every frame
        return torch.exp(-rays.before(extinction.index_select(0, voxel) * length))


def _with_scaled_gradient(
    values: torch.Tensor, weights: torch.Tensor, rays: RayBatch
) -> torch.Tensor:
    """Return ``values`` (E,), their gradients over the norm of their ray's weights."""
    norm = rays.sum(weights.detach().square()).sqrt()
    scale = torch.where(norm > 0, 1 / norm, 0)  # a ray without weights sends nothing back
    held = values.detach()
    return held + rays.per_segment(scale) * (values - held)


def _as(values: torch.Tensor, like: torch.Tensor) -> torch.Tensor:
    return values.to(like.dtype)


def _parameter(start: Start) -> nn.Parameter | None:
    return None if start is None else nn.Parameter(_copied(start))


def _copied(values: torch.Tensor | ArrayLike) -> torch.Tensor:
    found = values if isinstance(values, torch.Tensor) else torch.as_tensor(np.asarray(values))
    found = found.detach().clone()
    return found if found.is_floating_point() else found.float()
