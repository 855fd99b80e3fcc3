"""Gas that absorbs: rays whose segments count by the fraction of their light that arrives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.operators.attenuation import transmission
from tomo.rays import Rays
from tomo.trace import Segments

Tracer = Callable[[Rays], Segments]


@dataclass(frozen=True)
class Absorption:
    """How strongly the gas in the grid absorbs.

    Attributes
    ----------
    medium : float
        ``k`` of an even medium that fills the grid, in 1 / length.
    emission : float
        ``q`` of gas that absorbs in proportion to its emission, in 1 / (emission * length).

    Notes
    -----
    A pixel shows ``sum_s l_s exp(-k d_s - q (sum_n E_n l_n + E_s l_s / 2)) x_s``
    (`tomo.operators.attenuation`): linear in the unknowns ``x`` once the emission ``E`` in the
    exponent is given. Outer iterations make both the same.

    Raises
    ------
    ValueError
        If one is negative or not finite.
    """

    medium: float = 0.0
    emission: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("medium", "emission"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(
                    f"absorption {name}: found {value}, expected a finite number >= 0"
                )

    def __bool__(self) -> bool:
        """Whether anything absorbs."""
        return bool(self.medium > 0 or self.emission > 0)


def attenuating(
    tracer: Tracer,
    grid: VoxelGrid,
    absorption: Absorption,
    emission: NDArray[np.floating] | None = None,
) -> Tracer:
    """Return the tracer whose lengths are times the fraction of light that arrives.

    Parameters
    ----------
    tracer : callable
        From `tomo.trace.tracing`, with midpoints.
    grid : VoxelGrid
    absorption : Absorption
    emission : (voxels,), optional
        Of every voxel number that the tracer gives; needed where ``absorption.emission`` is not 0.
    """
    strengths = absorption.medium, absorption.emission

    def trace(rays: Rays) -> Segments:
        single = replace(rays, pixel_ptr=np.arange(len(rays) + 1))  # each sees its own way
        plain = tracer(single)
        arriving = transmission(plain, single, grid, *strengths, emission)
        return Segments(plain.ptr[rays.pixel_ptr], plain.voxel, plain.length * arriving)

    return trace
