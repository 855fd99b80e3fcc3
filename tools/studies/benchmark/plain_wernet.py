"""The published network as one writes it first in PyTorch: a yardstick, not the library's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from studies.common.problems import Problem
from tomo.wernet import RayFeatures

RAYS_A_STEP, SEED = 3200, 1


class PlainWERNet(nn.Module):
    """Voxels, and an encoder of padded rays by `torch.nn.Conv1d`."""

    def __init__(self, n_voxels: int, variant: str):
        super().__init__()
        self.voxels = nn.Parameter(0.1 * torch.rand(n_voxels))
        layers: list[nn.Module] = []
        for width in (6, 32, 32):
            layers.append(nn.Conv1d(width, 32, 3, padding=1, bias=variant == "bias-mask"))
            layers.append(nn.BatchNorm1d(32) if variant == "batch-norm" else nn.Identity())
        self.layers, self.last = nn.ModuleList(layers), nn.Conv1d(32, 1, 3, padding=1)

    def forward(self, x: torch.Tensor, mask: torch.Tensor, voxel: torch.Tensor) -> torch.Tensor:
        """Return (rays,) pixels of features (rays, 6, N), mask (rays, 1, N), voxel (rays, N)."""
        for number in range(0, len(self.layers), 2):
            x = self.layers[number + 1](self.layers[number](x))
            x = functional.leaky_relu(x, 0.01) * mask
        weights = (self.last(x) * mask).square()[:, 0]
        return (weights * self.voxels[voxel]).sum(dim=1)


def plain_trainer(
    variant: str, device: str, ready: Problem, numbers: torch.Tensor
) -> Callable[[], float]:
    """Return what takes steps of padded rays; each call goes on from the one before."""
    projector = ready.system.projector
    segments = projector.segments
    features = RayFeatures.of(projector, "absolute").of_segment
    start, count = (torch.from_numpy(np.asarray(each, np.int64))
                    for each in (segments.ptr[:-1], np.diff(segments.ptr)))  # fmt: skip
    voxel = torch.from_numpy(segments.voxel.astype(np.int64))
    measured = torch.from_numpy((ready.measured / ready.measured.max()).astype(np.float32))
    torch.manual_seed(SEED)
    model = PlainWERNet(projector.shape[1], variant)
    optimiser = torch.optim.Adam(model.parameters(), lr=0.0005)

    def train() -> float:
        total = 0.0
        for rays in numbers.split(RAYS_A_STEP):
            column = torch.arange(int(count[rays].max()))
            inside = column < count[rays, None]
            segment = start[rays, None] + torch.minimum(column, count[rays, None] - 1)
            mask = inside[:, None].float()
            pixels = model(features[segment].transpose(1, 2) * mask, mask, voxel[segment])
            loss = (pixels - measured[rays]).square().mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            total += loss.item() * len(rays)
        return total

    return train
