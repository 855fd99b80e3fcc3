"""How far images are out of focus, found in their spectra."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.fft
import scipy.special
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid

BINS_A_PIXEL = 200
"""Radial bins of the spectrum up to one cycle a pixel."""

PADDED = 512
"""Pixels a side that an image is padded to at least, for rings to cut through its spectrum evenly:
those of small images hold few frequencies."""

LOWEST, HIGHEST = 0.05, 0.4
"""Cycles a pixel between which spectra are looked at. Below, the shape of the flame rules; above,
the pixels' own area."""

NARROWEST, WIDEST, WIDTHS = 3.3, 12.0, 80
"""Pixels across the discs that are tried: of narrower ones no zero lies below `HIGHEST`, of wider
ones most of the spectrum lies beyond it."""

DEGREE = 3
"""Of the polynomial in the logarithm of the frequency that a spectrum in focus is taken for."""

SMEARED = np.linspace(0.96, 1.04, 5)
LEFT_AT_ZERO = 3e-3
"""The zeros of a real disc are filled in: its width is not the same at all depths, nor quite the
same for all cameras."""

ABOVE_NOISE = 3.0
"""Times the power of the noise that a frequency must have to be looked at."""

PAST_ZERO = 1.2
"""Times the first zero's frequency up to which the spectrum must be seen: only a rise past it
tells a zero from a slope."""

CLEAR = 0.65
"""A disc is found where it leaves less than this share of what the polynomial alone leaves of the
logarithm of the spectrum. Discs of 4 pixels leave 0.25 to 0.48 on jets and turbulent flames, with
and without gains, absorption and vignetting beside them; these in focus 1.6 or more."""


def blur_of_images(
    rig: Rig, images: Sequence[NDArray[np.floating]], grid: VoxelGrid
) -> float | None:
    """Return the diameter of the disc that images are blurred by, in the rig's length unit.

    A lens out of focus spreads a point over the image of its pupil, a disc. Its transfer function
    ``2 J1(x) / x``, ``x = pi k d``, is zero on rings, the first at ``k = 1.22 / d``. What no
    projection tells, since an even blur of all images is one of the flame, their spectra may: the
    mean over cameras falls to the first ring and rises, or falls less, past it. The diameter is
    that which, with a smooth spectrum behind it, leaves least of the logarithm of the power; None
    where a smooth spectrum alone is hardly worse.

    Parameters
    ----------
    rig : Rig
        The cameras are taken to be out of focus alike: by one diameter at the grid's centre.
    images : sequence of (height, width)
        One a camera.
    grid : VoxelGrid

    Returns
    -------
    float or None
        None as well where noise hides a zero: white noise of 1e-3 of the brightest pixel leaves
        nothing to see of one at a third of a cycle a pixel. Levels of 16 bits do not hide it, of 8
        bits do.

    Notes
    -----
    Only for images that may well be out of focus, and flames with detail as fine as their pixels.
    Where the spectrum of a smooth flame falls steeply to what its voxels' edges or rounding leave,
    it bends as it does at a ring: 7 of 24 sets of clean images of Gaussian blobs in focus showed
    discs, with 0.53 to 0.64 of `CLEAR`'s measure. Noise hides such bends as it hides rings.

    References
    ----------
    Gennery, "Determination of optical transfer function by inspection of frequency-domain plot",
    Journal of the Optical Society of America 63 (1973).
    """
    sizes = rig.footprint(grid.center)
    if not sizes.min() > 0:  # the grid's centre is not ahead of all
        return None
    pixel = float(np.median(sizes))
    power, noise = _mean_spectrum(images, sizes, pixel)
    frequency = np.arange(len(power)) / BINS_A_PIXEL
    seen = (frequency >= LOWEST) & (frequency <= HIGHEST) & (power > (1 + ABOVE_NOISE) * noise)
    if np.count_nonzero(seen) < 4 * (DEGREE + 1):
        return None
    frequency, logarithm = frequency[seen], np.log(power[seen] - noise)
    widths = np.geomspace(NARROWEST, WIDEST, WIDTHS)
    first_zero = scipy.special.jn_zeros(1, 1)[0] / np.pi / widths
    widths = widths[PAST_ZERO * first_zero <= frequency[-1]]
    smooth = np.vander(np.log(frequency), DEGREE + 1)
    left = [_left_by(smooth, logarithm - np.log(_disc(frequency, width))) for width in widths]
    in_focus = _left_by(smooth, logarithm)
    if not left or not min(left) < CLEAR * in_focus:
        return None
    return float(widths[int(np.argmin(left))]) * pixel


def _mean_spectrum(
    images: Sequence[NDArray[np.floating]], sizes: NDArray[np.float64], pixel: float
) -> tuple[NDArray[np.float64], float]:
    """Return the mean power of all images in rings of the frequency plane, and the noise's.

    Rings in cycles a ``pixel``, whatever the size of a camera's own; every image counts alike,
    whatever its light. The noise's is what is left past half a cycle a pixel, in the corners.
    """
    rings = BINS_A_PIXEL // 2 + 1
    total, count, corner = np.zeros(rings), np.zeros(rings), [0.0, 0.0]
    for image, size in zip(images, sizes, strict=True):
        height, width = image.shape
        window = np.hanning(height)[:, None] * np.hanning(width)
        padded = [scipy.fft.next_fast_len(max(side, PADDED)) for side in image.shape]
        spectrum = scipy.fft.fft2(np.asarray(image, np.float64) * window, padded)
        power = spectrum.real**2 + spectrum.imag**2
        light = float(power[0, 0])
        if not light > 0:
            continue
        own = np.hypot(*np.meshgrid(*map(scipy.fft.fftfreq, padded), indexing="ij"))
        ring = np.rint(own * (BINS_A_PIXEL * pixel / size)).astype(np.int64).ravel()
        within = ring < rings
        total += np.bincount(ring[within], power.ravel()[within] / light, rings)
        count += np.bincount(ring[within], minlength=rings)
        beyond = own > 0.5
        corner[0] += float(power[beyond].sum()) / light
        corner[1] += float(np.count_nonzero(beyond))
    return total / np.maximum(count, 1), corner[0] / max(corner[1], 1.0)


def _disc(frequency: NDArray[np.float64], width: float) -> NDArray[np.float64]:
    """Return the power that a disc of so many pixels lets through, its zeros filled in."""
    x = np.pi * width * frequency[:, None] * SMEARED
    return np.mean((2 * scipy.special.j1(x) / x) ** 2, axis=1) + LEFT_AT_ZERO


def _left_by(smooth: NDArray[np.float64], logarithm: NDArray[np.float64]) -> float:
    """Return the root mean square of what the columns of ``smooth`` do not explain."""
    fitted = smooth @ np.linalg.lstsq(smooth, logarithm, rcond=None)[0]
    return float(np.sqrt(np.mean((logarithm - fitted) ** 2)))
