"""Windows that the target was seen through: what was adjusted, and how well it is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigs.scene.sight_lines import WINDOW
from rigs.scene.surfaces import Glass

if TYPE_CHECKING:
    from rigs.calibrate.adjust.freedom import Freedom
    from rigs.calibrate.refraction.refraction import Refraction

MISFIT = 4.0  # standard deviations of what was given; one in 16 000 is farther by chance


@dataclass(frozen=True)
class AdjustedWindow:
    """A window whose pose and thickness were adjusted; lengths in the rig's unit."""

    name: str
    normal: tuple[float, float, float]
    point: tuple[float, float, float]
    thickness: float
    changes: tuple[float, float, float]  # normal (degrees), place along it, thickness
    errors: tuple[float, float, float]  # standard deviations of the changes; 0 where held
    priors: tuple[float, float, float]  # standard deviations of what was given

    def in_words(self, length_unit: str) -> str:
        """Return a line on what was found."""
        words = ("normal turned by", "moved along it by", "thickness changed by")
        parts = [
            f"{word} {change:.2g} ± {error:.2g} {unit}"
            for word, change, error, unit in zip(
                words,
                self.changes,
                self.errors,
                ("degrees", length_unit, length_unit),
                strict=True,
            )
            if error > 0
        ]
        return f"window {self.name}: {', '.join(parts)}"

    def contradiction(self) -> str | None:
        """Return a line where what was found contradicts what was given."""
        names = ("normal", "distance", "thickness")
        off, name = max(
            (abs(change) / prior if prior > 0 else 0.0, name)
            for name, change, prior in zip(names, self.changes, self.priors, strict=True)
        )
        if off <= MISFIT:
            return None
        return (
            f"window {self.name}: its {name} is {off:.2g} standard deviations from the one given: "
            "check the measure, the index of refraction and the world of the scene (--world)"
        )

    def figures(self) -> dict[str, Any]:
        """Return plain data for the rig's file."""
        return {
            "thickness": self.thickness,
            "turned_degrees": self.changes[0],
            "turned_error_degrees": self.errors[0],
            "distance_change": self.changes[1],
            "distance_error": self.errors[1],
            "thickness_change": self.changes[2],
            "thickness_error": self.errors[2],
        }


def adjusted_windows(
    refraction: Refraction, freedom: Freedom, covariance: NDArray[np.float64]
) -> tuple[AdjustedWindow, ...]:
    """Return the windows that were adjusted, from the covariance of all free parameters."""
    place = freedom.window_places
    variance = np.where(place >= 0, np.diag(covariance)[np.maximum(place, 0)], 0.0)
    # What images do not show is known as before, whatever else contradicts
    errors = np.minimum(np.sqrt(variance), refraction.deviations).reshape(-1, WINDOW)
    changes = refraction.changes.reshape(-1, WINDOW)
    found = []
    for prior, change, error in zip(refraction.priors, changes, errors, strict=True):
        window = refraction.window(prior.name)
        turned = float(np.degrees(np.hypot(*change[:2])))
        known = float(np.degrees(error[:2].max()))
        found.append(
            AdjustedWindow(
                prior.name,
                window.normal,
                window.point,
                window.thickness,
                (turned, float(change[2]), float(change[3])),
                (known, float(error[2]), float(error[3])),
                (prior.normal, prior.distance, prior.thickness),
            )
        )
    return tuple(found)


def window_findings(
    refraction: Refraction,
    windows: tuple[AdjustedWindow, ...],
    looked_through: list[list[str]],
    length_unit: str,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return warnings and notes on a scene's windows."""
    warnings = tuple(line for line in (w.contradiction() for w in windows) if line)
    notes = [window.in_words(length_unit) for window in windows]
    used = {name for own in looked_through for name in own}
    unused = [
        solid.name
        for solid in refraction.scene.solids
        if isinstance(solid.material, Glass) and solid.name not in used
    ]
    if unused:
        notes.append(f"scene: no camera saw the target through {', '.join(unused)}")
    return warnings, tuple(notes)
