"""True weights of simulated images, to compare learned ones with."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tomo.operators import LinearSystem
from tomo.operators.view_gains import Gains
from tomo.scan import Scan
from tomo.simulation.effects import Effects

TrueEffects = tuple[Effects, Mapping[str, float]]
"""Effects of the simulation, and the gains of the cameras; one where none is named."""


def true_effects(scan: Scan) -> TrueEffects | None:
    """Return the effects that a scan was simulated with; None where it names none.

    Raises
    ------
    ValueError
        If a value is out of range.
    """
    if scan.effects is None:
        return None
    settings = dict(scan.effects)
    gains = settings.pop("gains", None) or {}
    try:
        return Effects(**settings), gains
    except ValueError as error:
        raise ValueError(f"{scan.source}: effects: {error}") from None


def true_ratios(
    system: LinearSystem,
    known: TrueEffects | None,
    truth: NDArray[np.float32] | None,
    corrected: Gains | None = None,
) -> NDArray[np.float64] | None:
    """Return the true weight of every segment over its length, ``(S,)``; None if not known.

    Parameters
    ----------
    system : LinearSystem
        Stored, one ray a pixel, its segments with midpoints.
    known : TrueEffects, optional
    truth : (nx, ny, nz), optional
        Needed where the gas absorbs its own light.
    corrected : Gains, optional
        Gains by which the images were corrected before weights were learned.
    """
    if known is None or (known[0].self_absorption > 0 and truth is None):
        return None
    (effects, gains), projector = known, system.projector
    emission = None if truth is None else projector.active.compress(truth)
    fitted = np.ones(len(system.rig)) if corrected is None else corrected.gain
    ratios = [
        effects.weight_ratio(
            camera,
            projector.view(view).segments,
            projector.grid,
            emission,
            gain=gains.get(camera.name, 1.0) / fitted[view],
        )
        for view, camera in enumerate(system.rig)
    ]
    return np.concatenate(ratios)
