"""The published network as a solver, from measured pixels to a volume.

Voxels and encoder of `tomo.wernet.WERNet` are trained together by Adam, with a learning rate each,
halved every five epochs, on the mean squared error of some rays. The weights are the squares of
what the encoder gives, and gradients to voxels are normalised.

The factorisation fixes no scale: weights times ``c`` and voxels divided by ``c`` predict the same.
Two steps are therefore ours, not the paper's. The measurement is divided by its maximum, so that
learning rates mean the same in every unit. The voxels are reported as ``s x``, with the matrix
``A`` of segment lengths::

    s = <A x, m> / <A x, A x>

the scale at which their ordinary projection fits the measurement best. A factor that varies in
space is not undone by this: an encoder that sees absolute positions can hide one while the loss
falls. With relative positions, the default of `PaperSettings`, it cannot.
"""

from __future__ import annotations

import time
import zlib
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from rigs.files.size_guard import errors_of_libraries
from tomo.operators.vectors import additive_start
from tomo.solvers import Iteration, Solution
from tomo.solvers.solution import Callback
from tomo.wernet.encoder import Encoder
from tomo.wernet.files import load_training, own_copy, save_training
from tomo.wernet.model import WERNet
from tomo.wernet.rays import Rays
from tomo.wernet.settings import PaperSettings
from tomo.wernet.training import JointTraining, usable_device

if TYPE_CHECKING:
    from tomo.operators import Projector

SAVE_EVERY = 5
"""Epochs between two savings of the state. Fewer: time. More: as much is lost with a process."""


def wernet_paper(
    projector: Projector,
    measured: ArrayLike,
    *,
    iterations: int = 80,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    callback: Callback | None = None,
    settings: PaperSettings | None = None,
    encoder: str | Path | Encoder | None = None,
    freeze_encoder: bool = False,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    device: str | torch.device = "cpu",
    seed: int = 0,
) -> Solution:
    """Reconstruct with WERNet as published: voxels and their weights trained together.

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
        Network and training; the reading of the paper that works when None.
    encoder : path or Encoder, optional
        Start from this encoder: a file that `save_encoder` wrote, or one in memory, which is
        copied. A new one when None.
    freeze_encoder : bool
        Train the voxels alone with the encoder given, batch normalisation included at its running
        statistics.
    checkpoint : path, optional
        A file to write the state of the training to, every five epochs.
    resume : bool
        Go on from the checkpoint, where there is one.
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
        For segments without midpoints, sizes that do not match, values that are not finite, an
        unknown device, an encoder of other inputs, or a checkpoint of another problem.
    TrainingDivergedError
        When the loss is not finite in the first epoch. In a later one training stops, and the
        result is the volume of the epoch before, as ``stop_reason`` says.

    Notes
    -----
    On a CPU the result is the same bits for any number of threads. Other devices may add in
    another order every time.

    References
    ----------
    Pan, Li, Xu, arXiv 2010.00893.
    """
    return wernet_paper_frames(
        projector, np.reshape(measured, (1, -1)), iterations=iterations, start=start,
        nonnegative=nonnegative, callback=callback, settings=settings, encoder=encoder,
        freeze_encoder=freeze_encoder, checkpoint=checkpoint, resume=resume, device=device,
        seed=seed,
    )[0]  # fmt: skip


