"""Gain and background of every view: the affine model ``b = g (A x) + o``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

NOTEWORTHY = 0.005
"""Relative scatter below which gains are not corrected: it is below the error of most cameras."""


@dataclass(frozen=True, eq=False)
class Gains:
    """The gains and the offsets of the views, ``(views,)`` each.

    A pixel of view ``v`` shows ``b = g_v (A x) + o_v``; corrected images are ``(b - o_v) / g_v``.
    """

    gain: NDArray[np.float64]
    """``g``: geometric mean 1 over those that were fitted; 1: none could be."""
    offset: NDArray[np.float64]  # ``o``, in the images' unit; 0 where nothing could be fitted
    gain_error: NDArray[np.float64]  # standard error; infinite where nothing could be fitted
    offset_error: NDArray[np.float64]  # the same

    @classmethod
    def none(cls, n_views: int) -> Gains:
        """Return gains of 1 and offsets of 0, known for certain."""
        zero = np.zeros(n_views)
        return cls(np.ones(n_views), zero, zero, zero)

    def __repr__(self) -> str:
        """Name the range of the gains."""
        low, high = self.gain.min(initial=1.0), self.gain.max(initial=1.0)
        return f"<Gains: {len(self.gain)} views, {low:.3f} to {high:.3f}>"

    @property
    def disagreement(self) -> float:
        """RMS of the gains' logarithms over the views that could be fitted."""
        logs = np.log(self.gain[np.isfinite(self.gain_error)])
        return float(np.sqrt(np.mean(logs**2))) if len(logs) > 1 else 0.0

    def report(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the gains by camera ``names``, as plain numbers for a report."""
        return {
            "gain": dict(zip(names, self.gain.tolist(), strict=True)),
            "offset": dict(zip(names, self.offset.tolist(), strict=True)),
            "gain_error": dict(zip(names, self.gain_error.tolist(), strict=True)),
            "offset_error": dict(zip(names, self.offset_error.tolist(), strict=True)),
            "disagreement": self.disagreement,
        }
