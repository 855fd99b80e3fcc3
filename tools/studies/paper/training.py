"""One training of WERNet on a case: its way epoch by epoch, and where it ended."""

from __future__ import annotations

import copy
import time
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from studies.paper.cases import SEED, case
from studies.paper.sizes import Problem
from tomo import metrics
from tomo.wernet.paper import (
    PaperSettings,
    TrainingDivergedError,
    WeightEncoder,
    wernet_paper,
)


@dataclass(frozen=True)
class Reading:
    """What the paper leaves open, decided; and what its experiments vary.

    Attributes
    ----------
    variant, inputs, blocks, samples_per_batch, normalise_gradient
        As in `tomo.wernet.paper.PaperSettings`.
    voxel_learning_rate, encoder_learning_rate
        The paper's are 0.01 and 0.0005.
    first_bias : float or None
        What the bias of the last convolution starts at; the square of it is then what most
        weights start near. None: PyTorch's random one, near zero, where a square is flat.
    seed : int
        Of the encoder, the first voxels and the order of the rays.
    """

    variant: str = "bias-mask"
    inputs: str = "relative"
    blocks: int = 3
    samples_per_batch: int = 2
    normalise_gradient: bool = True
    voxel_learning_rate: float = 0.01
    encoder_learning_rate: float = 0.005
    first_bias: float | None = 0.5
    seed: int = SEED

    def encoder(self) -> WeightEncoder:
        """Return an encoder that has not been trained; "no-bias" has no bias to set."""
        encoder = WeightEncoder(self.variant, blocks=self.blocks, seed=self.seed)
        if self.first_bias is not None and encoder.last.bias is not None:
            with torch.no_grad():
                encoder.last.bias.fill_(self.first_bias)
        return encoder

    def settings(self) -> PaperSettings:
        """Return the settings of the training; the encoder is built by `encoder`."""
        own = asdict(self)
        del own["first_bias"], own["seed"]
        return PaperSettings(**own)


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

    The row holds the case and the reading, ``curves``: a list of (epoch, cosine distance,
    relative residual), the last and the best cosine distance, and seconds. The same training is
    done once only.
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
    try:
        found = wernet_paper(
            seen.system.projector,
            seen.measured,
            iterations=epochs,
            callback=judge,
            encoder=encoder,
            freeze_encoder=freeze,
            seed=reading.seed,
            settings=reading.settings(),
        )
        end, encoder = found.stop_reason, found.encoder or encoder
    except TrainingDivergedError as error:
        end = str(error)
    seconds, work = time.perf_counter() - started, time.process_time() - worked
    distances = [distance for _, distance, _ in course]
    row = {
        **seen.described(),
        **asdict(reading),
        "encoder_of": source.flame if source else None,
        "frozen": freeze,
        "epochs": epochs,
        "end": end,
        "curves": course,
        "cosine_distance": distances[-1] if distances else 1.0,
        "best_cosine_distance": min(distances, default=1.0),
        "best_epoch": int(np.argmin(distances)) + 1 if distances else None,
        "nrmse": metrics.nrmse(volume, seen.truth),
        "seconds": seconds,
        "core_seconds_per_epoch": work / max(len(course), 1),
        "steps_per_epoch": -(-seen.described()["rays"] // (100 * reading.samples_per_batch)),
    }
    return row, encoder
