"""The finest waves that views measure of an object, in every direction: one criterion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.geometry.points import evenly_spread

DIRECTIONS = 1000
"""Directions over the half sphere, 4.5 degrees apart. Fewer miss the gaps between 33 views, more
take longer; the worst one is refined."""

SAMPLE = 100  # points of a volume that its figures are taken over; all give the same to 1 %
_STEP = math.radians(4.5)  # first, from the worst of these directions to the worst of all
_CHUNK = 2_000_000  # wavelengths computed at once, 16 MB; more need more memory

_ALONG_AXIS = math.cos(math.radians(20.0))
"""Cosine up to which a direction goes by the name of an axis; it says where, not by how much."""

AS_LARGE = 0.9
"""Wavelength, relative to the object's extent along the same direction, from which shapes are a
guess: half a wave is then half of the object. Three evenly spread views reach 1.0, four 0.77."""


@dataclass(frozen=True, eq=False)
class ResolvedWavelength:
    """The wavelengths that views measure of an object; made by `ViewsOfObject.resolved`.

    Attributes
    ----------
    half, nine_tenths : float
        The 50 % and 90 % quantiles of the wavelength over directions and points: half of all
        waves, and nine tenths, are measured down to it. Infinite where no view sees the object.
    worst, worst_direction : float, (3,) float64
        The largest wavelength over all directions, its median over the points; its unit vector.
    of_length : float
        The largest wavelength relative to the object's extent along the same direction, which is
        ``sqrt(12 n^T S n)``: a flat object has no waves across it. 0 where voxels alone limit it.
    voxel : float
        A voxel's edge length.
    """

    half: float
    nine_tenths: float
    worst: float
    worst_direction: NDArray[np.float64]
    of_length: float
    voxel: float

    @property
    def is_coarse(self) -> bool:
        """Whether details as large as the object itself are not measured in some direction."""
        return self.of_length >= AS_LARGE

    def words(self, length_unit: str) -> str:
        """Return the figures as a clause: ``half of all details down to ... are measured``."""
        if not math.isfinite(self.nine_tenths):
            return "no detail is measured in some directions"
        half, most, worst = (
            short(length / self.voxel) for length in (self.half, self.nine_tenths, self.worst)
        )
        unit = "voxel" if half == "1" else "voxels"
        if worst == half:
            return f"all details down to {half} {unit} are measured"
        return (
            f"half of all details down to {half} {unit} ({short(self.half)} {length_unit}) are "
            f"measured, 90 % down to {most} ({short(self.nine_tenths)} {length_unit}); least: "
            f"flat layers across {direction_words(self.worst_direction)} "
            f"({short(self.worst)} {length_unit})"
        )

    def report(self) -> dict[str, object]:
        """Return the figures as plain data, in the object's length unit."""
        return {
            "half": self.half,
            "nine_tenths": self.nine_tenths,
            "worst": self.worst,
            "worst_direction": self.worst_direction.tolist(),
            "worst_direction_in_words": direction_words(self.worst_direction),
            "of_length": self.of_length,
        }


