"""Training an encoder that any scene may start from: at true voxels, on many random scenes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray

from _encoders.scenes import Exercise, random_exercise
from tomo.wernet.correction import CorrectionEncoder, ViewTokens
from tomo.wernet.fixed_voxels import LEARNING_RATE, FixedVoxels, set_rate
from tomo.wernet.parts import Map, on_cores
from tomo.wernet.ray_features import RayFeatures

LOCAL = (
    "place in the voxel, x",
    "place in the voxel, y",
    "place in the voxel, z",
    "direction, x",
    "direction, y",
    "direction, z",
    "chord",
)
"""What a finite pixel's weight can hang on; all else that an encoder sees is not looked at."""

PENALTY = 0.1
"""Of the mean squared correction, against a misfit that is 1 for the chords."""

RAYS_A_STEP = 1500

Progress = Callable[[int, int, str], None]


def train_finite_pixels(
    *,
    scenes: int,
    epochs: int,
    seed: int,
    channels: int = 16,
    progress: Progress | None = None,
) -> tuple[CorrectionEncoder, NDArray[np.float64]]:
    """Return an encoder trained on random scenes, and the mean misfit of every epoch.

    The loss is that of `tomo.wernet.alternation` at the true voxels, a scene's squared misfit
    counted in that of its chords: large pixels, whose chords are far off, would else decide alone,
    and an encoder is not told how large a pixel is.

    Parameters
    ----------
    scenes, epochs : int
        Each epoch shows every scene some of its rays, drawn anew.
    seed : int
    channels : int
        Of the encoder.
    progress : callable, optional
        ``progress(done, total, where)``.
    """
    random = np.random.default_rng(seed)
    show = progress or (lambda *_: None)
    lessons = []
    for number in range(scenes):
        show(number, scenes + epochs, "scenes")
        lessons.append(_Lesson(random_exercise(random), channels))
    encoder = CorrectionEncoder(channels=channels, seed=seed)
    encoder.look_at(LOCAL)
    optimiser = torch.optim.Adam(encoder.parameters(), lr=LEARNING_RATE, betas=(0.9, 0.99))
    misfits = np.zeros(epochs)
    with on_cores(torch.device("cpu")) as over_parts:
        for epoch in range(epochs):
            show(scenes + epoch, scenes + epochs, "training")
            set_rate(optimiser, epoch / epochs)
            order = random.permutation(scenes)
            misfits[epoch] = np.mean(
                [lessons[i].step(encoder, optimiser, random, over_parts) for i in order]
            )
    show(scenes + epochs, scenes + epochs, "")
    return encoder, misfits


class _Lesson:
    """One scene, ready to be learned from."""

    def __init__(self, exercise: Exercise, channels: int) -> None:
        features = RayFeatures.of(exercise.projector, tells_views=False)
        measured = torch.from_numpy(exercise.measured)
        unit = float(measured.double().square().mean().sqrt())
        chords = exercise.projector @ exercise.volume - exercise.measured
        self.fixed = FixedVoxels(
            features,
            features.emission_in_front(exercise.volume, unit),
            torch.from_numpy(exercise.volume),
            measured,
            float(np.mean(np.square(chords, dtype=np.float64))),
            PENALTY,
        )
        self.tokens = ViewTokens(exercise.projector.n_views, channels)
        self.crossing = features.count.nonzero()[:, 0]

    def step(
        self,
        encoder: CorrectionEncoder,
        optimiser: torch.optim.Optimizer,
        random: np.random.Generator,
        over_parts: Map,
    ) -> float:
        """Take one step; return the mean squared misfit before it, that of the chords being 1."""
        number = min(RAYS_A_STEP, len(self.crossing))
        chosen = np.sort(random.choice(len(self.crossing), number, replace=False))
        rays = self.crossing[torch.from_numpy(chosen)]
        _, misfit = self.fixed.set_gradients(
            encoder, self.tokens, list(encoder.parameters()), rays, over_parts
        )
        optimiser.step()
        return misfit
