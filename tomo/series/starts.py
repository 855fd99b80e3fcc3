"""Where frames start: from their block's key frame, brought to their own images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tomo.operators.operator import ProjectionOperator
from tomo.selection import Choice
from tomo.solvers import mlem
from tomo.solvers.initial_volume import mlos_start

UPDATES = 6
"""Updates of MLEM that bring the key frame's volume to a frame's own images, by whose brightness
the prior weighs. Fewer leave light where the key frame had it, more cost time."""

FRESH = 0.1
"""Fraction of the light of a start that is back-projected from the frame's own images: what MLEM
starts at zero stays there, and light moves. More brings the ghosts of a start from scratch."""

FROM_KEY = 0.75
"""Iterations from the key frame's volume, as a fraction of those that were chosen from scratch.
Fewer leave the key frame's details, more only cost time."""


def start_from(
    projector: ProjectionOperator, measured: NDArray[np.float32], key: NDArray[np.float32]
) -> NDArray[np.float32] | None:
    """Return the start of a frame, ``(unknowns,)``; None where it has to start from scratch.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,) float32
    key : (unknowns,) float32
        The solution of the block's key frame.
    """
    light = float(key.sum(dtype=np.float64))
    fresh = mlos_start(projector, measured)
    own = float(fresh.sum(dtype=np.float64))
    if not (light > 0 and own > 0 and measured.any()):
        return None
    start = (1 - FRESH) * np.maximum(key, 0) + np.float32(FRESH * light / own) * fresh
    found = mlem(projector, measured, iterations=UPDATES, start=start.astype(np.float32))
    return projector.active.compress(found.volume)


def shortened(choice: Choice) -> Choice:
    """Return the choice for a frame that does not start from scratch."""
    return replace(choice, iterations=max(round(FROM_KEY * choice.iterations), 1))
