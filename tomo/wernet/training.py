"""Training: steps on some rays in parts that suit the device, epochs of voxels and encoder."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.solvers import Iteration
from tomo.wernet.encoder import Encoder
from tomo.wernet.model import WERNet
from tomo.wernet.rays import RayBatch, Rays
from tomo.wernet.settings import PaperSettings

CPU_SEGMENTS = 16384
"""Segments of a part on a CPU. More: 32 channels of them leave the core's cache. Fewer: the time
goes into starting operations."""

GPU_SEGMENTS = 1 << 20
"""Segments of a part elsewhere, some 2 GB of layers. More may not fit the device's memory; fewer
leave it idle."""

PartMap = Callable[[Callable[[RayBatch], Any], Iterable[RayBatch]], list]
"""Applies a function to every part and returns the results in the order of the parts."""


def usable_device(device: str | torch.device) -> torch.device:
    """Return the device, once a tensor has been made on it.

    Raises
    ------
    ValueError
        If PyTorch cannot use such a device here.
    """
    try:
        found = torch.device(device)
        torch.zeros(1, device=found).item()
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        raise ValueError(
            f"device: found {str(device)!r}, expected one that this PyTorch can use "
            f"(cpu, cuda, mps): {str(error).splitlines()[0]}"
        ) from error
    return found


@contextmanager
def part_map(device: torch.device) -> Iterator[PartMap]:
    """Give a map over parts of a batch that suits the device.

    On a CPU one thread computes each part, several parts at once, and what is between two steps: a
    sum of results in the order of the parts has the same bits for any number of threads. On
    another device parts follow one another.
    """
    if device.type != "cpu":
        yield lambda function, parts: [function(part) for part in parts]
        return
    threads = torch.get_num_threads()
    workers = max(min(threads, os.cpu_count() or 1), 1)
    with ThreadPoolExecutor(workers, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        torch.set_num_threads(1)
        try:
            yield lambda function, parts: list(pool.map(function, parts))
        finally:
            torch.set_num_threads(threads)


def parts_of(batch: RayBatch) -> Iterator[RayBatch]:
    """Yield a batch in parts of about as many segments as suit its device."""
    limit = CPU_SEGMENTS if batch.count.device.type == "cpu" else GPU_SEGMENTS
    if len(batch.voxel) <= limit:
        return iter([batch] if len(batch) else [])
    number = (batch.count.cpu().cumsum(0) - 1).clamp(min=0) // limit
    return batch.split(number.unique_consecutive(return_counts=True)[1].tolist())


def step(
    optimiser: torch.optim.Optimizer,
    parts: Iterable[RayBatch],
    loss_of: Callable[[RayBatch], tuple[torch.Tensor, torch.Tensor]],
    map_parts: PartMap,
) -> torch.Tensor:
    """Take a step down the sum of a loss over parts; return the sum of what is reported of it.

    ``loss_of`` returns the loss of a part, and what is to be reported of it.
    """
    trained = [one for group in optimiser.param_groups for one in group["params"]]

    def descend(part: RayBatch) -> tuple[torch.Tensor, Sequence[torch.Tensor]]:
        loss, reported = loss_of(part)
        return reported.detach(), torch.autograd.grad(loss, trained)

    reported, gradients = zip(*map_parts(descend, parts), strict=True)
    for parameter, each in zip(trained, zip(*gradients, strict=True), strict=True):
        parameter.grad = sum(each[1:], each[0])
    optimiser.step()
    return sum(reported[1:], reported[0])


def adam(groups: Iterable[dict[str, Any]], device: torch.device) -> torch.optim.Adam:
    """Return Adam over groups of parameters on a device.

    On CUDA the fused form is used: starting its operations one by one takes longer than they do.
    """
    return torch.optim.Adam(groups, fused=device.type == "cuda")


class TrainingDivergedError(FloatingPointError):
    """The loss was not a finite number before one epoch was done: there is no volume to keep."""


class JointTraining:
    """The paper's training of voxels and encoder: epochs of all rays, in a random order.

    ``measured`` (frames, pixels) have the largest value one. ``generator`` is that of the order,
    on the CPU, so that it does not depend on the device. A frozen encoder is not trained.
    """

    def __init__(
        self,
        model: WERNet,
        encoder: Encoder,
        rays: Rays,
        measured: NDArray[np.float64],
        settings: PaperSettings,
        nonnegative: bool,
        generator: torch.Generator,
    ) -> None:
        self.model, self.encoder, self.rays, self.settings = model, encoder, rays, settings
        self.nonnegative, self.generator = nonnegative, generator
        self.history: list[Iteration] = []
        place = model.voxels.device
        self.measured = torch.from_numpy(measured.astype(np.float32)).reshape(-1).to(place)
        frames = torch.arange(len(measured))[:, None] * len(rays)
        self.numbers = (frames + rays.crossing).reshape(-1)
        self.square = float(self.measured[self.numbers.to(place)].square().sum())
        groups: list[dict[str, Any]] = [
            {"params": [model.voxels], "lr": settings.voxel_learning_rate}
        ]
        trained = [one for one in encoder.parameters() if one.requires_grad]
        if trained:
            groups.append({"params": trained, "lr": settings.encoder_learning_rate})
        self.optimiser = adam(groups, place)
        halve = torch.optim.lr_scheduler.StepLR
        self.schedule = halve(self.optimiser, settings.halve_every, gamma=0.5)

    def run(
        self, epochs: int, began: float, after_epoch: Callable[[list[Iteration]], bool]
    ) -> str:
        """Train until some epochs are done; return why training ended.

        ``after_epoch(history)`` is called after each, and stops training by returning True.
        """
        self.model.train()
        with part_map(self.model.voxels.device) as map_parts:
            for epoch in range(len(self.history) + 1, epochs + 1):
                residual = self._epoch(map_parts)
                if not np.isfinite(residual) and epoch == 1:
                    raise TrainingDivergedError(
                        "wernet-paper: epoch 1: loss: found NaN or infinity, expected a finite "
                        "number; try smaller learning rates"
                    )
                if not np.isfinite(residual):
                    return f"diverged in epoch {epoch}; the volume is that of the epoch before"
                self.schedule.step()
                self.history.append(Iteration(epoch, residual, time.perf_counter() - began))
                if after_epoch(self.history):
                    return f"stopped by the callback after epoch {epoch}"
        return f"all {epochs} epochs done"

    def _epoch(self, map_parts: PartMap) -> float:
        """Use every ray once; return the relative residual of the predictions made on the way."""
        mixed = torch.randperm(len(self.numbers), generator=self.generator)
        error = self.use(self.numbers[mixed], map_parts)
        return (error / self.square) ** 0.5 if self.square > 0 else error

    def use(self, numbers: torch.Tensor, map_parts: PartMap) -> float:
        """Take steps on rays of these numbers, in this order; return their squared error."""
        squares = [self._step(parts, n_rays, map_parts) for parts, n_rays in self._steps(numbers)]
        return float(torch.stack(squares).sum())  # the one time that the host waits for a device

    def _steps(self, order: torch.Tensor) -> Iterator[tuple[Iterable[RayBatch], int]]:
        """Yield the parts and the number of rays of each step of an epoch.

        A device gets its epoch packed at once: nothing waits for the host between steps.
        """
        size = self.settings.rays_per_step
        apart = not self.encoder.couples_rays
        if self.model.voxels.device.type == "cpu":
            for some in order.split(size):
                batch = self.rays.take(some)
                yield (parts_of(batch) if apart else [batch]), len(some)
            return
        sizes = [len(some) for some in order.split(size)]
        for batch in self.rays.take(order).split(sizes):
            yield [batch], len(batch)

    def _step(self, parts: Iterable[RayBatch], n_rays: int, map_parts: PartMap) -> torch.Tensor:
        """Take one step; return the squared error of its predictions."""
        squared = self.settings.loss == "squared"

        def loss_of(part: RayBatch) -> tuple[torch.Tensor, torch.Tensor]:
            error = self.model(part) - self.measured[part.number]
            square = error.square().sum()
            return (square if squared else error.abs().sum()) / n_rays, square

        error = step(self.optimiser, parts, loss_of, map_parts)
        if self.nonnegative:
            with torch.no_grad():
                self.model.voxels.clamp_(min=0)
        return error

    def state_dict(self) -> dict[str, Any]:
        """Return the state to go on from, as tensors and plain values."""
        return {
            "model": self.model.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "schedule": self.schedule.state_dict(),
            "generator": self.generator.get_state(),
            "history": [(one.index, one.relative_residual, one.seconds) for one in self.history],
        }

    def load_state_dict(self, state: dict[str, Any] | None) -> None:
        """Go on from a state, if there is one."""
        if state is not None:
            self.model.load_state_dict(state["model"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.schedule.load_state_dict(state["schedule"])
            self.generator.set_state(state["generator"])
            self.history = [Iteration(*one) for one in state["history"]]
