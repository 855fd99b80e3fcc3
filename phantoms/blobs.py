"""Fields that are no flames: Gaussian blobs, and cells of uncorrelated random values."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phantoms.field import REFERENCE_EXTENT, BoxField, as_points, checked_box, checked_seed

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
        """Return the exact integral along straight lines that start at ``origins`` ``(..., 3)``.

        With ``t`` the distance along the line to the point nearest to a blob and ``b`` the
        distance between them there, a blob of width ``s`` and amplitude ``a`` adds::

            a exp(-b² / 2s²) s √(π/2) [erf((length - t) / (√2 s)) + erf(t / (√2 s))]

        Directions ``(..., 3)`` are normalised here. Lines end after ``lengths`` ``(...)``; for a
        whole line, start it far outside the blobs.

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


@dataclass(frozen=True)
class RandomHomogeneous(BoxField):
    """Equal cells, each of one value drawn uniformly from 0 to 1; the outer layer is dark.

    The paper (arXiv 2010.00893) tests on a "random homogeneous" set without defining it. Here it
    is statistically homogeneous in space and constant within each cell: no structure helps a
    prior. Cells are 1 mm in the reference box, 2 x 2 x 2 voxels of 0.5 mm. The default grids hold
    the field exactly: the error of a reconstruction is the solver's, not the grid's.

    The field is discontinuous between cells: sampling on a grid that cuts cells converges at first
    order only. Cells are half-open, like voxels.

    Parameters
    ----------
    seed, extent, center
        As in :class:`BoxField`.
    cells : (int, int, int)
        Number of cells along x, y, z, the dark outer layer included; at least 3.
    """

    cells: tuple[int, int, int] = (15, 70, 15)
    _values: NDArray[np.float64] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Draw the cells' values."""
        super().__post_init__()
        cells = tuple(int(n) for n in self.cells)
        if len(cells) != 3 or cells != tuple(self.cells) or min(cells) < 3:
            raise ValueError(
                f"RandomHomogeneous cells: found {self.cells}, expected three whole numbers >= 3"
            )
        values = np.zeros(cells)
        inner = tuple(n - 2 for n in cells)
        values[1:-1, 1:-1, 1:-1] = np.random.default_rng(self.seed).random(inner)
        values.flags.writeable = False
        object.__setattr__(self, "cells", cells)
        object.__setattr__(self, "_values", values)

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the value ``(...)``, float64, of the cell that each of ``points`` is in."""
        position = self._in_extents(as_points(points)) + 0.5  # faces at 0 and 1
        index = np.floor(position * self.cells).astype(np.int64)
        inside = np.asarray(((index >= 0) & (index < self.cells)).all(axis=-1))
        index = np.where(inside[..., None], index, 0)  # cell 0 is dark
        return self._values[index[..., 0], index[..., 1], index[..., 2]]