def wernet_paper_frames(
    projector: Projector,
    measured: ArrayLike,
    *,
    iterations: int = 80,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    callback: Callback | None = None,
    settings: PaperSettings | None = None,
    encoder: str | Path | Encoder | None = None,
    freeze_encoder: bool = False,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    device: str | torch.device = "cpu",
    seed: int = 0,
) -> list[Solution]:
    """Reconstruct frames of a film with one encoder: each frame has its own voxels.

    Parameters
    ----------
    measured : (frames, pixels) float
        Finite projections of each frame by the same cameras.
    callback : callable, optional
        As for `wernet_paper`, with volumes (voxels,) of a single frame, else (frames, voxels).

    Other Parameters
    ----------------
    projector, iterations, start, nonnegative, settings, encoder, freeze_encoder, checkpoint,
    resume, device, seed
        As for `wernet_paper`, which says what is raised as well.

    Returns
    -------
    list of Solution
        One a frame, with the history and the encoder that all have in common.

    References
    ----------
    Multi-WERNet, Applied Optics 60, 6469 (2021), of the same authors.
    """
    began = time.perf_counter()
    settings = PaperSettings() if settings is None else settings
    if iterations < 1 or iterations != int(iterations):
        raise ValueError(f"iterations: found {iterations}, expected a whole number >= 1")
    if freeze_encoder and encoder is None:
        raise ValueError("freeze_encoder: found no encoder to freeze, expected encoder as well")
    measured = _finite(measured, projector.shape[0])
    place = usable_device(device)
    own = _own_encoder(encoder, settings, seed)
    given = "in memory" if isinstance(encoder, Encoder) else encoder and str(encoder)
    record = {
        "method": "wernet-paper", "iterations": iterations, "start": start is not None,
        "nonnegative": nonnegative, **asdict(settings), **own.settings, "encoder": given,
        "freeze_encoder": freeze_encoder, "device": str(device), "seed": seed,
    }  # fmt: skip
    rays = Rays.of(projector, own.inputs, device=place)
    scale = float(measured.max(initial=0.0)) or 1.0
    generator = torch.Generator().manual_seed(seed)
    # Voxel values count per voxel's edge, not per length unit: mm and m are one problem.
    to_network = float(np.mean(projector.grid.spacing)) / scale
    if start is None:
        voxels = torch.rand(len(measured), rays.unknowns, generator=generator)
        voxels *= settings.voxel_start * rays.crossed().cpu()
    else:
        values = additive_start(projector, start, nonnegative=False).astype(np.float64)
        voxels = torch.from_numpy((values * to_network).astype(np.float32))
        voxels = voxels.expand(len(measured), -1)
    normalise = settings.normalise_gradient
    model = WERNet(voxels, own, anchored=False, normalise_gradient=normalise).to(place)
    own.requires_grad_(not freeze_encoder)
    training = JointTraining(model, own, rays, measured / scale, settings, nonnegative, generator)
    problem = _problem(record, projector, measured)
    if checkpoint is not None and resume:
        state = load_training(checkpoint, problem)
        with errors_of_libraries(f"{checkpoint}: found a training that does not fit its settings"):
            training.load_state_dict(state)
    volume = _in_measured_units(model.voxels, projector, measured)

    def after_epoch(history: list[Iteration]) -> bool:
        nonlocal volume
        volume = _in_measured_units(model.voxels, projector, measured)
        if checkpoint is not None and len(history) % SAVE_EVERY == 0:
            save_training(checkpoint, problem, training.state_dict())
        last = history[-1]
        active = volume if len(volume) > 1 else volume[0]
        return bool(callback and callback(last.index, active, last.relative_residual))

    stop_reason = training.run(iterations, began, after_epoch)
    diverged = stop_reason.startswith("diverged")
    solved = Solution(
        volume=np.zeros(projector.grid.shape, np.float32),
        grid=projector.grid,
        history=tuple(training.history),
        settings=record,
        stop_reason=stop_reason,
        encoder=None if diverged else own.requires_grad_(True),
        seconds={"solve": time.perf_counter() - began},
    )
    whole = [projector.active.expand(one).reshape(projector.grid.shape) for one in volume]
    return [replace(solved, volume=one.copy()) for one in whole]


def _own_encoder(
    given: str | Path | Encoder | None, settings: PaperSettings, seed: int
) -> Encoder:
    """Return a new encoder, a copy of the given one, or that of a file."""
    if given is not None:
        return own_copy(given, ("absolute", "relative"))
    return Encoder(
        settings.inputs, variant=settings.variant, blocks=settings.blocks,
        channels=settings.channels, last_bias=settings.last_bias, seed=seed,
    )  # fmt: skip


def _in_measured_units(
    voxels: torch.Tensor, projector: Projector, measured: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return the voxels (frames, voxels), each frame at the scale at which it fits best."""
    found = voxels.detach().cpu().numpy().astype(np.float64)
    for frame, pixels in zip(found, measured, strict=True):
        projected = projector @ frame
        power = float(projected @ projected)
        frame *= float(projected @ pixels) / power if power > 0 else 1.0
    return found.astype(np.float32)


def _problem(record: dict[str, Any], projector: Projector, measured: NDArray[np.float64]) -> str:
    """Return what a training is of: checksums of images and rays, and the settings."""
    checksum = zlib.crc32(np.ascontiguousarray(measured).data)
    for part in projector.arrays:
        checksum = zlib.crc32(np.ascontiguousarray(part).data, checksum)
    own = {key: value for key, value in record.items() if key not in ("device", "iterations")}
    return f"{projector.shape} {checksum:08x} {own}"


def _finite(values: ArrayLike, pixels: int) -> NDArray[np.float64]:
    """Return measured pixels as ``(frames, pixels)``."""
    values = np.asarray(values, np.float64)
    if values.ndim != 2 or values.shape[1] != pixels:
        raise ValueError(f"measured: found {values.size} values, expected {pixels} a frame")
    if not np.isfinite(values).all():
        raise ValueError("measured: found NaN or infinity, expected finite numbers")
    return values
