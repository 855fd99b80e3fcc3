"""One epoch of training: every ray used once, some at a time, by any optimiser."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch

from tomo.wernet.micro_batches import ChunkMap, micro_batches, set_summed_gradients
from tomo.wernet.paper.model import WERNet
from tomo.wernet.paper.samples import PackedBatch, RaySamples, SampleBatch


def train_epoch(
    model: WERNet,
    samples: RaySamples,
    take: Callable[[torch.Tensor], PackedBatch | SampleBatch],
    batches: Iterator[torch.Tensor],
    optimiser: torch.optim.Optimizer,
    nonnegative: bool,
    map_chunks: ChunkMap,
    loss: str = "squared",
) -> float:
    """Use every ray once; return the relative residual of the predictions made on the way.

    At a loss that is not finite the epoch ends without that step, and the result is NaN.

    Parameters
    ----------
    model : WERNet
    samples : RaySamples
    take : callable
        ``samples.packed`` or ``samples.padded``.
    batches : iterator of (B,) int64
        The rays of each step.
    optimiser : torch.optim.Optimizer
        Its groups hold the parameters to train.
    nonnegative : bool
        Set negative voxels to zero after every step.
    map_chunks : ChunkMap
        See `tomo.wernet.micro_batches.chunk_map`.
    loss : {"squared", "absolute"}
        The mean error of a step's rays that is made small.
    """
    trained = [parameter for group in optimiser.param_groups for parameter in group["params"]]
    squared_error = 0.0
    for rays in batches:

        def of_rays(some: torch.Tensor, size: int = len(rays)) -> tuple[float, Sequence]:
            batch = take(some)
            errors = model(batch) - batch.measured
            squares = errors.square().sum()
            mean = (squares if loss == "squared" else errors.abs().sum()) / size
            return squares.item(), torch.autograd.grad(mean, trained)

        if model.encoder.couples_rays or take == samples.padded:
            done = [of_rays(rays)]
        else:
            chunks = [rays[chunk] for chunk in micro_batches(samples.count[rays])]
            done = map_chunks(of_rays, chunks)
        value = sum(squares for squares, _ in done)
        if not np.isfinite(value):
            return float("nan")
        set_summed_gradients(trained, [gradients for _, gradients in done])
        optimiser.step()
        if nonnegative:
            with torch.no_grad():
                model.voxels.clamp_(min=0)
        squared_error += value
    squared_norm = float(samples.measured.square().sum())
    return (squared_error / squared_norm) ** 0.5 if squared_norm > 0 else 0.0
