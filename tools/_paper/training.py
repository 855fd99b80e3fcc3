"""One training of WERNet on a case: its way epoch by epoch, and where it ended."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import islice
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from _paper.cases import SEED, Case, case, grid_of
from _paper.sizes import Problem
from _paper.steps import epochs as epochs_by_steps
from _paper.steps import steps
from tomo import metrics
from tomo.draw.volume.planes import middle_planes
from tomo.wernet.paper import TrainingDivergedError, WeightEncoder, wernet_paper

Progress = Callable[[int, int, str], None]
"""Called as ``progress(done, total, where)``."""

PER_MILLE = 1000
"""Cross-sections are kept in thousandths of the truth's maximum."""

_OF_ENCODER = ("variant", "blocks", "first_bias")
_OF_STUDY = ("norm", "loss", "first_voxels")
"""What `tomo.wernet.paper.wernet_paper` does by default in every reading."""


@dataclass(frozen=True)
class Reading:
    """What the paper leaves open, decided; and what its experiments vary.

    Attributes
    ----------
    variant, blocks, samples_per_batch, normalise_gradient
        Of `tomo.wernet.paper.wernet_paper`.
    inputs : str
        As well, or ``unscaled``: the absolute ones counted in voxels.
    norm : {"ray", "batch"}
        Over which weights the norm of the gradient normalisation goes.
    loss : {"squared", "absolute"}
        Whose mean over a step's rays is the loss.
    first_voxels : float
        Upper end of the random initial voxels, the measurement's maximum being one.
    voxel_learning_rate, encoder_learning_rate
        The paper's are 0.01 and 0.0005.
    first_bias : float or None
        What the bias of the last convolution starts at; the square of it is then what most
        weights start near. None: PyTorch's random one, near zero, where a square is flat.
    """

    variant: str = "bias-mask"
    inputs: str = "relative"
    blocks: int = 3
    samples_per_batch: int = 2
    normalise_gradient: bool = True
    norm: str = "ray"
    loss: str = "squared"
    voxel_learning_rate: float = 0.01
    encoder_learning_rate: float = 0.005
    first_voxels: float = 0.1
    first_bias: float | None = 0.5

    def encoder(self) -> WeightEncoder:
        """Return an encoder that has not been trained; "no-bias" has no bias to set."""
        encoder = WeightEncoder(self.variant, blocks=self.blocks, seed=SEED)
        if self.first_bias is not None and encoder.last.bias is not None:
            with torch.no_grad():
                encoder.last.bias.fill_(self.first_bias)
        return encoder

    def options(self) -> dict[str, Any]:
        """Return what `wernet_paper` takes beside the encoder."""
        kept = (*_OF_ENCODER, *_OF_STUDY)
        return {name: value for name, value in asdict(self).items() if name not in kept}

    @property
    def known_to_solver(self) -> bool:
        """Whether `tomo.wernet.paper.wernet_paper` can be asked for it."""
        as_solver = all(getattr(self, name) == getattr(Reading, name) for name in _OF_STUDY)
        return as_solver and self.inputs != "unscaled"


@dataclass(frozen=True)
class Source:
    """A case whose training gives the encoder that another starts from.

    Attributes
    ----------
    flame, layout : str
    epochs : int
    """

    flame: str
    layout: str
    epochs: int


def trained(
    flame: str,
    layout: str,
    problem: Problem,
    epochs: int,
    reading: Reading,
    noise: float = 0.0,
    source: Source | None = None,
    freeze: bool = False,
) -> dict[str, Any]:
    """Train on one case and return what happened, as a row.

    The row holds the case and the reading, ``course``: a list of (epoch, cosine distance,
    relative residual), the last and the best cosine distance, seconds, and a cross-section.
    The same training is done once only.
    """
    row, _ = row_and_encoder(flame, layout, problem, epochs, reading, noise, source, freeze)
    return copy.deepcopy(row)


@lru_cache(maxsize=64)
def row_and_encoder(
    flame: str,
    layout: str,
    problem: Problem,
    epochs: int,
    reading: Reading,
    noise: float = 0.0,
    source: Source | None = None,
    freeze: bool = False,
) -> tuple[dict[str, Any], WeightEncoder]:
    """Do what `trained` says; return the encoder as well, not to be trained further."""
    encoder = reading.encoder()
    if source is not None:
        # All arguments: those left out would be another entry of the cache.
        _, other = row_and_encoder(
            source.flame, source.layout, problem, source.epochs, reading, 0.0, None, False
        )
        encoder = copy.deepcopy(other)
    seen = case(flame, layout, problem, noise)
    course: list[tuple[int, float, float]] = []
    volume = np.zeros_like(seen.truth)

    def judge(epoch: int, active: NDArray[np.float32], residual: float) -> None:
        nonlocal volume
        volume = seen.system.projector.active.expand(active).reshape(seen.truth.shape)
        course.append((epoch, metrics.cosine_distance(volume, seen.truth), residual))

    started, worked = time.perf_counter(), time.process_time()
    if reading.known_to_solver:
        try:
            result = wernet_paper(
                seen.system.projector,
                seen.measured,
                iterations=epochs,
                callback=judge,
                encoder=encoder,
                freeze_encoder=freeze,
                seed=SEED,
                **reading.options(),
            )
            end = result.stop_reason
        except TrainingDivergedError as error:
            end = str(error)
    else:
        for epoch, active, residual in epochs_by_steps(seen, reading, encoder, epochs):
            judge(epoch, active, residual)
        end = f"all {epochs} epochs done"
    seconds, work = time.perf_counter() - started, time.process_time() - worked
    distances = [distance for _, distance, _ in course]
    row = {
        **seen.described(),
        **asdict(reading),
        "encoder_of": source.flame if source else None,
        "frozen": freeze,
        "epochs": epochs,
        "end": end,
        "course": course,
        "cosine_distance": distances[-1] if distances else 1.0,
        "best_cosine_distance": min(distances, default=1.0),
        "best_epoch": int(np.argmin(distances)) + 1 if distances else None,
        "nrmse": metrics.nrmse(volume, seen.truth),
        "seconds": seconds,
        "core_seconds_per_epoch": work / max(len(course), 1),
        "steps_per_epoch": -(-seen.described()["rays"] // (100 * reading.samples_per_batch)),
        "section": section(volume, seen.truth, problem),
    }
    return row, encoder


def section(volume: NDArray, truth: NDArray, problem: Problem) -> list[list[int]]:
    """Return the plane z = 0, (y, x), in thousandths of the truth's maximum."""
    plane = middle_planes(volume, grid_of(problem))[0][0]
    return np.rint(plane * (PER_MILLE / float(truth.max()))).astype(int).tolist()


def first_steps(seen: Case, reading: Reading, count: int) -> dict[str, Any]:
    """Train for some steps and return the loss of each, as the paper's first iterations.

    The loss is the mean over a batch's rays of (p - m)², the measurement scaled to a maximum of
    one, before the step that it makes.
    """
    taken = list(islice(steps(seen, reading, reading.encoder()), count))
    voxels = taken[-1].model.voxels.detach().numpy()
    found = seen.system.projector.active.expand(voxels).reshape(seen.truth.shape)
    return {
        **seen.described(),
        **asdict(reading),
        "losses": [step.loss for step in taken],
        "cosine_distance": metrics.cosine_distance(found, seen.truth),
    }
