"""Training step by step: what `wernet_paper` does not tell, and readings that it does not know."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from _paper.cases import SEED, Case
from tomo.wernet.paper import RaySamples, WeightEncoder, WERNet, epoch_batches

if TYPE_CHECKING:
    from _paper.training import Reading

_HALVE_EVERY = 5
_RAYS = 100


class Step(NamedTuple):
    """One step of the optimiser.

    Attributes
    ----------
    epoch : int
    ends_epoch : bool
        Whether it is the last of its epoch.
    loss : float
        Of the step's rays before the step, the measurement scaled to a maximum of one.
    squared_error : float
        Of their predictions then, summed.
    model : WERNet
        After the step.
    """

    epoch: int
    ends_epoch: bool
    loss: float
    squared_error: float
    model: WERNet


def steps(seen: Case, reading: Reading, encoder: WeightEncoder) -> Iterator[Step]:
    """Train without end, ``encoder`` in place; yield after every step.

    With a reading that `tomo.wernet.paper.wernet_paper` knows the steps are the same as there.
    """
    projector = seen.system.projector
    measured = seen.measured / float(seen.measured.max())
    samples = RaySamples.from_segments(
        projector.segments,
        projector.grid,
        measured,
        active=projector.active,
        inputs="relative" if reading.inputs == "relative" else "absolute",
    )
    if reading.inputs == "unscaled":
        samples = replace(
            samples, index=samples.index * samples.half, midpoint=samples.midpoint * samples.half
        )
    generator = torch.Generator().manual_seed(SEED)
    random = torch.rand(projector.active.size, generator=generator)
    voxels = reading.first_voxels * random * samples.crossed()
    by_ray = reading.normalise_gradient and reading.norm == "ray"
    by_batch = reading.normalise_gradient and reading.norm == "batch"
    model = WERNet(encoder, voxels, by_ray)
    norms = _NormOfWeights(encoder) if by_batch else None
    optimiser = torch.optim.Adam(
        [
            {"params": [model.voxels], "lr": reading.voxel_learning_rate},
            {"params": encoder.parameters(), "lr": reading.encoder_learning_rate},
        ]
    )
    schedule = torch.optim.lr_scheduler.StepLR(optimiser, _HALVE_EVERY, gamma=0.5)
    size = reading.samples_per_batch
    for epoch in count(1):
        batches = list(epoch_batches(len(samples), size, _RAYS, generator))
        for number, rays in enumerate(batches, 1):
            batch = samples.packed(rays)
            error = model(batch) - batch.measured
            loss = error.abs().mean() if reading.loss == "absolute" else error.square().mean()
            optimiser.zero_grad()
            loss.backward()
            if norms is not None:
                model.voxels.grad /= norms.last
            optimiser.step()
            with torch.no_grad():
                model.voxels.clamp_(min=0)
            squared = float(error.detach().square().sum())
            yield Step(epoch, number == len(batches), loss.item(), squared, model)
        schedule.step()


def epochs(
    seen: Case, reading: Reading, encoder: WeightEncoder, total: int
) -> Iterator[tuple[int, NDArray[np.float32], float]]:
    """Train for ``total`` epochs; yield number, active voxels and relative residual of each.

    The voxels are in the images' units, at the scale at which their chord lengths' projection
    best fits the images.
    """
    projector = seen.system.projector
    seen_at_all = np.diff(projector.segments.ptr) > 0
    norm = np.linalg.norm(seen.measured[seen_at_all] / float(seen.measured.max()))
    squared_error = 0.0
    for step in steps(seen, reading, encoder):
        squared_error += step.squared_error
        if step.ends_epoch:
            voxels = step.model.voxels.detach().numpy()
            projected = projector @ voxels
            scale = projected @ seen.measured / max(projected @ projected, 1e-30)
            yield step.epoch, voxels * np.float32(scale), squared_error**0.5 / norm
            squared_error = 0.0
            if step.epoch == total:
                return


class _NormOfWeights:
    """The norm of the weights that an encoder gave last, over all rays at once."""

    def __init__(self, encoder: WeightEncoder):
        self.last = 1.0
        encoder.register_forward_hook(self._keep)

    def _keep(self, _encoder: WeightEncoder, _inputs: tuple, weights: torch.Tensor) -> None:
        self.last = max(float(torch.linalg.vector_norm(weights.detach())), 1e-30)
