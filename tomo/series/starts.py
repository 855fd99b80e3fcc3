"""Where frames start: from their block's key frame, brought to their own images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tomo.operators.operator import ProjectionOperator
from tomo.selection import Choice
from tomo.solvers.initial_volume import mlos_start
from tomo.solvers.several import mlem_of_several

UPDATES = 6
"""Updates of MLEM that bring the key frame's volume to a frame's own images, by whose brightness
the prior weighs. Fewer leave light where the key frame had it, more cost time."""

FRESH = 0.1
"""Fraction of the light of a start that is back-projected from the frame's own images: what MLEM
starts at zero stays there, and light moves. More brings the ghosts of a start from scratch."""

FROM_KEY = 0.75
"""Iterations from the key frame's volume, as a fraction of those that were chosen from scratch.
Fewer leave the key frame's details, more only cost time."""


def starts_from(
    projector: ProjectionOperator, measured: NDArray[np.float32], key: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the starts of some frames, and which of them have to start from scratch instead.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels, frames) float32
    key : (unknowns,) float32
        The solution of the block's key frame.

    Returns
    -------
    (unknowns, frames) float32
    (frames,) bool
        True where the key frame or the frame itself is dark.
    """
    light = key.sum(dtype=np.float64)
    fresh = mlos_start(projector, measured)  # (unknowns, frames)
    own = fresh.sum(axis=0, dtype=np.float64)
    dark = (own <= 0) | (light <= 0) | ~measured.any(axis=0)
    scale = np.divide(FRESH * light, own, out=np.zeros_like(own), where=~dark)
    start = (1 - FRESH) * np.maximum(key, 0)[:, None] + scale * fresh
    start = start.astype(np.float32)
    return mlem_of_several(projector, measured, iterations=UPDATES, start=start), dark


def shortened(choice: Choice) -> Choice:
    """Return the choice for a frame that does not start from scratch."""
    return replace(choice, iterations=max(round(FROM_KEY * choice.iterations), 1))
