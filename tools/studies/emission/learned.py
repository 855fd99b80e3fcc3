"""Two fields fitted to images in torch through the project's exact, differentiable rays.

Both are evaluated at the centres of the voxels that dark pixels leave, and learn by Adam from all
pixels at once; their volume is what they give there.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from studies.common.scans import problem
from studies.emission.course import Course
from studies.emission.scenes import Seen
from tomo.wernet import project

STEPS, JUDGED = 300, 10  # steps of Adam at the most, and from one judgement to the next


class NeuralField(nn.Module):
    """Emission by a network of random Fourier features of the position.

    Tancik et al., Fourier features let networks learn high frequency functions (2020); three
    layers of 64, as NeRF's in small.
    """

    def __init__(self, points: torch.Tensor, frequency: float) -> None:
        super().__init__()
        angles = points @ (frequency * torch.randn(3, 48))  # (voxels, 48)
        self.register_buffer("features", torch.cat([angles.sin(), angles.cos()], dim=1))
        layers = [nn.Linear(96, 64), nn.ReLU(), nn.Linear(64, 64), nn.ReLU(), nn.Linear(64, 1)]
        self.layers = nn.Sequential(*layers)

    def forward(self) -> torch.Tensor:
        """Return the emission ``(voxels,)`` before it is made positive."""
        return self.layers(self.features)[:, 0]


class PlaneField(nn.Module):
    """Emission as a sum of products of planes and lines of features.

    Chen et al., TensoRF (2022): vector-matrix decomposition, 12 components along each axis; a
    feature is interpolated linearly between nodes, a voxel and a half apart.
    """

    def __init__(self, points: torch.Tensor, shape: tuple[int, ...], components: int = 12) -> None:
        super().__init__()
        nodes = [max(4, round(n / 1.5)) for n in shape]
        self.planes, self.lines, self.places = nn.ParameterList(), nn.ParameterList(), []
        for axis in range(3):
            a, b = (other for other in range(3) if other != axis)
            self.planes.append(0.1 * torch.randn(1, components, nodes[a], nodes[b]))
            self.lines.append(0.1 * torch.randn(1, components, nodes[axis], 1))
            line = torch.stack([torch.zeros(len(points)), points[:, axis]], dim=1)
            self.places.append((points[:, [b, a]][None, None], line[None, None]))

    def forward(self) -> torch.Tensor:
        """Return the emission ``(voxels,)`` before it is made positive."""
        found = []
        for plane, line, (on_plane, on_line) in zip(
            self.planes, self.lines, self.places, strict=True
        ):
            a, b = (
                functional.grid_sample(one, where, align_corners=True)[0, :, 0]
                for one, where in ((plane, on_plane), (line, on_line))
            )  # (components, voxels) each
            found.append((a * b).sum(dim=0))
        return sum(found)

    def roughness(self) -> torch.Tensor:
        """Return the total variation of the planes."""
        return sum(p.diff(dim=axis).abs().mean() for p in self.planes for axis in (2, 3))


def fit(
    course: Course, seen: Seen, *, rate: float, frequency: float = 0.0, roughness: float = 0.0
) -> None:
    """Fit a field, neural where ``frequency`` is above 0; judge it every few steps."""
    torch.manual_seed(seen.emission.seed)
    ready = problem(seen.rig, seen.grid, list(seen.images), skip=True)
    operator, measured = ready.system.projector, torch.as_tensor(ready.measured)
    active, shape = operator.active, np.array(seen.grid.shape)
    at = np.stack(np.unravel_index(active.index, seen.grid.shape), axis=1)
    points = torch.as_tensor(2 * at / (shape - 1) - 1, dtype=torch.float32)  # (voxels, 3), -1 to 1
    model: nn.Module = (
        NeuralField(points, frequency) if frequency else PlaneField(points, seen.grid.shape)
    )
    mean = float(measured.sum() / project(torch.ones(len(points)), operator).sum())
    optimiser = torch.optim.Adam(model.parameters(), lr=rate)
    for step in range(STEPS):
        for group in optimiser.param_groups:
            group["lr"] = rate * 0.5 * (1 + math.cos(math.pi * step / STEPS))
        emission = mean * functional.softplus(2 * model()) / math.log(2)
        residual = (project(emission, operator) - measured) / (mean * max(shape))
        loss = residual.square().mean()
        if roughness:
            loss = loss + roughness * model.roughness()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        if step % JUDGED == 0 and course.judge(active.expand(emission.detach().numpy())):
            break
