"""The encoder: convolutions along a ray, from features of its segments to corrections of these."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

from tomo.wernet.convolution import packed_convolution, seeded_convolution
from tomo.wernet.default.ray_features import FEATURES

SLOPE = 0.01  # of the Leaky ReLU below zero


class CorrectionEncoder(nn.Module):
    """Convolutions along the ray from the features of its segments to their corrections.

    A new encoder gives zero everywhere: the weights are the segment lengths.

    Parameters
    ----------
    blocks, channels : int
        Hidden convolutions of kernel three, and their width.
    seed : int
        Seed of the initial weights; the global random state is neither read nor changed.

    Raises
    ------
    ValueError
        If ``blocks`` or ``channels`` is not a whole number above zero.
    """

    def __init__(self, *, blocks: int = 2, channels: int = 16, seed: int = 0):
        super().__init__()
        for name, found in (("blocks", blocks), ("channels", channels)):
            if found < 1 or found != int(found):
                raise ValueError(f"{name}: found {found}, expected a whole number >= 1")
        self.blocks, self.channels = int(blocks), int(channels)
        generator = torch.Generator().manual_seed(seed)
        widths = [len(FEATURES)] + [self.channels] * self.blocks
        self.hidden = nn.ModuleList(
            seeded_convolution(before, after, True, generator)
            for before, after in pairwise(widths)
        )
        self.last = seeded_convolution(widths[-1], 1, True, generator)
        for parameter in self.last.parameters():
            nn.init.zeros_(parameter)

    @property
    def settings(self) -> dict[str, int]:
        """The arguments that build an encoder of this shape."""
        return {"blocks": self.blocks, "channels": self.channels}

    def show_only(self, names: Sequence[str]) -> None:
        """Hide all features but these: their weights are set to zero and not trained.

        A copy of the encoder starts from the zeros, but trains them.

        Parameters
        ----------
        names : sequence of str
            Some of `tomo.wernet.default.ray_features.FEATURES`.
        """
        hidden = [number for number, name in enumerate(FEATURES) if name not in names]
        weight, _ = self.hidden[0].parameters()
        with torch.no_grad():
            weight[:, hidden] = 0

        def hide(gradient: torch.Tensor) -> torch.Tensor:
            columns = torch.tensor(hidden, dtype=torch.int64, device=gradient.device)
            return gradient.index_fill(1, columns, 0)

        weight.register_hook(hide)

    def forward(self, features: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the correction in every row, ``(rows,)``; empty rows hold arbitrary numbers.

        Parameters
        ----------
        features : (rows, features) float
            Features of packed rays, see `tomo.wernet.default.ray_features`.
        mask : (rows, 1) float
            One on a segment, zero in an empty row.
        """
        x = features
        for layer in self.hidden:
            x = functional.leaky_relu(packed_convolution(x, *layer.parameters()), SLOPE) * mask
        return packed_convolution(x, *self.last.parameters())[:, 0]
