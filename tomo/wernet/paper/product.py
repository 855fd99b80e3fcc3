"""The voxel attention: gather the voxels of a ray, weigh them, sum them."""

from __future__ import annotations

import torch
from torch.autograd.function import once_differentiable

from tomo.wernet.packing import Packing


class _NormalisedProduct(torch.autograd.Function):
    """Weighted sum whose gradient to the voxels has the size of the residual alone.

    Forward, for the weights ``w`` and the gathered voxels ``x`` of one ray::

        p = sum_j w_j x_j

    Backward, for the gradient ``g = dL/dp``::

        to x_j:  g w_j / sqrt(sum_k w_k²)      (plain: g w_j)
        to w_j:  g x_j                         (plain as well)

    The step that the voxels take then no longer depends on how large the weights happen to be
    while both are trained at once (the gradient normalisation of arXiv 2010.00893). For g = p - m
    it is the direction of a Kaczmarz step, whose divisor is sum_k w_k².
    """

    @staticmethod
    def forward(ctx, weights: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
        """Return ``(rays,)`` from two tensors ``(rays, width)``."""
        ctx.save_for_backward(weights, values)
        return (weights * values).sum(dim=1)

    @staticmethod
    @once_differentiable
    def backward(ctx, gradient: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the gradients to the weights and to the voxels, both ``(rays, width)``."""
        weights, values = ctx.saved_tensors
        per_norm = _over(gradient, torch.linalg.vector_norm(weights, dim=1))
        return gradient[:, None] * values, per_norm[:, None] * weights


class _NormalisedPackedProduct(torch.autograd.Function):
    """`_NormalisedProduct` of packed rays."""

    @staticmethod
    def forward(
        ctx, weights: torch.Tensor, values: torch.Tensor, packing: Packing
    ) -> torch.Tensor:
        """Return ``(rays,)`` from two tensors ``(E,)``."""
        ctx.packing = packing
        ctx.save_for_backward(weights, values)
        return packing.sum(weights * values)

    @staticmethod
    @once_differentiable
    def backward(ctx, gradient: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, None]:
        """Return the gradients to the weights and to the voxels, both ``(E,)``."""
        weights, values = ctx.saved_tensors
        packing = ctx.packing
        per_norm = _over(gradient, packing.sum(weights.square()).sqrt())
        to_weights = packing.per_segment(gradient) * values
        return to_weights, packing.per_segment(per_norm) * weights, None


def _over(gradient: torch.Tensor, norm: torch.Tensor) -> torch.Tensor:
    # A ray whose weights are all zero sends nothing back, rather than 0 / 0.
    return torch.where(norm > 0, gradient / norm, torch.zeros_like(norm))


def weighted_sum(
    weights: torch.Tensor,
    voxels: torch.Tensor,
    index: torch.Tensor,
    normalise_gradient: bool = True,
) -> torch.Tensor:
    """Return each ray's projection ``sum_j w_j x[index_j]``, ``(rays,)``.

    Parameters
    ----------
    weights : (rays, width) float
        Zero in the padding.
    voxels : (voxels,) float
        The whole volume, flat.
    index : (rays, width) int64
        The voxel of every weight.
    normalise_gradient : bool
        Send ``g w / norm(w)`` back to the voxels, the norm over one ray's weights, as the paper
        does; otherwise the true gradient ``g w``.

    Notes
    -----
    The voxels are gathered with ``index_select``, whose backward pass adds in the order of the
    entries on a CPU and therefore gives the same bits every time. ``voxels[index]`` does not: its
    backward pass adds with atomics when there are several threads.
    """
    values = voxels.index_select(0, index.reshape(-1)).view_as(index)
    if normalise_gradient:
        return _NormalisedProduct.apply(weights, values)
    return (weights * values).sum(dim=1)


def packed_sum(
    weights: torch.Tensor,
    voxels: torch.Tensor,
    index: torch.Tensor,
    packing: Packing,
    normalise_gradient: bool = True,
) -> torch.Tensor:
    """Return what `weighted_sum` does, from packed rays: ``(rays,)``.

    Parameters
    ----------
    weights : (E,) float
    voxels : (voxels,) float
    index : (E,) int64
        The voxel of every weight.
    packing : Packing
        Which ray every weight belongs to.
    normalise_gradient : bool
    """
    values = voxels.index_select(0, index)
    if normalise_gradient:
        return _NormalisedPackedProduct.apply(weights, values, packing)
    return packing.sum(weights * values)
