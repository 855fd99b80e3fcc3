"""The published network as a solver, from measured pixels to a volume."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import asdict
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
from tomo.wernet.micro_batches import chunk_map
from tomo.wernet.paper.encoder import WeightEncoder
from tomo.wernet.paper.epoch import train_epoch
from tomo.wernet.paper.model import WERNet
from tomo.wernet.paper.samples import RaySamples, epoch_batches
from tomo.wernet.settings import PaperSettings

if TYPE_CHECKING:
    from tomo.operators import Projector


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
    settings: PaperSettings | None = None,
    encoder: str | Path | WeightEncoder | None = None,
    freeze_encoder: bool = False,
    device: str | torch.device = "cpu",
    seed: int = 0,
) -> Solution:
    """Reconstruct with WERNet as published: voxels and their weights trained together.

    The method and its formulas are described in `tomo.wernet.paper`.

    Parameters
    ----------
    projector : Projector
        Its ``segments`` must have midpoints; its segment lengths only set the scale at the end.
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
    settings : PaperSettings, optional
        Network and training; the reading that works when None, see `PaperSettings`.
    encoder : path or WeightEncoder, optional
        Start from this encoder: a file that `save_encoder` wrote, or one in memory, which is
        copied. A new one when None.
    freeze_encoder : bool
        Train the voxels alone with the encoder given, batch normalisation included at its running
        statistics.
    device : str or torch.device
        Where to train.
    seed : int
        Seed of the encoder's initial weights, of the initial voxels and of the order of the rays.

    Returns
    -------
    Solution
        One history entry an epoch. Its ``relative_residual`` is ``||p - m|| / ||m||`` over all
        rays that cross the grid, of the network's own predictions, each made just before the step
        that used it. ``encoder`` is the trained encoder, for `tomo.wernet.save_encoder`; None
        where training diverged.

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
    On a CPU the result depends on the seed and, in its last bits, on `torch.get_num_threads`,
    which is left as it is. Other devices may add in another order every time.

    References
    ----------
    Pan, Li, Xu, arXiv 2010.00893.
    """
    began = time.perf_counter()
    settings = PaperSettings() if settings is None else settings
    _check(iterations, encoder, freeze_encoder)
    record = {
        "method": "wernet-paper",
        "iterations": iterations,
        "start": start is not None,
        "nonnegative": nonnegative,
        **asdict(settings),
        "encoder": "in memory" if isinstance(encoder, WeightEncoder) else encoder and str(encoder),
        "freeze_encoder": freeze_encoder,
        "device": str(device),
        "seed": seed,
    }
    grid = projector.grid
    measured = _finite("measured", measured, projector.shape[0])
    place = usable_device(device)
    scale = float(measured.max(initial=0.0)) or 1.0
    samples = RaySamples.from_segments(
        projector.segments,
        grid,
        measured / scale,
        place,
        active=projector.active,
        inputs=settings.inputs,
    )
    generator = torch.Generator().manual_seed(seed)
    own = _own_encoder(encoder, settings, seed)
    record |= {"variant": own.variant, "blocks": own.blocks}
    # Voxel values count per voxel's edge, not per length unit: mm and m are one problem.
    to_network = float(np.mean(grid.spacing)) / scale
    if start is not None:
        start = additive_start(projector, start, nonnegative=False)
    voxels = _initial_voxels(samples, start, to_network, settings.voxel_start, generator)
    model = WERNet(own, voxels, settings.normalise_gradient, freeze_encoder).to(place)
    model.train()

    history: list[Iteration] = []
    volume = None

    def after_epoch(epoch: int, residual: float) -> bool:
        nonlocal volume
        volume = _in_measured_units(model.voxels, projector, measured)
        history.append(Iteration(epoch, residual, time.perf_counter() - began))
        return bool(callback and callback(epoch, volume, residual))

    stop_reason = _train(model, samples, settings, iterations, nonnegative, generator, after_epoch)
    return Solution(
        volume=projector.active.expand(volume).reshape(grid.shape).copy(),
        grid=grid,
        history=tuple(history),
        settings=record,
        stop_reason=stop_reason,
        encoder=None if stop_reason.startswith("diverged") else own,
        seconds={"solve": time.perf_counter() - began},
    )


def _check(iterations: int, encoder: object, freeze_encoder: bool) -> None:
    if iterations < 1 or iterations != int(iterations):
        raise ValueError(f"iterations: found {iterations}, expected a whole number >= 1")
    if freeze_encoder and encoder is None:
        raise ValueError("freeze_encoder: found no encoder to freeze, expected encoder as well")


def _own_encoder(
    given: str | Path | WeightEncoder | None, settings: PaperSettings, seed: int
) -> WeightEncoder:
    """Return a new encoder, a copy of the given one, or that of a file."""
    if given is None:
        own = WeightEncoder(
            settings.variant, blocks=settings.blocks, channels=settings.channels, seed=seed
        )
        if settings.last_bias is not None and own.last.bias is not None:  # "no-bias" has none
            with torch.no_grad():
                own.last.bias.fill_(settings.last_bias)
        return own
    if isinstance(given, WeightEncoder):
        return copy.deepcopy(given)
    return load_encoder(given, WeightEncoder)


def _train(
    model: WERNet,
    samples: RaySamples,
    settings: PaperSettings,
    epochs: int,
    nonnegative: bool,
    generator: torch.Generator,
    after_epoch: Callable[[int, float], bool],
) -> str:
    """Train for some epochs; return why training ended.

    ``after_epoch(epoch, residual)`` is called after each, and stops training by returning True.
    """
    groups = [{"params": [model.voxels], "lr": settings.voxel_learning_rate}]
    if not model.freeze_encoder:
        groups.append({"params": model.encoder.parameters(), "lr": settings.encoder_learning_rate})
    optimiser = adam(groups, model.voxels.device)
    schedule = torch.optim.lr_scheduler.StepLR(optimiser, settings.halve_every, gamma=0.5)
    with chunk_map(model.voxels.device) as map_chunks:
        for epoch in range(1, epochs + 1):
            batches = epoch_batches(len(samples), settings.rays_per_step, generator)
            residual = train_epoch(
                model, samples, samples.packed, batches, optimiser, nonnegative, map_chunks,
                settings.loss,
            )  # fmt: skip
            if not np.isfinite(residual) and epoch == 1:
                raise TrainingDivergedError(
                    "wernet-paper: epoch 1: loss: found NaN or infinity, expected a finite "
                    "number; try smaller learning rates"
                )
            if not np.isfinite(residual):
                return f"diverged in epoch {epoch}; the volume is that of the epoch before"
            schedule.step()
            if after_epoch(epoch, residual):
                return f"stopped by the callback after epoch {epoch}"
    return f"all {epochs} epochs done"


def _initial_voxels(
    samples: RaySamples,
    start: NDArray[np.float32] | None,
    to_network: float,
    highest: float,
    generator: torch.Generator,
) -> torch.Tensor:
    """Return the first voxels (voxels,) in the network's units."""
    if start is not None:
        return torch.from_numpy((start.astype(np.float64) * to_network).astype(np.float32))
    random = highest * torch.rand(len(samples.index), generator=generator)
    return random * samples.crossed().cpu()


def _in_measured_units(
    voxels: torch.Tensor, projector: Projector, measured: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return the voxels (voxels,) at the scale at which their projection fits the measurement."""
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
