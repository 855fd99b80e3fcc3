"""The default encoder: how much each ray-voxel weight differs from the chord length."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

from tomo.wernet.convolution import packed_convolution
from tomo.wernet.default.ray_features import NAMES, TRENDS
from tomo.wernet.paper.encoder import convolution

SLOPE = 0.01  # of the Leaky ReLU below zero


class CorrectionEncoder(nn.Module):
    """Convolutions along the ray from a segment's features to its correction ``c``.

    The weight is ``length (1 + c)²``. A new encoder gives zero everywhere: the chord lengths.

    Parameters
    ----------
    blocks, channels : int
        Hidden convolutions of kernel three, and their width.
    seed : int
        Of the initial weights; the global random state is neither read nor changed.
    """

    def __init__(self, *, blocks: int = 2, channels: int = 16, seed: int = 0):
        super().__init__()
        for name, found in (("blocks", blocks), ("channels", channels)):
            if found < 1 or found != int(found):
                raise ValueError(f"{name}: found {found}, expected a whole number >= 1")
        self.blocks, self.channels = int(blocks), int(channels)
        generator = torch.Generator().manual_seed(seed)
        widths = [len(NAMES)] + [self.channels] * self.blocks
        self.hidden = nn.ModuleList(
            convolution(before, after, True, generator) for before, after in pairwise(widths)
        )
        self.last = convolution(widths[-1], 1, True, generator)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)

    @property
    def settings(self) -> dict[str, int]:
        """What it takes to build it again."""
        return {"blocks": self.blocks, "channels": self.channels}

    @property
    def is_zero(self) -> bool:
        """Whether it gives no correction whatever it sees, as it does until it is trained."""
        return not (self.last.weight.any() or self.last.bias.any())

    def look_at(self, names: Sequence[str]) -> None:
        """Hide all features but these: their weights are zero, and stay so while it is trained.

        A copy does not see them either, but may be trained to.

        Parameters
        ----------
        names : sequence of str
            Of `tomo.wernet.default.ray_features.NAMES`.
        """
        hidden = [number for number, name in enumerate(NAMES) if name not in names]
        weight = self.hidden[0].weight
        with torch.no_grad():
            weight[:, hidden] = 0

        def hide(gradient: torch.Tensor) -> torch.Tensor:
            places = torch.tensor(hidden, dtype=torch.int64, device=gradient.device)
            return gradient.index_fill(1, places, 0)

        weight.register_hook(hide)

    def forward(
        self,
        features: torch.Tensor,
        inside: torch.Tensor,
        token: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Return the correction in every row, ``(rows,)``; what empty rows hold means nothing.

        Parameters
        ----------
        features : (rows, 13) float
            Of packed rays, see `tomo.wernet.default.ray_features`.
        inside : (rows, 1) float
            One on a segment, zero in an empty row.
        token : (rows, channels) float, optional
            What is particular to the row's view; added to the first layer.
        """
        x = features
        for number, layer in enumerate(self.hidden):
            x = packed_convolution(x, layer.weight, layer.bias)
            if number == 0 and token is not None:
                x = x + token
            x = functional.leaky_relu(x, SLOPE) * inside
        return packed_convolution(x, self.last.weight, self.last.bias)[:, 0]


class ViewTokens(nn.Module):
    """What is particular to a scene: trends along its rays, and each view's own numbers.

    ``trend`` multiplies the features `tomo.wernet.default.ray_features.TRENDS` and ``level``
    belongs to a view; both are exponents of a factor, see
    `tomo.wernet.default.ray_weights.correction_of`. ``hidden`` is added to the first layer of the
    encoder. All are zero at first. A view that was not trained with takes the mean of those that
    were.

    Parameters
    ----------
    views, channels : int
    """

    def __init__(self, views: int, channels: int):
        super().__init__()
        self.hidden = nn.Parameter(torch.zeros(views, channels))
        self.level = nn.Parameter(torch.zeros(views))
        self.trend = nn.Parameter(torch.zeros(len(TRENDS)))

    def take(self, other: ViewTokens) -> None:
        """Take up the levels and trends of other tokens of the same views."""
        with torch.no_grad():
            self.level.copy_(other.level)
            self.trend.copy_(other.trend)

    def mean(self, views: int) -> ViewTokens:
        """Return the tokens of ``views`` other views of the same rig."""
        other = ViewTokens(views, self.hidden.shape[1]).to(self.level.device)
        with torch.no_grad():
            other.hidden.copy_(self.hidden.mean(dim=0).expand_as(other.hidden))
            other.level.copy_(self.level.mean().expand_as(other.level))
            other.trend.copy_(self.trend)
        return other