@dataclass(frozen=True, eq=False)
class ViewsOfObject:
    """How views look at an object, for the waves that they measure of it.

    Attributes
    ----------
    lines : (N, C, 3) float64
        Unit vectors between N points of the object and C cameras; the sign does not matter.
    seen : (N, C) bool
        Which cameras see a point. Points that none sees do not count.
    footprint : (N, C) float64
        Size of a pixel at a point; NaN where unknown.
    covariance : (3, 3) float64
        Of the positions in the object, see `object_length`.
    voxel : float
        A voxel's edge length.

    Notes
    -----
    By the central-slice theorem a view along ``d`` measures the spatial frequencies ``k`` with
    ``k . d = 0``. The spectrum of an object of the length ``L`` along ``d`` is known everywhere
    from samples ``1 / L`` apart along ``d`` (Shannon's sampling theorem with space and frequency
    exchanged), so that each slice stands for what lies within ``1 / (2 L)`` of it:

        |k . d| <= 1 / (2 L) .

    A wave of the length ``lambda`` along the unit vector ``n`` has ``k = n / lambda``. View ``i``
    therefore measures it where ``lambda >= 2 |n . d_i| L_i``. One view is enough. None measures
    waves shorter than two of its pixels ``p_i``, and those shorter than a voxel ``v`` are of no
    use to the volume:

        lambda(n) = min_i max(2 |n . d_i| L_i, 2 p_i, v) .

    For N views evenly spread over a half circle about an object of the length ``L`` the worst
    direction gives ``2 L sin(90 / N degrees)``, which is Crowther's ``pi L / N`` (Proc. R. Soc.
    Lond. A 317, 319, 1970). At that limit ``sinc^2(1/2)``, two fifths of a wave's amplitude,
    comes back through one view; four fifths through two neighbouring ones.
    """

    lines: NDArray[np.float64]
    seen: NDArray[np.bool_]
    footprint: NDArray[np.float64]
    covariance: NDArray[np.float64]
    voxel: float

    def at(self, points: NDArray[np.int64]) -> ViewsOfObject:
        """Return the views of some of the points."""
        lines, seen, footprint = self.lines[points], self.seen[points], self.footprint[points]
        return replace(self, lines=lines, seen=seen, footprint=footprint)

    def without(self, camera: int) -> ViewsOfObject:
        """Return the views without one camera's."""
        return replace(self, seen=self.seen & (np.arange(self.seen.shape[1]) != camera))

    def with_camera_at(
        self, position: ArrayLike, points: NDArray[np.float64], footprint: NDArray[np.float64]
    ) -> ViewsOfObject:
        """Return the views with those of one more camera, which sees all points ``(N, 3)``.

        Its pixels there are of the size ``footprint`` ``(N,)``.
        """
        lines = points - np.asarray(position, np.float64)
        lines = lines / np.maximum(np.linalg.norm(lines, axis=1, keepdims=True), 1e-300)
        return replace(
            self,
            lines=np.concatenate([self.lines, lines[:, None]], axis=1),
            seen=np.concatenate([self.seen, np.ones((len(lines), 1), bool)], axis=1),
            footprint=np.concatenate([self.footprint, footprint[:, None]], axis=1),
        )

    def wavelengths(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ``lambda(n)`` at points along unit vectors ``(M, 3)``: ``(N, M)``, inf unseen."""
        lengths = object_length(self.lines, self.covariance)  # (N, C)
        finest = np.fmax(2 * self.footprint, self.voxel)  # (N, C)
        found = 2 * np.abs(self.lines @ directions.T) * lengths[..., None]  # (N, C, M)
        found = np.maximum(found, finest[..., None])
        return np.where(self.seen[..., None], found, np.inf).min(axis=1)

    def resolved(self, weights: NDArray[np.float64] | None = None) -> ResolvedWavelength:
        """Return the quantiles over points and directions, and the worst direction.

        Points stand for parts of the object, ``weights`` ``(N,)``; equal when None.
        """
        weights = np.ones(len(self.lines)) if weights is None else weights
        some = np.flatnonzero(self.seen.any(axis=1))
        directions = half_sphere(DIRECTIONS)
        if not some.size:
            return ResolvedWavelength(
                math.inf, math.inf, math.inf, directions[0], math.inf, self.voxel
            )
        some = some[evenly_spread(len(some), SAMPLE)]
        views = self.at(some)
        found = views.wavelengths(directions)  # (n, M)
        half, nine_tenths = _quantiles(found, weights[some], (0.5, 0.9))
        along = np.median(found, axis=0)  # (M,)
        worst, direction = views._worst_near(directions[along.argmax()])
        spread = np.einsum("mi,ij,mj->m", directions, self.covariance, directions)
        ratio = along / np.sqrt(12 * spread)
        ratio = float(np.where(along > 2 * self.voxel, ratio, 0.0).max())
        return ResolvedWavelength(half, nine_tenths, worst, direction, ratio, self.voxel)

    def at_points(self) -> NDArray[np.float64]:
        """Return the 90 % quantile over directions at each point, ``(N,)``; NaN if unseen."""
        directions = half_sphere(DIRECTIONS // 5)
        quantile = np.full(len(self.lines), np.nan)
        some = np.flatnonzero(self.seen.any(axis=1))
        step = max(1, _CHUNK // (self.lines.shape[1] * len(directions)))
        for first in range(0, len(some), step):
            now = some[first : first + step]
            quantile[now] = np.quantile(self.at(now).wavelengths(directions), 0.9, axis=1)
        return quantile

    def growth_without(self) -> NDArray[np.float64]:
        """Return how `at_points`' median grows without each camera ``(C,)``; inf without any."""
        views = self.at(evenly_spread(len(self.lines), SAMPLE // 2))
        before = _finite_median(views.at_points())
        cameras = range(self.seen.shape[1])
        after = np.array([_finite_median(views.without(c).at_points()) for c in cameras])
        seeing = views.seen.any(axis=0)
        growth = np.where(np.isfinite(after), np.maximum(after - before, 0.0), np.inf)
        return np.where(seeing, growth, 0.0)

    def _worst_near(self, direction: NDArray) -> tuple[float, NDArray[np.float64]]:
        """Climb to the largest wavelength nearby, its median over the points; return both."""
        value = float(np.median(self.wavelengths(direction[None])))
        step, angles = _STEP, np.arange(8)[:, None] * math.pi / 4
        while step > 1e-4:
            first = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
            first /= np.linalg.norm(first)
            second = np.cross(direction, first)
            tried = direction + step * (np.cos(angles) * first + np.sin(angles) * second)
            tried /= np.linalg.norm(tried, axis=1, keepdims=True)
            values = np.median(self.wavelengths(tried), axis=0)
            if values.max() > value * (1 + 1e-9):
                value, direction = float(values.max()), tried[values.argmax()]
            else:
                step /= 2
        return value, direction


def object_length(
    directions: NDArray[np.float64], covariance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return an object's length along unit vectors ``(..., 3)``: ``sqrt(12 / d^T S^-1 d)``.

    Normally distributed positions of covariance ``S`` have the variance ``1 / d^T S^-1 d`` on
    every line along ``d``; a uniform piece of that length has it too. For a box with edges ``e``
    along the axes it is ``1 / sqrt(sum_j (d_j / e_j)^2)``: hardly more than the width aslant.
    """
    inverse = np.linalg.inv(covariance)
    squares = np.einsum("...i,ij,...j->...", directions, inverse, directions)
    return np.sqrt(12 / squares)


def box_covariance(extent: ArrayLike) -> NDArray[np.float64]:
    """Return the covariance ``(3, 3)`` of the positions in a box with edges ``extent`` (3,)."""
    return np.diag(np.asarray(extent, np.float64) ** 2 / 12)


def half_sphere(count: int) -> NDArray[np.float64]:
    """Return unit vectors evenly spread over half a sphere, ``(count, 3)``: a golden spiral."""
    index = np.arange(count) + 0.5
    height, angle = index / count, np.pi * (1 + 5**0.5) * index
    level = np.sqrt(1 - height**2)
    return np.stack([level * np.cos(angle), height, level * np.sin(angle)], axis=-1)


def closing_view(
    direction: NDArray[np.float64], lines: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return the viewing direction across ``direction`` that is closest to ``lines`` ``(C, 3)``.

    It measures those waves down to the pixel; for a ring it lies in its plane. None if
    undetermined.
    """
    across = lines - (lines @ direction)[:, None] * direction
    values, vectors = np.linalg.eigh(across.T @ across)
    return vectors[:, -1] if values[-1] > 1e-12 else None


def _quantiles(values: NDArray, weights: NDArray, levels: tuple[float, ...]) -> list[float]:
    """Return quantiles of values ``(N, M)`` whose rows have weights ``(N,)``."""
    flat, heavy = values.ravel(), np.repeat(weights, values.shape[1])
    order = np.argsort(flat, kind="stable")
    reached = np.cumsum(heavy[order]) / heavy.sum()
    places = np.minimum(np.searchsorted(reached, levels), len(flat) - 1)
    return [float(value) for value in flat[order][places]]


def _finite_median(values: NDArray) -> float:
    """Return the median of the finite values; NaN without any."""
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else math.nan


def short(value: float) -> str:
    """Return a number of two digits, without an exponent where it is large."""
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"


def direction_words(direction: NDArray[np.float64]) -> str:
    """Return a direction as the name of the axis that it follows, or as a vector."""
    direction = direction * math.copysign(1.0, direction[np.abs(direction).argmax()])
    axis = int(np.abs(direction).argmax())
    if abs(direction[axis]) >= _ALONG_AXIS:
        return "xyz"[axis]
    return "(" + ", ".join(f"{round(value, 1) + 0.0:g}" for value in direction) + ")"
