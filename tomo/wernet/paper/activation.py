"""Leaky ReLU and batch normalisation of packed rays, in few passes over the rows."""

from __future__ import annotations

import torch
from torch.autograd.function import once_differentiable

SLOPE = 0.01  # of the Leaky ReLU below zero: PyTorch's default, the paper names none


class _Rectified(torch.autograd.Function):
    """Leaky ReLU in the segments' rows, zeros in the empty ones."""

    @staticmethod
    def forward(ctx, rows: torch.Tensor, empty: torch.Tensor) -> torch.Tensor:
        """Return ``(N, C)`` of ``rows`` (N, C)."""
        out = _rectify(rows, empty)
        ctx.save_for_backward(out, empty)
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx, gradient: torch.Tensor) -> tuple[torch.Tensor, None]:
        """Return the gradient to the rows."""
        return _rectify_backward(gradient, *ctx.saved_tensors), None


class _NormalisedRectified(torch.autograd.Function):
    """`_Rectified` of rows normalised by their own mean and variance, channel by channel.

    With ``c`` the rows less their mean ``m``, both over the ``n`` segments alone, and ``s`` the
    scale ``weight / sqrt(v + epsilon)``, a gradient ``g`` to ``s c + bias`` goes to the rows as::

        s (g - sum(g) / n - c sum(g c) / (n (v + epsilon)))
    """

    @staticmethod
    def forward(
        ctx,
        rows: torch.Tensor,
        weight: torch.Tensor,
        bias: torch.Tensor,
        empty: torch.Tensor,
        epsilon: float,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return ``(N, C)``, and mean and variance, ``(C,)`` each."""
        count = len(rows) - len(empty)
        mean = (rows.sum(dim=0) - rows[empty].sum(dim=0)) / count
        centred = (rows - mean).index_fill_(0, empty, 0)
        variance = centred.square().sum(dim=0) / count
        inverse = torch.rsqrt(variance + epsilon)
        out = _rectify(torch.addcmul(bias, centred, weight * inverse), empty)
        ctx.save_for_backward(out, centred, weight, inverse, empty)
        ctx.mark_non_differentiable(mean, variance)
        return out, mean, variance

    @staticmethod
    @once_differentiable
    def backward(
        ctx, gradient: torch.Tensor, *of_statistics: torch.Tensor
    ) -> tuple[torch.Tensor | None, ...]:
        """Return the gradients to rows, weight and bias."""
        out, centred, weight, inverse, empty = ctx.saved_tensors
        count = len(out) - len(empty)
        gradient = _rectify_backward(gradient, out, empty)
        to_bias = gradient.sum(dim=0)
        to_weight = (gradient * centred).sum(dim=0) * inverse
        scale = weight * inverse
        to_rows = torch.addcmul(-scale * to_bias / count, gradient, scale)
        to_rows.addcmul_(centred, -scale * inverse * to_weight / count)
        return to_rows.index_fill_(0, empty, 0), to_weight, to_bias, None, None


def _rectify(rows: torch.Tensor, empty: torch.Tensor) -> torch.Tensor:
    return torch.nn.functional.leaky_relu(rows, SLOPE).index_fill_(0, empty, 0)


def _rectify_backward(
    gradient: torch.Tensor, out: torch.Tensor, empty: torch.Tensor
) -> torch.Tensor:
    # The last argument: the sign is that of the result, so that what went in need not be kept.
    backward = torch.ops.aten.leaky_relu_backward(gradient, out, SLOPE, True)
    return backward.index_fill_(0, empty, 0)


def rectified(rows: torch.Tensor, empty: torch.Tensor) -> torch.Tensor:
    """Return the Leaky ReLU of packed rays, zeros in the empty rows: ``(N, C)``.

    Parameters
    ----------
    rows : (N, C) float
    empty : (E,) int64
        The numbers of the empty rows.
    """
    return _Rectified.apply(rows, empty)


def normalised_rectified(
    rows: torch.Tensor,
    weight: torch.Tensor,
    bias: torch.Tensor,
    empty: torch.Tensor,
    epsilon: float,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return packed rays normalised over their segments, then `rectified`; mean and variance.

    Parameters
    ----------
    rows : (N, C) float
    weight, bias : (C,) float
        Standard deviation and mean of each channel afterwards.
    empty : (E,) int64
        The numbers of the empty rows, which do not count.
    epsilon : float
        Added to the variance.

    Returns
    -------
    (N, C), (C,), (C,) float
        The latter two have no gradient.
    """
    return _NormalisedRectified.apply(rows, weight, bias, empty, epsilon)
