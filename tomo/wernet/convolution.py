"""Convolutions of kernel three along packed rays, and their initial weights."""

from __future__ import annotations

import torch
from torch import nn
from torch.autograd.function import once_differentiable


class _PackedConvolution(torch.autograd.Function):
    """``y_i = W_0 x_(i-1) + W_1 x_i + W_2 x_(i+1) + b`` over the rows of a matrix.

    Three products of the whole matrix, shifted by a row: no patch is copied. Outside the matrix
    there are zeros, as in a convolution with padding one.
    """

    @staticmethod
    def forward(
        ctx, rows: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor | None
    ) -> torch.Tensor:
        """Return ``(N, out)`` of ``rows`` (N, in), ``weight`` (out, in, 3) and ``bias`` (out,)."""
        ctx.save_for_backward(rows, weight)
        before, here, after = weight.permute(2, 1, 0)  # each (in, out)
        out = rows @ here if bias is None else torch.addmm(bias, rows, here)
        out[1:].addmm_(rows[:-1], before)
        out[:-1].addmm_(rows[1:], after)
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx, gradient: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        """Return the gradients to rows, weight and bias."""
        rows, weight = ctx.saved_tensors
        to_rows = to_weight = to_bias = None
        if ctx.needs_input_grad[0]:
            before, here, after = weight.permute(2, 0, 1)  # each (out, in)
            to_rows = gradient @ here
            to_rows[:-1].addmm_(gradient[1:], before)
            to_rows[1:].addmm_(gradient[:-1], after)
        if ctx.needs_input_grad[1]:
            # rows transposed, not gradient: with few columns in, BLAS is several times faster
            taps = [
                rows[:-1].T @ gradient[1:],
                rows.T @ gradient,
                rows[1:].T @ gradient[:-1],
            ]
            to_weight = torch.stack(taps).permute(2, 1, 0).contiguous()
        if ctx.needs_input_grad[2]:
            to_bias = gradient.sum(dim=0)
        return to_rows, to_weight, to_bias


def packed_convolution(
    rows: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor | None = None
) -> torch.Tensor:
    """Convolve the rows of a matrix with a kernel of three, zeros outside: ``(N, out)``.

    Parameters
    ----------
    rows : (N, in) float
        One row a segment, rays one behind another with a row of zeros between.
    weight : (out, in, 3) float
        As in `torch.nn.Conv1d`.
    bias : (out,) float, optional

    Notes
    -----
    ``torch.nn.functional.conv1d(rows.T[None], weight, bias, padding=1)[0].T`` is the same.
    """
    return _PackedConvolution.apply(rows, weight, bias)


def seeded_convolution(
    inputs: int, outputs: int, bias: bool, generator: torch.Generator
) -> nn.Conv1d:
    """Return a convolution of kernel three with PyTorch's uniform initial weights, seeded."""
    # skip_init: the ordinary constructor draws from the global random state.
    layer = nn.utils.skip_init(nn.Conv1d, inputs, outputs, 3, padding=1, bias=bias)
    bound = (3 * inputs) ** -0.5
    for parameter in layer.parameters():
        nn.init.uniform_(parameter, -bound, bound, generator=generator)
    return layer
