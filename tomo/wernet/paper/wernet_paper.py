"""Training: the paper's method as a solver, from measured pixels to a volume."""

from __future__ import annotations

import copy
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from tomo.operators.vectors import additive_start
from tomo.solvers import Iteration, Solution
from tomo.solvers.solution import Callback
from tomo.wernet.device import adam, usable_device
from tomo.wernet.encoder_file import load_encoder
from tomo.wernet.micro_batches import on_cores
from tomo.wernet.paper.encoder import WeightEncoder
from tomo.wernet.paper.epoch import train_epoch
from tomo.wernet.paper.model import WERNet
from tomo.wernet.paper.samples import RaySamples, epoch_batches

if TYPE_CHECKING:
    from tomo.operators import Projector

LAYOUTS = ("packed", "padded")

# Upper end of the random initial voxels, the measurement's maximum being one. With 1 instead, the
# first predictions are several times too large and training ends much further from the truth.
_START = 0.1


class TrainingDivergedError(FloatingPointError):
    """The loss was not a finite number before one epoch was done: there is no volume to keep."""


def wernet_paper(
    projector: Projector,
    measured: ArrayLike,
    *,
    iterations: int = 80,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    callback: Callback | None = None,
    variant: str = "batch-norm",
    blocks: int = 3,
    normalise_gradient: bool = True,
    voxel_learning_rate: float = 0.01,
    encoder_learning_rate: float = 0.0005,
    halve_every: int = 5,
    samples_per_batch: int = 32,
    rays_per_sample: int = 100,
    inputs: str = "absolute",
    layout: str = "packed",
    encoder: str | Path | WeightEncoder | None = None,
    freeze_encoder: bool = False,
    device: str | torch.device = "cpu",
    seed: int = 0,
) -> Solution:
    """Reconstruct with WERNet as its paper gives it: voxels and their weights learnt together.

    The loss is ``mean over the batch's rays of (p - m)²`` with ``p = sum_j w_j x_j``: the weights
    ``w`` come from `WeightEncoder`, the voxels ``x`` are parameters. Adam trains both, each with
    its own learning rate, halved every ``halve_every`` epochs.

    Parameters
    ----------
    projector : Projector
        Its ``segments`` must have midpoints; its chord lengths only set the scale at the end.
    measured : (pixels,) float
        Finite projections.
    iterations : int
        Epochs: how often every ray is used.
    start : (voxels,) or (nx, ny, nz) float, optional
        Initial volume. None: small uniform random numbers from ``seed``, zero where no ray goes.
    nonnegative : bool
        Set negative voxels to zero after every step.
    callback : callable, optional
        ``callback(index, volume, relative_residual)`` after every epoch, ``volume`` the active
        voxels, flat float32 in the units of the result; returning True stops.
    variant, blocks
        Of the encoder, see `WeightEncoder`; unused when ``encoder`` is given.
    normalise_gradient : bool
        See `tomo.wernet.paper.weighted_sum`.
    voxel_learning_rate, encoder_learning_rate : float
        Of Adam in the first epochs, for a measurement scaled to a maximum of one.
    halve_every : int
        Epochs between two halvings of both learning rates.
    samples_per_batch, rays_per_sample : int
        Their product is the number of rays in one step.
    inputs : {"absolute", "relative"}
        What the encoder sees of a segment, see `tomo.wernet.paper.RaySamples`. The paper's are
        absolute.
    layout : {"packed", "padded"}
        How a batch's rays lie in memory: one behind another, or each padded to the longest, as in
        the paper, for comparison. The result is the same but for rounding.
    encoder : path or WeightEncoder, optional
        Start from this encoder: a file that `save_encoder` wrote, or one in memory, which is
        copied. A new one when None.
    freeze_encoder : bool
        Train the voxels alone with the encoder given, batch normalisation included at its running
        statistics.
    device : str or torch.device
        Where to train.
    seed : int
        Of the encoder's initial weights, of the initial voxels and of the order of the rays.

    Returns
    -------
    Solution
        One history entry an epoch. Its ``relative_residual`` is ``||p - m|| / ||m||`` over all
        rays that cross the grid, of the network's own predictions, each made just before the step
        that used it. ``encoder`` is the trained encoder, which `tomo.wernet.save_encoder` writes;
        None where training diverged.

    Raises
    ------
    ValueError
        For segments without midpoints, sizes that do not match, values that are not finite, or an
        unknown device or variant.
    TrainingDivergedError
        When the loss is not finite in the first epoch. In a later one training stops, and the
        result is the volume of the epoch before, as ``stop_reason`` says.

    Notes
    -----
    The paper's factorisation fixes no scale: weights times c and voxels divided by c predict the
    same. Two steps here are therefore ours, not the paper's. The measurement is divided by its
    maximum, so that the learning rates mean the same for every unit. And the voxels ``x`` are
    reported as ``s x`` with the chord-length matrix ``A``::

        s = <A x, m> / <A x, A x>

    the scale at which their ordinary projection best fits the measurement in least squares.
    A factor that varies in space is not undone by this: an encoder that sees absolute positions
    can hide one, with the loss still falling.

    On a CPU the result depends on the seed and, in its last bits, on `torch.get_num_threads`,
    which is left as it is. Other devices may add in another order every time.

    References
    ----------
    Pan, Li, Xu, arXiv 2010.00893.
    """
    began = time.perf_counter()
    settings = {
        "method": "wernet-paper",
        "iterations": iterations,
        "start": start is not None,
        "nonnegative": nonnegative,
        "variant": variant,
        "blocks": blocks,
        "normalise_gradient": normalise_gradient,
        "voxel_learning_rate": voxel_learning_rate,
        "encoder_learning_rate": encoder_learning_rate,
        "halve_every": halve_every,
        "samples_per_batch": samples_per_batch,
        "rays_per_sample": rays_per_sample,
        "inputs": inputs,
        "layout": layout,
        "encoder": "in memory" if isinstance(encoder, WeightEncoder) else encoder and str(encoder),
        "freeze_encoder": freeze_encoder,
        "device": str(device),
        "seed": seed,
    }
    for name in ("iterations", "halve_every", "samples_per_batch", "rays_per_sample"):
        if settings[name] < 1 or settings[name] != int(settings[name]):
            raise ValueError(f"{name}: found {settings[name]}, expected a whole number >= 1")
    for name in ("voxel_learning_rate", "encoder_learning_rate"):
        if not 0 <= settings[name] < np.inf:
            raise ValueError(f"{name}: found {settings[name]}, expected a number >= 0")
    if freeze_encoder and encoder is None:
        raise ValueError("freeze_encoder: found no encoder to freeze, expected encoder beside it")
    if layout not in LAYOUTS:
        raise ValueError(f"layout: found {layout!r}, expected one of {', '.join(LAYOUTS)}")
    grid = projector.grid
    measured = _finite("measured", measured, projector.shape[0])
    place = usable_device(device)
    scale = float(measured.max(initial=0.0)) or 1.0
    samples = RaySamples.from_segments(
        projector.segments, grid, measured / scale, place, active=projector.active, inputs=inputs
    )

    generator = torch.Generator().manual_seed(seed)
    if encoder is None:
        encoder = WeightEncoder(variant, blocks=blocks, seed=seed)
    elif isinstance(encoder, WeightEncoder):
        encoder = copy.deepcopy(encoder)
    else:
        encoder = load_encoder(encoder, WeightEncoder)
    settings |= {"variant": encoder.variant, "blocks": encoder.blocks}
    # Voxel values count per voxel's edge rather than per length unit: mm and m are one problem.
    to_network = float(np.mean(grid.spacing)) / scale
    if start is not None:
        start = additive_start(projector, start, nonnegative=False)
    voxels = _initial_voxels(samples, start, to_network, generator)
    model = WERNet(encoder, voxels, normalise_gradient, freeze_encoder).to(place)
    model.train()
    groups = [{"params": [model.voxels], "lr": voxel_learning_rate}]
    if not freeze_encoder:
        groups.append({"params": encoder.parameters(), "lr": encoder_learning_rate})
    optimiser = adam(groups, place)
    schedule = torch.optim.lr_scheduler.StepLR(optimiser, halve_every, gamma=0.5)

    history: list[Iteration] = []
    stop_reason = f"all {iterations} epochs done"
    with on_cores(place) as over_parts:
        for epoch in range(1, iterations + 1):
            batches = epoch_batches(len(samples), samples_per_batch, rays_per_sample, generator)
            take = samples.packed if layout == "packed" else samples.padded
            residual = train_epoch(
                model, samples, take, batches, optimiser, nonnegative, over_parts
            )
            if not np.isfinite(residual):
                stop_reason = f"diverged in epoch {epoch}; the volume is that of the one before"
                encoder = None
                break
            schedule.step()
            volume = _in_measured_units(model.voxels, projector, measured)
            history.append(Iteration(epoch, residual, time.perf_counter() - began))
            if callback is not None and callback(epoch, volume, residual):
                stop_reason = f"stopped by the callback after epoch {epoch}"
                break
    if not history:
        raise TrainingDivergedError(
            "wernet-paper: epoch 1: loss: found NaN or infinity, expected a finite number; "
            "try smaller learning rates"
        )
    return Solution(
        volume=projector.active.expand(volume).reshape(grid.shape).copy(),
        grid=grid,
        history=tuple(history),
        settings=settings,
        stop_reason=stop_reason,
        encoder=encoder,
        seconds={"solve": time.perf_counter() - began},
    )


def _initial_voxels(
    samples: RaySamples,
    start: NDArray[np.float32] | None,
    to_network: float,
    generator: torch.Generator,
) -> torch.Tensor:
    if start is not None:
        return torch.from_numpy((start.astype(np.float64) * to_network).astype(np.float32))
    random = _START * torch.rand(len(samples.index), generator=generator)
    return random * samples.crossed().cpu()


def _in_measured_units(
    voxels: torch.Tensor, projector: Projector, measured: NDArray[np.float64]
) -> NDArray[np.float32]:
    x = voxels.detach().cpu().numpy().astype(np.float64)
    projected = projector @ x
    power = float(projected @ projected)
    return (x * (float(projected @ measured) / power if power > 0 else 1.0)).astype(np.float32)


def _finite(name: str, values: ArrayLike, size: int) -> NDArray[np.float64]:
    values = np.asarray(values, np.float64).reshape(-1)
    if len(values) != size:
        raise ValueError(f"{name}: found {len(values)} values, expected {size}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: found NaN or infinity, expected finite numbers")
    return values
