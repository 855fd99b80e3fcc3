"""The encoder: convolutions along a ray, from what is seen of its segments to one number each."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, zip_longest
from typing import Any

import torch
from torch import nn
from torch.nn import functional

from tomo.wernet.features import INPUTS, OPTICS
from tomo.wernet.settings import VARIANTS

ROWS = 512
"""Rows are padded to a multiple of it. PyTorch prepares a convolution anew for every number of
rows, which takes as long as the convolution. Larger: empty rows. Smaller: more preparations."""


class Encoder(nn.Module):
    """1-D convolutions along the ray: the features of its segments in, one number each out.

    ``blocks`` times (convolution of kernel three, normalisation, Leaky ReLU, mask), then a
    convolution to one channel. A convolution of all packed rays is one of a picture of a single
    row, its channels last: PyTorch's fastest form of it on a CPU.

    Parameters
    ----------
    inputs : {"absolute", "relative", "optics"}
        What it sees, see `tomo.wernet.features.RayFeatures`.
    variant : {"batch-norm", "bias-mask", "no-bias"}
        Batch normalisation, a bias or nothing between a convolution and its Leaky ReLU. The last
        convolution has a bias except with "no-bias".
    blocks, channels : int
        Hidden blocks, and their width.
    last_bias : float, optional
        First bias of the last convolution; PyTorch's small random one when None.
    silent : bool
        Whether a new encoder gives zero everywhere: its last convolution starts at zero.
    shown : sequence of str, optional
        The features of "optics" that it sees; the others are zero to it. All when None.
    seed : int
        Seed of the initial weights (PyTorch's uniform distribution for convolutions). The global
        random state is neither read nor changed.

    Raises
    ------
    ValueError
        If a name is unknown, or a number is not a whole one above zero.

    Notes
    -----
    All variants are masked after every layer. For "bias-mask" the paper says so. "no-bias" would
    keep an all-zero row zero, but a kernel of three carries the last segment one row further at
    every layer, and back at the next; "batch-norm" shifts empty rows like everything else. Masked,
    what a ray gets does not depend on the rays it shares a batch with (batch statistics aside).
    """

    def __init__(
        self,
        inputs: str = "optics",
        *,
        variant: str = "bias-mask",
        blocks: int = 2,
        channels: int = 16,
        last_bias: float | None = None,
        silent: bool = False,
        shown: Sequence[str] | None = None,
        seed: int = 0,
    ):
        super().__init__()
        for name, found, known in (("inputs", inputs, INPUTS), ("variant", variant, VARIANTS)):
            if found not in known:
                raise ValueError(f"{name}: found {found!r}, expected one of {', '.join(known)}")
        for name, number in (("blocks", blocks), ("channels", channels)):
            if number < 1 or number != int(number):
                raise ValueError(f"{name}: found {number}, expected a whole number >= 1")
        if shown is not None and (inputs != "optics" or not set(shown) <= set(OPTICS)):
            raise ValueError(f"shown: found {list(shown)}, expected features of 'optics'")
        self.inputs, self.variant = inputs, variant
        self.blocks, self.channels = int(blocks), int(channels)
        self.shown: tuple[str, ...] | None = None
        self.visible: torch.Tensor
        self.register_buffer("visible", torch.ones(INPUTS[inputs]), persistent=False)
        if shown is not None:
            self.show_only(shown)
        generator = torch.Generator().manual_seed(seed)
        widths = [INPUTS[inputs]] + [self.channels] * self.blocks
        self.hidden = nn.ModuleList(
            _convolution(before, after, variant == "bias-mask", generator)
            for before, after in pairwise(widths)
        )
        self.norms = nn.ModuleList(
            MaskedBatchNorm(width) for width in widths[1:] if variant == "batch-norm"
        )
        self.last = _convolution(widths[-1], 1, variant != "no-bias", generator)
        if silent:
            for parameter in self.last.parameters():
                nn.init.zeros_(parameter)
        if last_bias is not None and self.last.bias is not None:
            nn.init.constant_(self.last.bias, last_bias)

    def show_only(self, names: Sequence[str]) -> None:
        """Let it see these features of "optics" alone; the others are zero to it."""
        self.shown = None if len(names) == len(OPTICS) else tuple(names)
        self.visible.copy_(torch.tensor([float(name in names) for name in OPTICS]))

    @property
    def settings(self) -> dict[str, Any]:
        """The arguments that build an encoder of this shape."""
        names = ("inputs", "variant", "blocks", "channels", "shown")
        return {name: getattr(self, name) for name in names}

    @property
    def couples_rays(self) -> bool:
        """Whether a ray's numbers depend on its batch: the statistics of batch normalisation."""
        return self.variant == "batch-norm" and self.training

    def forward(self, features: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return a number of every row, ``(rows,)``, zero in the empty ones.

        ``features`` (rows, F) are those of packed rays (`tomo.wernet.rays.RayBatch`);
        ``mask`` (rows, 1) is one on a segment, zero in an empty row.
        """
        n_rows, padding = len(mask), (0, 0, 0, -len(mask) % ROWS)
        x = features if self.shown is None else features * self.visible
        x, mask = functional.pad(x, padding), functional.pad(mask, padding)
        for layer, norm in zip_longest(self.hidden, self.norms):
            x = layer(x)
            if isinstance(norm, MaskedBatchNorm):
                x = norm(x, mask)
            x = functional.leaky_relu(x) * mask  # the paper names no slope
        return (self.last(x) * mask)[:n_rows, 0]


class MaskedBatchNorm(nn.Module):
    """Batch normalisation over the rows of segments alone.

    Ordinary batch normalisation counts the empty rows: mean and variance would then depend on how
    many rays the batch has. Running statistics are kept as PyTorch does it.
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
        """Return the normalised rows ``(rows, C)``; the empty ones are left to be masked."""
        mean, variance = self.running_mean, self.running_var
        if self.training:
            inside, count = mask[:, 0], mask.sum()
            mean = (inside @ x) / count
            variance = (inside @ (x - mean).square()) / count
            with torch.no_grad():
                unbiased = variance * (count / (count - 1).clamp(min=1))
                self.running_mean.lerp_(mean.to(self.running_mean.dtype), self.momentum)
                self.running_var.lerp_(unbiased.to(self.running_var.dtype), self.momentum)
        scale = self.weight * torch.rsqrt(variance + self.epsilon)
        return torch.addcmul(self.bias - mean * scale, x, scale)


class _AlongRays(nn.Conv2d):
    """A convolution of packed rows ``(rows, C)``, as of a picture of one row, channels last."""

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        picture = rows.T.unsqueeze(0).unsqueeze(2)
        # Not kept in this order: `torch.optim.LBFGS` takes gradients in the plain one alone.
        weight = self.weight.contiguous(memory_format=torch.channels_last)
        found = functional.conv2d(picture, weight, self.bias, padding=self.padding)
        return found.squeeze(2).squeeze(0).T


def _convolution(inputs: int, outputs: int, bias: bool, generator: torch.Generator) -> nn.Conv2d:
    """Return a convolution of kernel three with PyTorch's uniform initial weights, seeded."""
    # skip_init: the ordinary constructor draws from the global random state.
    layer = nn.utils.skip_init(_AlongRays, inputs, outputs, (1, 3), padding=(0, 1), bias=bias)
    bound = (3 * inputs) ** -0.5
    for parameter in layer.parameters():
        nn.init.uniform_(parameter, -bound, bound, generator=generator)
    return layer
