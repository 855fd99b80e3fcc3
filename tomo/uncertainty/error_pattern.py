"""How large errors are by what a volume looks like, learned where the right answer is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WIDTHS = (1.0, 2.5)
"""Standard deviations, in voxels, of the blurs that describe a voxel's surroundings."""

FLOOR = 1e-3
"""Fraction of the emission's root mean square to which values are raised before the logarithm."""

Volume = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class ErrorPattern:
    """The size of errors as a product of powers of what describes a voxel.

    Attributes
    ----------
    coefficients : (features + 1,) float64
        The exponents, and the logarithm of the factor.
    bounds : (2, features) float64
        The least and the largest logarithms that it was learned from; others are taken for these.
    size : float
        Root mean square of the emission.
    """

    coefficients: NDArray[np.float64]
    bounds: NDArray[np.float64]
    size: float

    def of(self, volume: Volume) -> NDArray[np.float64]:
        """Return the size of the errors of a volume ``(nx, ny, nz)``."""
        found = np.full(volume.shape, self.coefficients[-1])
        features = _features(volume, self.size)
        for feature, power, (low, high) in zip(
            features, self.coefficients, self.bounds.T, strict=False
        ):
            found += power * np.clip(feature, low, high)
        return np.exp(found)


def learned(
    volumes: Sequence[Volume],
    errors: Sequence[Volume],
    where: NDArray[np.bool_],
    size: float,
    level: float | None,
) -> ErrorPattern:
    """Return the pattern of the errors of some volumes.

    Parameters
    ----------
    volumes, errors : sequence of (nx, ny, nz)
    where : (nx, ny, nz) bool
        The voxels to learn from.
    size : float
        Root mean square of the emission.
    level : float, optional
        Fraction of the errors that are to be below the pattern; None: it has their mean square.

    Notes
    -----
    The logarithm of an error is linear in those of the voxel, of its surroundings' means and of
    their roughness; least squares. A factor then makes the pattern as large as `level` says.
    """
    rows = np.concatenate([np.stack([f[where] for f in _features(v, size)]) for v in volumes], 1)
    off = np.concatenate([np.abs(error[where]) for error in errors])
    least = FLOOR * max(float(np.sqrt(np.mean(off**2))), FLOOR * size)
    terms = np.vstack([rows, np.ones(len(off))])
    # einsum adds in one order whatever the number of threads, a matrix product may not
    normal = np.einsum("iv,jv->ij", terms, terms)
    target = np.einsum("iv,v->i", terms, np.log(off + least))
    found = np.linalg.lstsq(normal, target, rcond=1e-9)[0]
    shape = np.exp(np.einsum("i,iv->v", found, terms))
    ratio = off / shape
    factor = np.sqrt(np.mean(ratio**2)) if level is None else np.quantile(ratio, level)
    found[-1] += np.log(max(float(factor), FLOOR**2))
    return ErrorPattern(found, np.stack([rows.min(axis=1), rows.max(axis=1)]), size)


def _features(volume: Volume, size: float) -> list[NDArray[np.float64]]:
    """Return the logarithms of what describes every voxel, ``(nx, ny, nz)`` each."""
    from scipy.ndimage import gaussian_filter

    volume = np.asarray(volume, np.float64)
    near, far = (gaussian_filter(volume, width, mode="constant") for width in WIDTHS)
    rough = np.sqrt(gaussian_filter((volume - near) ** 2, WIDTHS[0], mode="constant"))
    return [np.log(np.maximum(one, FLOOR * size)) for one in (volume, near, far, rough)]
