"""How often the truth is inside a reconstruction's intervals, and how wide these are."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from tomo import Reconstruction
from tomo.uncertainty import summaries
from tomo.uncertainty.intervals import NORMAL

EMITTING = 0.02
"""Fraction of the truth's peak above which a voxel counts."""


def inside(outcome: Reconstruction, truth: NDArray[np.float32]) -> dict[str, Any] | None:
    """Return what the intervals of a reconstruction are worth; None where it has none.

    ``coverage``, ``width`` (median half-width over median error) and ``rank`` (Spearman's, of
    half-width and error) of emitting voxels, the first also ``by_noise`` alone; ``total`` and
    ``edges`` (fraction) inside, ``planes`` (fraction of those with light), and the total's width.
    """
    found = outcome.uncertainty and outcome.uncertainty.intervals
    if not found:
        return None
    deviation = outcome.uncertainty.standard_deviation
    emitting = truth > EMITTING * truth.max()
    error = np.abs(outcome.solution.volume - truth)[emitting]
    half = found.half_width[emitting]
    grid = outcome.solution.grid
    true = summaries.split(summaries.all_of(truth, grid), grid)
    off = {name: np.abs(found.values[name] - true[name]) for name in true}
    planes = []
    for name in ("plane_sums_x", "plane_sums_y", "plane_sums_z"):
        lit = true[name] > EMITTING * true[name].max()
        planes.append((off[name] <= found.half_widths[name])[lit])
    return {
        "coverage": float(np.mean(error <= half)),
        "by_noise": float(np.mean(error <= NORMAL * deviation[emitting])),
        "width": float(np.median(half) / np.median(error)),
        "rank": float(spearmanr(half, error)[0]),
        "rank_by_noise": float(spearmanr(deviation[emitting], error)[0]),
        "total": bool(off["total"] <= found.half_widths["total"]),
        "total_error": float(off["total"] / true["total"]),
        "total_width": float(found.half_widths["total"] / true["total"]),
        "planes": float(np.mean(np.concatenate(planes))),
        "edges": float(np.mean(off["edges"] <= found.half_widths["edges"])),
    }
