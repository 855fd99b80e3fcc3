"""Why a volume may not explain the images: whatever the stages found, as one list.

Each finder takes the reconstruction and yields the causes that it knows of. Another stage joins
by a finder of its own in `FINDERS`; they are asked in their order, the likeliest first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from tomo.screening.screening import OUTSIDE

Finder = Callable[[Any], Iterator[str]]
"""From a `tomo.Reconstruction` to causes, each a phrase that fits after "likely causes:"."""

UNKNOWN = (
    "no cause that was tested explains it. Check that no two cameras' images are exchanged and "
    "that the scene did not move between exposures, try smaller voxels, and see whether gas "
    "absorbs (--fit-absorption)"
)
"""The end of an answer for which no stage found a cause: what to see to."""


def likely_causes(outcome: Any) -> tuple[str, ...]:
    """Return what the stages found that keeps a volume from explaining the images.

    Parameters
    ----------
    outcome : tomo.Reconstruction
        Its screening, alignment, gains and explanation are asked.

    Returns
    -------
    causes : tuple of str
        Each fits after "likely causes:"; empty where nothing was found.
    """
    return tuple(cause for find in FINDERS for cause in find(outcome))


def _background(outcome: Any) -> Iterator[str]:
    levels = (outcome.screening or {}).get("background") or {}
    if levels:
        worst = _largest(levels)
        yield f"a uniform background (camera {worst}: {levels[worst]:.3g})"


def _light_outside(outcome: Any) -> Iterator[str]:
    screening = outcome.screening or {}
    lit = screening.get("background") or {}
    fractions = {
        name: fraction
        for name, fraction in (screening.get("light_outside_grid") or {}).items()
        if name not in lit
    }
    worst = _largest(fractions)
    if worst is not None and fractions[worst] > OUTSIDE:
        yield f"light from outside the grid ({fractions[worst]:.0%} of camera {worst}'s)"


def _below_zero(outcome: Any) -> Iterator[str]:
    depths = (outcome.screening or {}).get("below_zero") or {}
    if depths:
        worst = _largest(depths)
        yield f"too much subtracted as dark (camera {worst}: {depths[worst]:.3g})"


def _pointing(outcome: Any) -> Iterator[str]:
    found = (outcome.alignment or {}).get("displacement") or {}
    if found.get("disagrees"):
        worst = _largest(found["pixels"])
        pixels = found["pixels"][worst]
        yield f"cameras that point elsewhere (camera {worst}'s image lies {pixels:.1f} pixels off)"


def _gains(outcome: Any) -> Iterator[str]:
    if outcome.gains and outcome.gains["disagreement"] > 0:  # 0: only single cameras', see there
        yield f"gains or backgrounds that differ (gains by {outcome.gains['disagreement']:.1%})"


def _absorption(outcome: Any) -> Iterator[str]:
    found = (outcome.explanation or {}).get("absorption") or {}
    if found:
        yield f"absorption beyond what was corrected (optical depth {found['optical_depth']:.2f})"


def _cameras(outcome: Any) -> Iterator[str]:
    for name, found in ((outcome.screening or {}).get("cameras") or {}).items():
        words = " or ".join(cause["words"] for cause in found["causes"])
        yield f"camera {name} ({words})"


FINDERS: tuple[Finder, ...] = (
    _background,
    _light_outside,
    _below_zero,
    _pointing,
    _gains,
    _absorption,
    _cameras,
)


def _largest(values: Mapping[str, float]) -> str | None:
    """Return the key of the largest value; None where there is none."""
    return max(values, key=values.__getitem__, default=None)
