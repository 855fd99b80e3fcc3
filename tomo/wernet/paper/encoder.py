"""The voxel weight encoder: from six numbers a segment to one weight a segment."""

from __future__ import annotations

from itertools import pairwise, zip_longest

import torch
from torch import nn
from torch.nn import functional

from tomo.wernet.convolution import packed_convolution, seeded_convolution
from tomo.wernet.paper.activation import SLOPE, normalised_rectified, rectified
from tomo.wernet.settings import VARIANTS


class _MaskedBatchNorm(nn.Module):
    """Batch normalisation over segments alone, of (rays, channels, width) or (rows, channels).

    Ordinary batch normalisation counts the padded zeros: mean and variance would then depend on
    how long the longest ray of the batch is. Running statistics are kept as PyTorch does it.
    """

    def __init__(self, channels: int, momentum: float = 0.1, epsilon: float = 1e-5):
        super().__init__()
        self.running_mean: torch.Tensor
        self.running_var: torch.Tensor
        self.momentum, self.epsilon = momentum, epsilon
        self.weight = nn.Parameter(torch.ones(channels))
        self.bias = nn.Parameter(torch.zeros(channels))
        self.register_buffer("running_mean", torch.zeros(channels))
        self.register_buffer("running_var", torch.ones(channels))

    def forward(self, x: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the normalised entries; what it gives in the padding is left to be masked."""
        others = [axis for axis in range(x.dim()) if axis != 1]
        column = (-1,) + (1,) * (x.dim() - 2)  # channels along axis 1
        if self.training:
            count = mask.sum()
            mean = (x * mask).sum(dim=others) / count
            x = x - mean.view(column)
            variance = (x.square() * mask).sum(dim=others) / count
            self._remember(mean, variance, count)
        else:
            x, variance = x - self.running_mean.view(column), self.running_var
        scale = self.weight * torch.rsqrt(variance + self.epsilon)
        return torch.addcmul(self.bias.view(column), x, scale.view(column))

    def rectified(
        self, rows: torch.Tensor, mask: torch.Tensor, empty: torch.Tensor
    ) -> torch.Tensor:
        """Return packed rows normalised, then as `tomo.wernet.paper.activation.rectified` does."""
        if not self.training:
            return rectified(self(rows, mask), empty)
        out, mean, variance = normalised_rectified(
            rows, self.weight, self.bias, empty, self.epsilon
        )
        self._remember(mean, variance, mask.sum())
        return out

    @torch.no_grad()
    def _remember(self, mean: torch.Tensor, variance: torch.Tensor, count: torch.Tensor) -> None:
        unbiased = variance * (count / (count - 1).clamp(min=1))
        self.running_mean.lerp_(mean, self.momentum)
        self.running_var.lerp_(unbiased, self.momentum)


class WeightEncoder(nn.Module):
    """1-D convolutions along the ray: six numbers in, one weight >= 0 for every segment out.

    ``blocks`` times (convolution, normalisation, Leaky ReLU, mask), then a convolution to one
    channel, squared. Convolutions have kernel 3 and padding 1, so ``N`` segments stay ``N``.

    Parameters
    ----------
    variant : {"batch-norm", "bias-mask", "no-bias"}
        Batch normalisation, a bias or nothing between a convolution and its Leaky ReLU. The last
        convolution has a bias except with "no-bias".
    blocks : int
        Number of hidden blocks.
    channels : int
        Channels of the hidden blocks (the paper: 32).
    seed : int
        Seed of the initial weights (PyTorch's uniform distribution for convolutions). The global
        random state is neither read nor changed.

    Notes
    -----
    All variants are masked after every layer. For "bias-mask" the paper says so. "no-bias" would
    keep an all-zero column zero, but a kernel of three carries the last segment one column into
    the padding at every layer, and back at the next; "batch-norm" shifts the padding like
    everything else. Masked, a ray's weights do not depend on the rays it shares a batch with
    (batch statistics aside).
    """

    def __init__(
        self,
        variant: str = "batch-norm",
        *,
        blocks: int = 3,
        channels: int = 32,
        seed: int = 0,
    ):
        super().__init__()
        if variant not in VARIANTS:
            raise ValueError(f"variant: found {variant!r}, expected one of {', '.join(VARIANTS)}")
        for name, found in (("blocks", blocks), ("channels", channels)):
            if found < 1 or found != int(found):
                raise ValueError(f"{name}: found {found}, expected a whole number >= 1")
        self.variant, self.blocks, self.channels = variant, int(blocks), int(channels)
        generator = torch.Generator().manual_seed(seed)
        widths = [6] + [self.channels] * self.blocks
        self.hidden = nn.ModuleList(
            seeded_convolution(before, after, variant == "bias-mask", generator)
            for before, after in pairwise(widths)
        )
        self.norms = nn.ModuleList(
            _MaskedBatchNorm(width) for width in widths[1:] if variant == "batch-norm"
        )
        self.last = seeded_convolution(widths[-1], 1, variant != "no-bias", generator)

    @property
    def settings(self) -> dict[str, int | str]:
        """The arguments that build an encoder of this shape."""
        return {"variant": self.variant, "blocks": self.blocks, "channels": self.channels}

    def forward(self, features: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the weights: at least zero, zero where ``mask`` is zero.

        Rays come padded or packed (`tomo.wernet.packing`); the weights are the same, and packed
        ones take half the arithmetic.

        Parameters
        ----------
        features : (rays, 6, N) or (rows, 6) float
        mask : (rays, 1, N) or (rows, 1) float
            One on a segment, zero on the padding or in an empty row.

        Returns
        -------
        (rays, N) or (rows,) float
        """
        last = self._padded if features.dim() == 3 else self._packed
        return (last(features, mask) * mask).square()[:, 0]

    def _padded(self, x: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return what the last convolution gives, ``(rays, 1, N)``: the slow twin."""
        for i, layer in enumerate(self.hidden):
            x = layer(x)
            if self.variant == "batch-norm":
                x = self.norms[i](x, mask)
            x = functional.leaky_relu(x, SLOPE) * mask
        return self.last(x)

    def _packed(self, x: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return what the last convolution gives, ``(rows, 1)``."""
        empty = (mask[:, 0] == 0).nonzero()[:, 0]
        for layer, norm in zip_longest(self.hidden, self.norms):
            x = packed_convolution(x, *layer.parameters())
            if isinstance(norm, _MaskedBatchNorm):
                x = norm.rectified(x, mask, empty)
            else:
                x = rectified(x, empty)
        return packed_convolution(x, *self.last.parameters())

    @property
    def couples_rays(self) -> bool:
        """Whether a ray's weights depend on its batch: the statistics of batch normalisation."""
        return self.variant == "batch-norm" and self.training
