"""Lens distortion: OpenCV's models behind one pair of maps."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs.lens import fisheye, perspective

#: Permitted numbers of coefficients of each model.
COEFFICIENT_COUNTS: dict[str, tuple[int, ...]] = {
    "none": (0,),
    "brown": (4, 5),
    "rational": (8,),
    "thin_prism": (12,),
    "tilted": (14,),
    "fisheye": (4,),
}


@dataclass(frozen=True)
class Distortion:
    """A lens model and its coefficients, on the image plane at distance one.

    Parameters
    ----------
    model : {"none", "brown", "rational", "thin_prism", "tilted", "fisheye"}
        OpenCV's models. All but ``fisheye`` see only points in front of the camera.
    coefficients : sequence of float
        In OpenCV's order. ``brown``: k1 k2 p1 p2 [k3]; ``rational`` adds k4 k5 k6,
        ``thin_prism`` adds s1 s2 s3 s4, ``tilted`` adds the sensor's tilts tau_x tau_y in
        radians. ``fisheye``: k1 k2 k3 k4 of theta_d = theta (1 + k1 theta² + ...).

    Raises
    ------
    ValueError
        If the model is unknown, the count is not the model's, or a coefficient is not finite.

    Notes
    -----
    Distortion polynomials fold: beyond some angle the image moves back, and two directions share
    a pixel. The *domain* of a lens extends from the axis to the first fold in each direction: on
    the straight line from the axis the symmetric part of the Jacobian is positive definite. Both
    maps are restricted to it, so each is the other's inverse.

    Examples
    --------
    >>> Distortion("brown", (-0.2, 0.05, 0.0, 0.0))
    Distortion(model='brown', coefficients=(-0.2, 0.05, 0.0, 0.0))
    """

    model: str = "none"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Normalise to plain floats, so that distortions compare, hash and print as values."""
        if not isinstance(self.model, str) or self.model not in COEFFICIENT_COUNTS:
            raise ValueError(
                f"distortion.model: found {self.model!r}, "
                f"expected one of {', '.join(COEFFICIENT_COUNTS)}"
            )
        coefficients = _finite(self.coefficients)
        counts = COEFFICIENT_COUNTS[self.model]
        if len(coefficients) not in counts:
            raise ValueError(
                f"distortion.coefficients: found {len(coefficients)} for model {self.model}, "
                f"expected {' or '.join(str(n) for n in counts)}"
            )
        if self.model == "tilted" and max(abs(tau) for tau in coefficients[12:]) >= math.pi / 2:
            raise ValueError(
                f"distortion.coefficients: found tilts {coefficients[12]} and {coefficients[13]}"
                " rad for model tilted, expected less than a right angle"
            )
        object.__setattr__(self, "coefficients", coefficients)

    def project(self, points: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
        """Return the image plane coordinates of ``points``, and their validity.

        Parameters
        ----------
        points : (N, 3) float64
            In the camera's axes: x right, y down, z forward.

        Returns
        -------
        plane : (N, 2) float64
            Image coordinates in focal lengths; NaN where not valid.
        valid : (N,) bool
            Inside the lens's domain (and in front of the camera, except for a fisheye).
        """
        if self.model == "fisheye":
            return fisheye.project(self.coefficients, points)
        return perspective.project(self.coefficients, points)

    def unproject(self, plane: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the unit vectors ``(N, 3)`` seen at ``plane`` ``(N, 2)``; NaN where none is."""
        if self.model == "fisheye":
            return fisheye.unproject(self.coefficients, plane)
        return perspective.unproject(self.coefficients, plane)


def _finite(coefficients: Iterable[float]) -> tuple[float, ...]:
    """Return ``coefficients`` as plain floats, or say which of them is no finite number."""
    try:
        values = tuple(float(c) for c in np.asarray(coefficients, np.float64).reshape(-1))
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f"distortion.coefficients: found {coefficients!r}, expected numbers"
        ) from None
    for index, value in enumerate(values):
        if not math.isfinite(value):
            raise ValueError(
                f"distortion.coefficients: found {value} at position {index}, "
                "expected finite numbers"
            )
    return values
