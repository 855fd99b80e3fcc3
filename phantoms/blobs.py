"""Gaussian blobs: the phantom whose line integrals are known in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phantoms.field import REFERENCE_EXTENT, as_points, checked_box, checked_seed

_RANDOM_COUNT = 24  # blobs of a random field
_RANDOM_WIDTHS = (0.5, 1.0)  # sigma in the reference box, mm
_CLEARANCE = 6.0  # widths between a blob's centre and the box: exp(-18) = 1.5e-8 at the face


@dataclass(frozen=True)
class GaussianBlobs:
    """A sum of isotropic Gaussians ``amplitude · exp(-|x - centre|² / (2 width²))``.

    Parameters
    ----------
    centers : (N, 3)
        Middles of the blobs in world coordinates.
    widths : (N,)
        Standard deviations in world units.
    amplitudes : (N,)
        Peak values, >= 0.

    Raises
    ------
    ValueError
        If shapes disagree, a width is not positive or an amplitude is negative.

    Examples
    --------
    >>> blob = GaussianBlobs([[0, 0, 0]], [1], [2])
    >>> blob([0, 0, 0])
    array(2.)
    """

    centers: tuple[tuple[float, float, float], ...]
    widths: tuple[float, ...]
    amplitudes: tuple[float, ...]

    def __post_init__(self) -> None:
        """Normalise to plain tuples, so that blobs compare, hash and print as values."""
        centers = np.asarray(self.centers, np.float64)
        widths = np.asarray(self.widths, np.float64)
        amplitudes = np.asarray(self.amplitudes, np.float64)
        if centers.ndim != 2 or centers.shape[1] != 3 or not np.isfinite(centers).all():
            raise ValueError(f"blob centers: found {centers.shape}, expected finite (N, 3)")
        n = len(centers)
        if widths.shape != (n,) or not (np.isfinite(widths).all() and (widths > 0).all()):
            raise ValueError(f"blob widths: found {self.widths}, expected {n} positive lengths")
        if amplitudes.shape != (n,) or not (
            np.isfinite(amplitudes).all() and (amplitudes >= 0).all()
        ):
            raise ValueError(f"blob amplitudes: found {self.amplitudes}, expected {n} values >= 0")
        object.__setattr__(self, "centers", tuple(map(tuple, centers.tolist())))
        object.__setattr__(self, "widths", tuple(widths.tolist()))
        object.__setattr__(self, "amplitudes", tuple(amplitudes.tolist()))

    @classmethod
    def random(
        cls,
        seed: int = 0,
        extent: ArrayLike = REFERENCE_EXTENT,
        center: ArrayLike = (0.0, 0.0, 0.0),
    ) -> GaussianBlobs:
        """Return 24 random blobs inside a box; the field at its faces is below 1e-6.

        Blobs are isotropic in every box: widths scale with the box's tightest axis.
        """
        seed = checked_seed("GaussianBlobs", seed)
        edges, middle = (np.asarray(v) for v in checked_box("GaussianBlobs", extent, center))
        random = np.random.default_rng(seed)
        low, high = np.multiply(_RANDOM_WIDTHS, (edges / REFERENCE_EXTENT).min())
        widths = low + (high - low) * random.random(_RANDOM_COUNT)
        room = edges / 2 - _CLEARANCE * widths[:, None]  # (N, 3)
        centers = middle + room * (2 * random.random((_RANDOM_COUNT, 3)) - 1)
        amplitudes = 0.25 + 0.75 * random.random(_RANDOM_COUNT)
        return cls(centers.tolist(), tuple(widths.tolist()), tuple(amplitudes.tolist()))

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the values ``(...)``, float64, at ``points`` ``(..., 3)``."""
        points = as_points(points)
        values = np.zeros(points.shape[:-1])
        for center, width, amplitude in self._blobs():
            square = ((points - center) ** 2).sum(axis=-1)
            values += amplitude * np.exp(-square / (2 * width**2))
        return values

    def line_integral(
        self, origins: ArrayLike, directions: ArrayLike, lengths: ArrayLike = np.inf
    ) -> NDArray[np.float64]:
        """Return the exact integral along straight lines that start at ``origins``.

        With ``t`` the distance along the line to the point nearest to a blob and ``b`` the
        distance between them there, a blob of width ``s`` and amplitude ``a`` adds::

            a exp(-b² / 2s²) s √(π/2) [erf((length - t) / (√2 s)) + erf(t / (√2 s))]

        Parameters
        ----------
        origins, directions : (..., 3)
            World coordinates; directions are normalised here.
        lengths : (...)
            Lengths of the lines, >= 0; infinite by default. For a whole line, start it far outside
            the blobs.

        Raises
        ------
        ValueError
            If a direction is zero or a length negative or NaN.
        """
        from scipy.special import erf  # slow to import

        start, way = as_points(origins), as_points(directions)
        far = np.asarray(lengths, np.float64)
        norms = np.linalg.norm(way, axis=-1, keepdims=True)
        if not (norms > 0).all():
            raise ValueError("line directions: found a zero vector, expected non-zero")
        if not (far >= 0).all():
            raise ValueError("line lengths: found a negative or NaN length, expected >= 0")
        way = way / norms
        total = np.zeros(np.broadcast_shapes(start.shape[:-1], way.shape[:-1], far.shape))
        for center, width, amplitude in self._blobs():
            offset = center - start
            along = (offset * way).sum(axis=-1)
            # The vector across, not |offset|² - along²: for far origins that difference cancels.
            across = offset - along[..., None] * way
            decay = np.exp(-(across**2).sum(axis=-1) / (2 * width**2))
            scale = math.sqrt(2) * width
            covered = erf((far - along) / scale) + erf(along / scale)
            total += amplitude * width * math.sqrt(math.pi / 2) * decay * covered
        return total

    def _blobs(self) -> zip:
        return zip(self.centers, self.widths, self.amplitudes, strict=True)
