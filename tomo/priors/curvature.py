"""The prior that the emission is smooth, counted relative to its brightness."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import as_type, namespace, zeros
from tomo._compute.reductions import largest, total
from tomo.grid import ActiveVoxels
from tomo.grid.blur import Blur
from tomo.operators.vectors import by_columns
from tomo.priors.differences import Gradient

AROUND = 3.0
"""Standard deviation of the blur that gives the brightness, in voxels. A narrower one takes noise
of single voxels for brightness, a wider one light of far voxels."""

DARKEST = 0.2
"""Fraction of the largest brightness that darker places count as. Lower weights dark places so
much that noisy images lose detail there, higher leaves their noise in."""


class RelativeCurvature:
    """Second differences weighted by one over the brightness: ``||w D^T D x||²``.

    Parameters
    ----------
    volume : (unknowns,) or (unknowns, columns) float32
        The emission whose brightness counts; columns are as many priors, for as many problems.

    Notes
    -----
    With ``a`` the volume blurred by `AROUND`, ``w = 1 / (a / max a + DARKEST)``, scaled so that
    the mean of ``w²`` over the light is one. ``D^T D`` (`Gradient`) is zero where the emission is
    linear, so that slopes cost nothing.

    References
    ----------
    Penalties relative to the brightness: Nuyts, Bequé, Dupont and Mortelmans, "A concave prior
    penalizing relative differences for maximum-a-posteriori reconstruction in emission
    tomography", IEEE Transactions on Nuclear Science 49 (2002), for first differences.
    """

    def __init__(self, active: ActiveVoxels, volume: NDArray[np.float32]) -> None:
        columns = 1 if volume.ndim == 1 else volume.shape[1]
        self._gradient = Gradient(active, columns)
        self._blur = Blur(active, AROUND)
        self.weights = by_columns(self._weights, volume)  # as volume

    def _weights(self, volume: NDArray[np.float32]) -> NDArray[np.float32]:
        brightness = self._blur(namespace(volume).maximum(volume, 0.0))
        brightness = as_type(brightness, np.float64)
        peak = float(largest(brightness))
        if peak == 0:
            return zeros(volume.shape, volume) + 1
        brightness = brightness / peak
        weights = 1 / (brightness + DARKEST)
        mean = float(total(weights * weights * brightness)) / float(total(brightness))
        return as_type(weights / math.sqrt(mean), np.float32)

    def _second_differences(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``D^T D x``."""
        found = self._gradient.adjoint(self._gradient.forward(values))
        return namespace(values).reshape(found, values.shape)

    def forward(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``w D^T D x`` of the unknowns ``x``, in their shape."""
        return self.weights * self._second_differences(values)

    def adjoint(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``D^T D w p``, in the shape of the weights."""
        field = namespace(field).reshape(field, self.weights.shape)
        return self._second_differences(self.weights * field)
