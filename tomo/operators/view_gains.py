"""Sensitivity and background of every view, as they were fitted or are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.by_camera import by_name
from tomo.operators.operator import ProjectionOperator

SIGNIFICANT = 3.0
"""Standard errors by which the gains' scatter must exceed what chance explains."""

NOTEWORTHY = 0.005
"""Relative scatter below which gains are not worth correcting, however significant."""


@dataclass(frozen=True, eq=False)
class Gains:
    """Sensitivity and background of every view.

    Attributes
    ----------
    gain : (views,) float64
        Geometric mean 1 over the views that were fitted; 1 where nothing could be.
    offset : (views,) float64
        In the images' unit; 0 where nothing could be fitted.
    gain_error, offset_error : (views,) float64
        Standard errors; infinite where nothing could be fitted.
    scale : float
        The brightest pixel that was fitted, against which offsets are small or large.
    """

    gain: NDArray[np.float64]
    offset: NDArray[np.float64]
    gain_error: NDArray[np.float64]
    offset_error: NDArray[np.float64]
    scale: float = 1.0

    @classmethod
    def none(cls, n_views: int) -> Gains:
        """Return gains of 1 and offsets of 0, known for certain."""
        zero = np.zeros(n_views)
        return cls(np.ones(n_views), zero, zero, zero)

    def __repr__(self) -> str:
        """Name the range of the gains."""
        low, high = self.gain.min(initial=1.0), self.gain.max(initial=1.0)
        return f"<Gains: {len(self.gain)} views, {low:.3f} to {high:.3f}>"

    def apply(self, projector: ProjectionOperator, projected: ArrayLike) -> NDArray[np.float32]:
        """Return the pixels that the cameras would show: ``g_v y + o_v``, ``(pixels,)``."""
        gain, offset = self._of_pixels(projector)
        return (gain * np.asarray(projected) + offset).astype(np.float32)

    def correct(self, projector: ProjectionOperator, measured: ArrayLike) -> NDArray[np.float32]:
        """Return the pixels that like cameras would have shown: ``(b - o_v) / g_v``."""
        gain, offset = self._of_pixels(projector)
        return ((np.asarray(measured) - offset) / gain).astype(np.float32)

    def correct_weights(
        self, projector: ProjectionOperator, weights: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Return what pixels are worth once they are corrected: ``w g_v²``."""
        gain, _ = self._of_pixels(projector)
        return (gain**2 * weights).astype(np.float32)

    def then(self, further: Gains) -> Gains:
        """Return the gains of images that, corrected by these, still have ``further`` ones."""
        known = np.isfinite(further.gain_error)
        gain = self.gain * further.gain
        return Gains(
            gain / geometric_mean(gain[known]),
            self.offset + self.gain * further.offset,
            further.gain_error,
            self.gain * further.offset_error,
            further.scale,
        )

    @property
    def disagreement(self) -> float:
        """RMS of the gains' logarithms over the views that could be fitted."""
        logs = np.log(self.gain[np.isfinite(self.gain_error)])
        return float(np.sqrt(np.mean(logs**2))) if len(logs) > 1 else 0.0

    @property
    def views_disagree(self) -> bool:
        """Whether gains scatter, or offsets are, far above error and worth correcting."""
        known = np.isfinite(self.gain_error) & (self.gain_error > 0)
        if np.count_nonzero(known) > 1 and self.disagreement > NOTEWORTHY:
            score = np.log(self.gain[known]) * self.gain[known] / self.gain_error[known]
            if np.sum(score**2) > SIGNIFICANT**2 * (np.count_nonzero(known) - 1):
                return True
        known = np.isfinite(self.offset_error) & (self.offset_error > 0)
        far = np.abs(self.offset[known]) > SIGNIFICANT * self.offset_error[known]
        large = np.abs(self.offset[known]) > NOTEWORTHY * self.scale
        return bool((far & large).any())

    def report(self, names: Sequence[str]) -> dict[str, Any]:
        """Return what a report says of the gains: plain numbers; ``names`` are the cameras'."""
        return {
            "gain": by_name(names, self.gain),
            "offset": by_name(names, self.offset),
            "gain_error": by_name(names, self.gain_error),
            "disagreement": self.disagreement,
        }

    def _of_pixels(self, projector: ProjectionOperator) -> tuple[NDArray, NDArray]:
        counts = np.diff(projector.view_ptr)
        if len(counts) != len(self.gain):
            raise ValueError(
                f"gains: found {len(self.gain)}, expected one for each of {len(counts)} views"
            )
        return np.repeat(self.gain, counts), np.repeat(self.offset, counts)


def geometric_mean(gain: NDArray[np.float64]) -> float:
    """Return the geometric mean; 1 of nothing."""
    return float(np.exp(np.mean(np.log(gain)))) if len(gain) else 1.0
