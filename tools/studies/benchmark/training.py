"""What packing and skipping save, and a GPU, when WERNet is trained as its paper has it.

The jet seen by 33 views. The plain form is what one writes first in PyTorch: every ray padded to
the longest of its step, `torch.nn.Conv1d`, one loss. A form is timed in some steps of about 3200
rays, the same ones for each but for those skipped, in turn; medians. An epoch is that times all
its rays over those timed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from studies.benchmark.sizes import SIZES
from studies.common.flames import Scene, scene
from studies.common.scans import Problem, problem
from studies.common.study import Request, Tables
from studies.common.timing import in_turn
from tomo.wernet import Encoder, PaperSettings, RayFeatures, Rays, WERNet
from tomo.wernet.training import JointTraining, part_map

FORMS = tuple((form, skip, "cpu") for form in ("plain", "packed") for skip in (False, True))
"""How rays lie in memory, whether dark pixels and voxels are skipped, and where training runs; the
plain form first."""

ELSEWHERE = ("packed", True, "cuda")  # timed as well where PyTorch has such a device
VARIANTS = ("batch-norm", "bias-mask")
RAYS_A_STEP = 3200  # the paper's 32 samples of 100
SEED = 1


def run(request: Request) -> Tables:
    """Return a row for each encoder and form."""
    sizes = SIZES[request.size]
    seen = scene("jet", 33, "clean", SEED, sizes.flame)
    (every, pixels), (lit, lit_pixels) = (problem_of(seen, skip) for skip in (False, True))
    crossing = np.flatnonzero(every.system.projector.row_sums > 0)
    random = np.random.default_rng(SEED)
    drawn = random.permutation(crossing)[: sizes.training_steps * RAYS_A_STEP]
    kept = random.permutation(np.flatnonzero(np.isin(lit_pixels, pixels[drawn])))
    work = {False: (every, torch.from_numpy(drawn)), True: (lit, torch.from_numpy(kept))}
    rows: list[dict[str, Any]] = []
    for variant in request.each(VARIANTS, str):
        rows += _compared(variant, work, sizes.repeats)
    return {"training": rows}


def problem_of(seen: Scene, skip: bool) -> tuple[Problem, NDArray[np.int64]]:
    """Return a scene's equations, and which of all pixels each of their rows is."""
    ready = problem(seen.scan.rig, seen.scan.grid, seen.images, skip=skip, midpoints=True)
    first = np.cumsum([0, *(image.size for image in seen.images)])
    views = zip(first, ready.system.pixels, strict=False)
    return ready, np.concatenate([start + pixels for start, pixels in views])


def forms() -> tuple[tuple[str, bool, str], ...]:
    """Return `FORMS`, and `ELSEWHERE` where there is such a device."""
    return (*FORMS, ELSEWHERE) if torch.cuda.is_available() else FORMS


def _compared(
    variant: str, work: Mapping[bool, tuple[Problem, torch.Tensor]], repeats: int
) -> list[dict[str, Any]]:
    trainers = {
        form: (plain_trainer if form[0] == "plain" else _trainer)(variant, form[2], *work[form[1]])
        for form in forms()
    }
    seconds = in_turn(trainers, repeats)
    rows = []
    for form, taken in seconds.items():
        layout, skip, device = form
        ready, numbers = work[skip]
        projector = ready.system.projector
        rays = int(np.count_nonzero(projector.row_sums > 0))
        rows.append({
            "variant": variant, "layout": layout, "skip": skip, "device": device, "rays": rays,
            "segments": projector.n_segments, "timed_rays": len(numbers), "seconds": taken,
            "epoch_seconds": taken * rays / len(numbers),
        })  # fmt: skip
    first = rows[0]["epoch_seconds"]
    return [row | {"times_faster": first / row["epoch_seconds"]} for row in rows]


def _trainer(
    variant: str, device: str, ready: Problem, numbers: torch.Tensor
) -> Callable[[], float]:
    """Return what takes the steps, as training does; each call goes on from the one before."""
    place = torch.device(device)
    rays = Rays.of(ready.system.projector, "absolute", device=place)
    encoder = Encoder("absolute", variant=variant, blocks=3, channels=32, seed=SEED)
    voxels = torch.rand(1, rays.unknowns, generator=torch.Generator().manual_seed(SEED))
    model = WERNet(0.1 * voxels, encoder, anchored=False, normalise_gradient=True).to(place)
    settings = PaperSettings(rays_per_step=RAYS_A_STEP, encoder_learning_rate=0.0005)
    measured = (ready.measured / ready.measured.max()).astype(np.float64)[None]
    order = torch.Generator().manual_seed(SEED)
    training = JointTraining(model.train(), encoder, rays, measured, settings, True, order)

    def train() -> float:
        with part_map(place) as map_parts:
            return training.use(numbers, map_parts)

    return train


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
