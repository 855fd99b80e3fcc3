"""A refractive index given at the centres of voxels, smooth in between."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.scene.gas.extinction_volume import VoxelBox
from rigs.scene.gas.follow import follow
from rigs.scene.gas.index_field import Crossing, IndexField, pairs_of_vectors

if TYPE_CHECKING:
    from scipy.interpolate import NdBSpline

CHORD = 0.01
"""Voxels that a path may be from its straight pieces: a hundredth changes what a pixel sees far
less than the emission's voxels do; less makes more pieces, which cost time in every product."""

STEP = 1e-5
"""Voxels that a step may err for each unit by which ``n²`` differs from the medium's: as small
beside the bending of weak gas as of strong, and less than what is left between voxels."""

STEP_ERROR = 3e-3
"""Error of a step through a cell, in voxels, over the fourth differences of ``n²`` around it; 16
times less with each halving. The largest of random values; smooth ones err less."""

TOGETHER = 2
"""Doublings of a step at most: four cells at a time. More would step over what is between."""

SECOND = np.array([1.0, -2.0, 1.0])  # of a second difference

CUT = 0.5
"""Fraction of the largest difference to the medium that may stand in a face's layer of voxels
before it is worth a warning: gas that goes on behind a face is bent by an edge that is none."""


@dataclass(frozen=True, eq=False)
class IndexVolume(VoxelBox, IndexField):
    """A refractive index at the centres of a box of voxels.

    Between the centres ``n²`` is a cubic B-spline through the values, with continuous second
    derivatives; at the box's faces and beyond, ``n`` is the medium's.

    Parameters
    ----------
    values : (nx, ny, nz) array_like
        ``n`` at the voxels' centres.
    lower : (3,) array_like
        The box's lower corner, half a voxel before the first centre.
    spacing : float or (3,)
        Edges of a voxel.
    medium : float
        ``n`` around the box.

    Raises
    ------
    ValueError
        If the shapes are wrong, a number is not finite, or an index is below 1.

    Notes
    -----
    The spline of ``u = n² - medium²`` is odd about each face: it is 0 there, and in the box it
    interpolates to order 4 where ``u`` and its curvature vanish at the faces. A path's error
    falls alike.
    """

    values: NDArray[np.float64]
    lower: NDArray[np.float64]
    spacing: NDArray[np.float64]
    medium: float = 1.0

    if TYPE_CHECKING:  # arrays may be given in any form; the fields are arrays

        def __init__(
            self, values: ArrayLike, lower: ArrayLike, spacing: ArrayLike, medium: float = 1.0
        ) -> None: ...

    def __post_init__(self) -> None:
        """Check the values, and keep them read-only."""
        medium = self.medium
        if not (np.isfinite(medium) and medium >= 1):
            raise ValueError(f"index volume: medium: found {medium}, expected a number >= 1")
        self._keep("index volume", 1, "n >= 1: n itself, not n - 1 or a density")
        object.__setattr__(self, "medium", float(medium))

    def __repr__(self) -> str:
        """Name the box."""
        return (
            f"<IndexVolume: {'x'.join(str(n) for n in self.values.shape)} voxels, n "
            f"{self.values.min():.6g} to {self.values.max():.6g} in {self.medium:.6g}>"
        )

    @cached_property
    def coefficients(self) -> NDArray[np.float64]:
        """Weights of the splines of ``n² - medium²``, ``(nx + 4, ny + 4, nz + 4)``, from -2 on."""
        found = self.values**2 - self.medium**2
        for axis in range(3):
            found = _odd_coefficients(found, axis)
        return np.ascontiguousarray(found)

    @cached_property
    def halvings(self) -> NDArray[np.int8]:
        """How often each cell of the spline is halved for steps, ``(nx + 1, ny + 1, nz + 1)``.

        Negative where cells are taken together: -2 for blocks of four along each axis.
        """
        around = (slice(2, -1),) * 3  # the four splines that are not zero in a cell
        error = STEP_ERROR * _fourth_differences(self.coefficients)[around]
        return _halvings(error / max(float(np.abs(self.coefficients).max()), 1e-300))

    def index(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the index at points ``(N, 3)``; the medium's outside."""
        return np.sqrt(self.medium**2 + self._spline(points, (0, 0, 0)))

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the gradient of the index at points ``(N, 3)``; zero outside."""
        along = [self._spline(points, tuple(row)) for row in np.eye(3, dtype=int).tolist()]
        slopes = np.stack(along, axis=-1) / self.spacing
        return slopes / (2 * self.index(points))[:, None]

    def cross(
        self, origins: ArrayLike, directions: ArrayLike, tolerance: float | None = None
    ) -> Crossing:
        """Return the ways of rays through the box, compiled; see `IndexField.cross`.

        The tolerance is a hundredth of a voxel's shortest edge when None.
        """
        origins, directions = pairs_of_vectors(origins, directions)
        pieces, counts, last, along, trapped = follow(
            self.coefficients, self.halvings, self.medium, self.lower, self.spacing,
            CHORD * self.spacing.min() if tolerance is None else tolerance, origins, directions,
        )  # fmt: skip
        ptr = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])
        starts, ways = (np.ascontiguousarray(pieces[:, some]) for some in (slice(3), slice(3, 6)))
        lengths = np.ascontiguousarray(pieces[:, 6])
        return Crossing(starts, ways, lengths, ptr, last, along, trapped)

    def with_lengths_scaled(self, factor: float) -> Self:
        """Return the volume of a world whose lengths are ``factor`` times as large."""
        return replace(self, lower=self.lower * factor, spacing=self.spacing * factor)

    def warnings(self) -> tuple[str, ...]:
        """Return a line for gas that the box's faces cut."""
        difference = np.abs(self.values - self.medium)
        largest = float(difference.max())
        if largest == 0:
            return ()
        found = []
        for axis, name in enumerate("xyz"):
            for side, words in ((0, "lower"), (-1, "upper")):
                share = float(np.take(difference, side, axis).max()) / largest
                if share > CUT:
                    found.append(f"{words} {name} ({share:.0%})")
        if not found:
            return ()
        return (
            f"index volume: the index at the faces {', '.join(found)} is not yet the medium's, "
            f"{self.medium:.6g}: rays are bent at the face as by a prism. Enlarge the box until "
            "the index is the medium's at its faces",
        )

    @cached_property
    def _interpolant(self) -> NdBSpline:
        from scipy.interpolate import NdBSpline

        knots = tuple(np.arange(-4.0, n + 4) for n in self.values.shape)
        return NdBSpline(knots, self.coefficients, 3)

    def _spline(self, points: ArrayLike, derivative: tuple[int, ...]) -> NDArray[np.float64]:
        """Return the spline of ``n² - medium²`` at points ``(N, 3)``, in voxel units."""
        q = (np.asarray(points, np.float64).reshape(-1, 3) - self.lower) / self.spacing - 0.5
        count = np.array(self.values.shape)
        inside = ((q >= -0.5) & (q <= count - 0.5)).all(axis=1)
        found = np.zeros(len(q))
        if inside.any():
            found[inside] = self._interpolant(q[inside], nu=derivative)
        return found


def _fourth_differences(coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest sum of fourth differences near each coefficient of a spline.

    The neighbours' fourth derivatives: where they vanish, so do a step's error and jumps of cells.
    """
    from scipy.ndimage import correlate1d, maximum_filter

    total = np.zeros_like(coefficients)
    for first in range(3):
        bend = correlate1d(coefficients, SECOND, first, mode="nearest")
        for second in range(first, 3):
            total += np.abs(correlate1d(bend, SECOND, second, mode="nearest"))
    return maximum_filter(total, 4)


def _halvings(error: NDArray[np.float64]) -> NDArray[np.int8]:
    """Return the halvings of cells whose steps err so much, as `STEP` does.

    All cells of a block that is taken together say so: a ray sees the same block from both ends.
    """
    halvings = np.ceil(np.log(np.maximum(error, 1e-300) / STEP) / np.log(16)).astype(np.int64)
    halvings = np.maximum(halvings, -TOGETHER)
    for level in range(1, TOGETHER + 1):
        edge = 2**level
        blocks = [(np.arange(n) - 1) // edge for n in halvings.shape]  # cell 0 begins at centre -1
        blocks = [one - one[0] for one in blocks]
        largest = np.full([one[-1] + 1 for one in blocks], -TOGETHER)
        np.maximum.at(largest, np.ix_(*blocks), halvings)
        halvings = np.maximum(
            halvings, np.where(largest > -level, 1 - level, -TOGETHER)[np.ix_(*blocks)]
        )
    return halvings.astype(np.int8)


def _odd_coefficients(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Return the coefficients along an axis of the cubic B-spline through values at centres.

    It is odd about both ends, half a voxel outside the outer centres; two more at each end.
    """
    from scipy.linalg import solveh_banded

    values = np.moveaxis(values, axis, 0)
    count = len(values)
    bands = np.zeros((2, count))
    bands[0, 1:], bands[1] = 1.0, 4.0
    bands[1, 0] -= 1.0
    bands[1, -1] -= 1.0
    flat = 6 * values.reshape(count, -1)
    flat = flat / bands[1] if count == 1 else solveh_banded(bands, flat)
    found = np.zeros((count + 4, *values.shape[1:]))
    found[2:-2] = flat.reshape(values.shape)
    found[1], found[-2] = -found[2], -found[-3]
    found[0], found[-1] = -found[3], -found[-4]
    return np.moveaxis(found, 0, axis)
