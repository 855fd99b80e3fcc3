"""How near a reconstruction comes to the truth, and a re-projection to what was measured."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.reductions import norm

_SSIM_WINDOW = 7  # pixels or voxels along each edge, the size scikit-image takes by default


def cosine_distance(reconstructed: ArrayLike, truth: ArrayLike) -> float:
    """Return ``1 - a·b / (|a| |b|)``, from 0 (equal up to a positive factor) to 2 (opposite).

    It is computed in float64 as ``|a/|a| - b/|b||² / 2``, which is the same number without the
    cancellation: distances of 1e-9 and less keep their leading digits.

    Parameters
    ----------
    reconstructed, truth : array_like
        Real arrays of equal shape.

    Returns
    -------
    float
        0 if both arrays are zero everywhere, 1 if one of them is, NaN if there is a NaN.

    Raises
    ------
    ValueError
        If the shapes differ.
    """
    a, b = _pair(reconstructed, truth)
    return float(0.5 * np.square(_unit(a) - _unit(b)).sum()) if a.any() == b.any() else 1.0


def cosine_similarity(reconstructed: ArrayLike, truth: ArrayLike) -> float:
    """Return ``a·b / (|a| |b|)``, one minus :func:`cosine_distance`; the paper's figure of merit.

    Two arrays that are zero everywhere have similarity 1; one against another has 0.
    """
    return 1.0 - cosine_distance(reconstructed, truth)


def nrmse(reconstructed: ArrayLike, truth: ArrayLike) -> float:
    """Return ``|a - b| / |b|``: the RMS error divided by the RMS of the truth ``b``.

    Other conventions divide by the truth's range or mean; this one does not depend on how much
    empty space surrounds the object, and it is 1 for a reconstruction of nothing.

    Parameters
    ----------
    reconstructed, truth : array_like
        Real arrays of equal shape.

    Returns
    -------
    float
        For a truth of zeros: 0 if the reconstruction is zero too, infinity otherwise.

    Raises
    ------
    ValueError
        If the shapes differ.
    """
    a, b = _pair(reconstructed, truth)
    error, size = norm(a - b), norm(b)
    if size == 0:
        return 0.0 if error == 0 else math.inf
    return float(error / size)


def relative_residual(projected: ArrayLike, measured: ArrayLike) -> float:
    """Return ``|A x - y| / |y|`` from the re-projection ``A x`` and the measurement ``y``."""
    return nrmse(projected, measured)


def psnr(reconstructed: ArrayLike, truth: ArrayLike, *, data_range: float | None = None) -> float:
    """Return the peak signal-to-noise ratio in decibels, ``20 log10(data_range / RMS error)``.

    Parameters
    ----------
    reconstructed, truth : array_like
        Real arrays of equal shape.
    data_range : float, optional
        The greatest difference that the data can have: 1 for images in 0..1. The truth's maximum
        minus its minimum when None.

    Returns
    -------
    float
        Infinity if the arrays are equal.

    Raises
    ------
    ValueError
        If the shapes differ, or the range is not positive and finite.
    """
    a, b = _pair(reconstructed, truth)
    data_range = _checked_range(data_range, b)
    error = math.sqrt(np.square(a - b).mean())
    return math.inf if error == 0 else 20 * math.log10(data_range / error)


def ssim(reconstructed: ArrayLike, truth: ArrayLike, *, data_range: float | None = None) -> float:
    """Return the mean structural similarity of two images or volumes, 1 if they are equal.

    Wang et al., Image quality assessment (IEEE Trans. Image Process. 13, 2004), as scikit-image
    computes it with its default settings: a uniform window of 7 pixels along each edge.

    Parameters
    ----------
    reconstructed, truth : array_like
        Images ``(h, w)`` or volumes ``(nx, ny, nz)`` of equal shape.
    data_range : float, optional
        As in :func:`psnr`.

    Raises
    ------
    ValueError
        If the shapes differ, an edge is shorter than the window, or the range is not positive
        and finite.
    """
    from skimage.metrics import structural_similarity  # half a second that import need not pay

    a, b = _pair(reconstructed, truth)
    if a.ndim < 2 or min(a.shape) < _SSIM_WINDOW:
        raise ValueError(f"ssim: found shape {a.shape}, expected {_SSIM_WINDOW} or more each way")
    data_range = _checked_range(data_range, b)
    return float(structural_similarity(a, b, win_size=_SSIM_WINDOW, data_range=data_range))


def _pair(
    reconstructed: ArrayLike, truth: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    a, b = np.asarray(reconstructed, np.float64), np.asarray(truth, np.float64)
    if a.shape != b.shape:
        raise ValueError(
            f"arrays to compare: found shapes {a.shape} and {b.shape}, expected equal shapes"
        )
    if a.size == 0:
        raise ValueError(f"arrays to compare: found shape {a.shape}, expected at least one value")
    return a, b


def _unit(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``array`` over its norm; the peak goes first, so that squares cannot overflow."""
    peak = np.abs(array).max()
    if peak == 0:
        return array
    array = array / peak
    return array / norm(array)


def _checked_range(data_range: float | None, truth: NDArray[np.float64]) -> float:
    if data_range is None:
        data_range = float(truth.max() - truth.min())
    if not (math.isfinite(data_range) and data_range > 0):
        raise ValueError(f"data_range: found {data_range}, expected a positive finite number")
    return data_range
