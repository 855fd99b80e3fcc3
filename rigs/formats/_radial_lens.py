"""A radial lens of `rigs.lens` in place of a formula that goes from the image to the pinhole."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.lens import Distortion

_ROUNDS = 5  # of the fit: weights settle in two or three
_COLUMNS = 1e-12  # least singular value of the fit, relative: flat lenses leave terms free


def radial_lens(
    pinhole: NDArray[np.float64], image: NDArray[np.float64]
) -> tuple[Distortion, float]:
    """Return the rational lens nearest to a radial one, and its largest error.

    Parameters
    ----------
    pinhole, image : (N,) float64
        Radii in focal lengths: of points x/z, y/z, and of their images.

    Returns
    -------
    lens : Distortion
        Of the model ``rational``, with radial terms alone.
    error : float
        The largest difference of its images from ``image``, in focal lengths; infinite where a
        point is outside the lens's domain.

    Notes
    -----
    With ``q`` the square of the pinhole's radius,
    ``image / pinhole = (1 + k1 q + k2 q^2 + k3 q^3) / (1 + k4 q + k5 q^2 + k6 q^3)``. Multiplied
    by the denominator it is linear in the coefficients; the last round's denominator divides the
    equations, so that the residual is the image's.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        powers = np.square(pinhole)[:, None] ** (1, 2, 3)
        ratio = np.where(pinhole > 0, image / pinhole, 1.0)
    weight: NDArray = pinhole
    found: NDArray = np.zeros(6)
    for _ in range(_ROUNDS):
        matrix = np.hstack([powers, -ratio[:, None] * powers]) * weight[:, None]
        if not np.isfinite(matrix).all():
            return Distortion(), np.inf
        found = np.linalg.lstsq(matrix, (ratio - 1) * weight, rcond=_COLUMNS)[0]
        with np.errstate(divide="ignore"):
            weight = pinhole / np.abs(1 + powers @ found[3:])
    k1, k2, k3, k4, k5, k6 = found.tolist()
    lens = Distortion("rational", (k1, k2, 0.0, 0.0, k3, k4, k5, k6))
    points = np.stack([pinhole, np.zeros_like(pinhole), np.ones_like(pinhole)], axis=-1)
    plane, valid = lens.project(points)
    return lens, float(np.abs(plane[:, 0] - image).max()) if valid.all() else np.inf
