"""Means of learned weights by the quantities that they may depend on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.operators import Projector
from tomo.wernet.rays import Rays
from tomo.wernet.weights import RayWeights

BINS = 20

FAINTEST = 1e-3
"""Fraction of the light below which a bin's mean is NaN. Smaller: means of a few segments."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Mean relative weight against one quantity."""

    quantity: str
    unit: str  # length is the grid's
    edges: NDArray[np.float64]  # (bins + 1,)
    light: NDArray[np.float64]  # (bins,), the fraction of length x emission
    weight: NDArray[np.float64]  # (bins,), mean of weight / length; NaN: hardly any light

    @classmethod
    def of(
        cls, quantity: str, unit: str, values: NDArray, light: NDArray, ratio: NDArray
    ) -> Profile:
        """Return the means of ``ratio``, weighted by ``light``, in equal bins of ``values``."""
        end = max(float(values.max()), float(np.finfo(np.float32).tiny))
        number = (values / end * BINS).astype(np.int64).clip(0, BINS - 1)
        total, sums = (np.bincount(number, each, BINS) for each in (light, light * ratio))
        enough = total >= FAINTEST * total.sum()
        mean = np.where(enough, sums / np.where(enough, total, 1), np.nan)
        return cls(quantity, unit, np.linspace(0, end, BINS + 1), total / total.sum(), mean)

    @property
    def centre(self) -> NDArray[np.float64]:
        """The middles of the bins, ``(bins,)``."""
        return (self.edges[:-1] + self.edges[1:]) / 2

    def report(self) -> dict[str, Any]:
        """Return plain numbers."""
        columns = {"centre": self.centre, "light": self.light, "weight": self.weight}
        return {"unit": self.unit} | {name: values.tolist() for name, values in columns.items()}


@dataclass(frozen=True, eq=False)
class LearnedWeights:
    """Relative weights, the learned weight over the segment length, as means.

    Every mean is weighted by ``length x emission``: segments without light do not count. The mean
    of all is one, because no image tells a common factor from one of the volume.
    """

    spread: float  # the standard deviation over all segments
    profiles: tuple[Profile, ...]  # by depth, upstream emission, and angle off the view's axis
    held_out_residual: Mapping[str, float]  # of left-out pixels, by segment_lengths and learned

    @classmethod
    def of(
        cls,
        weights: RayWeights,
        lengths: Projector,
        learned: Projector,
        volume: NDArray[np.float32],
        held_out_residual: Mapping[str, float],
    ) -> LearnedWeights:
        """Return means over stored ``lengths`` with midpoints, weighted by a volume's light."""
        rays = Rays.of(lengths, "optics", image_scale=weights.image_scale)
        rays = rays.with_upstream(weights.volume, weights.unit)
        of_ray, of_segment = rays.features.of_ray.numpy(), rays.features.of_segment.numpy()
        length = lengths.segments.length.astype(np.float64)
        light = length * np.maximum(lengths.active.compress(volume)[lengths.segments.voxel], 0)
        if not light.sum() > 0:
            light = length  # a dark volume: every segment counts by its length
        ratio = np.divide(learned.segments.length, length, np.ones_like(length), where=length > 0)
        depth = (of_segment[:, 0] + 1) / 2 * min(lengths.grid.extent)
        tangent = np.hypot(*of_ray.T[3:5]) * weights.image_scale
        angle = np.repeat(np.degrees(np.arctan(tangent)), rays.count.numpy())
        ratio /= light @ ratio / light.sum()
        columns = (
            ("depth in the grid", "length", depth),
            ("upstream emission", "root mean square pixel", of_segment[:, 1]),
            ("angle off the image's middle", "degrees", angle),
        )
        return cls(
            math.sqrt(float(light @ np.square(ratio - 1) / light.sum())),
            tuple(Profile.of(name, unit, of, light, ratio) for name, unit, of in columns),
            dict(held_out_residual),
        )

    def __repr__(self) -> str:
        """Name the spread."""
        return f"<LearnedWeights: spread {self.spread:.1%}>"

    def report(self) -> dict[str, Any]:
        """Return plain numbers for a report, NaN where there is hardly any light."""
        return {
            "spread": self.spread,
            "held_out_residual": dict(self.held_out_residual),
            "profiles": {profile.quantity: profile.report() for profile in self.profiles},
        }
