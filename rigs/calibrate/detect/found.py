"""The detection of a target in one image, and helpers for all kinds of targets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

_SEARCHED = 1600  # pixels of the longer side; more take longer and find no more
_FARTHEST = 0.3  # grid steps RMS from a homography; a strong lens stays below


@dataclass(frozen=True, eq=False)
class Found:
    """The target's points in one image: their indices and pixels, centres at integers.

    ``blur`` is the standard deviation of edges in pixels, the median; ``reason`` why nothing was
    found; ``legacy`` which of two layouts the markers show, None where both fit.
    """

    point: NDArray[np.int64]
    uv: NDArray[np.float64]
    blur: float
    reason: str = ""
    legacy: bool | None = None

    @classmethod
    def nothing(cls, reason: str) -> Found:
        """Return the detection of an image without the target."""
        return cls(np.zeros(0, np.int64), np.zeros((0, 2)), float("nan"), reason)


@dataclass(frozen=True, eq=False)
class Search:
    """One image in two forms: small and 8-bit to search, whole to measure."""

    whole: NDArray[np.float32]  # (rows, columns)
    small: NDArray[np.uint8]  # contrast stretched to the full range, at most 1600 pixels across

    @classmethod
    def of(cls, image: NDArray) -> Search:
        """Prepare a grey ``image`` ``(rows, columns)`` of any type of number."""
        whole = np.ascontiguousarray(image, np.float32)
        shrink = max(1.0, max(whole.shape) / _SEARCHED)
        small: NDArray = whole
        if shrink > 1:
            size = [max(1, round(length / shrink)) for length in whole.shape[::-1]]
            small = cv2.resize(whole, size, interpolation=cv2.INTER_AREA)
        low, high = np.percentile(small, (0.5, 99.5))
        stretched = (small - low) * (255 / max(high - low, 1e-20))
        return cls(whole, np.clip(np.round(stretched), 0, 255).astype(np.uint8))

    def negative(self) -> Search:
        """Return the image with dark and bright exchanged."""
        return Search(-self.whole, 255 - self.small)

    def mirrored(self) -> Search:
        """Return the image with left and right exchanged."""
        whole, small = self.whole[:, ::-1], self.small[:, ::-1]
        return Search(np.ascontiguousarray(whole), np.ascontiguousarray(small))

    def in_whole(self, uv: NDArray) -> NDArray[np.float64]:
        """Return pixel coordinates ``(..., 2)`` of the small image as those of the whole one."""
        scale = np.array(self.whole.shape[::-1]) / self.small.shape[::-1]
        return (np.asarray(uv, np.float64) + 0.5) * scale - 0.5


def local_axes(positions: NDArray[np.float64], uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each point's derivative of pixels by steps along the target's x and y.

    ``(points, 2, 2)``, of an affine map fitted to the point's neighbours.
    """
    apart = positions[None] - positions[:, None]  # (points, others, 2)
    # Far points have little weight, but determine a direction without a neighbour
    weight = np.exp(-0.5 * np.sum(apart**2, axis=-1)) + 1e-4
    terms = np.concatenate([apart, np.ones((*apart.shape[:2], 1))], axis=-1)
    normal = np.einsum("ij,ija,ijb->iab", weight, terms, terms)
    right = np.einsum("ij,ija,jc->iac", weight, terms, uv)
    return np.linalg.solve(normal, right)[:, :2].transpose(0, 2, 1)


def is_flat_patch(positions: NDArray[np.float64]) -> bool:
    """Return whether ``positions`` ``(points, 2)`` are four or more and not on one line."""
    if len(positions) < 4:
        return False
    spread = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    return bool(spread[1] > 1e-3 * spread[0] and spread[1] > 0.4)


def smooth_map(
    positions: NDArray[np.float64], uv: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fit a homography and, given enough points, a polynomial for the lens; return ``uv`` by it.

    And its second derivatives along the target's x, y, pixels by step²: the curvature of edges.
    """
    homography = cv2.findHomography(positions, uv, 0)[0]
    if homography is None:
        return uv.copy(), np.zeros((len(uv), 2, 2))
    straight = cv2.perspectiveTransform(positions[None], homography)[0]
    middle = positions.mean(axis=0)
    scale = max(np.abs(positions - middle).max(), 1e-9)
    x, y = ((positions - middle) / scale).T
    for order, least in ((3, 20), (2, 10)):
        powers = [(i, j) for i in range(order + 1) for j in range(order + 1 - i)]
        counts = [len(np.unique(positions[:, axis])) for axis in (0, 1)]
        if len(positions) < least or min(counts) <= order:
            continue
        terms = np.stack([x**i * y**j for i, j in powers], axis=-1)  # (points, terms)
        weight = np.ones(len(positions))
        for _ in range(3):  # robust against a corner far off
            left = weight[:, None] * terms, weight[:, None] * (uv - straight)
            factors = np.linalg.lstsq(*left, rcond=None)[0]  # (terms, 2)
            off = np.linalg.norm(uv - straight - terms @ factors, axis=-1)
            limit = 4 * np.median(off) + 1e-6
            weight = np.minimum(1, limit / np.maximum(off, 1e-12))
        second = np.zeros((len(positions), 2, len(powers)))
        for k, (i, j) in enumerate(powers):
            if i >= 2:
                second[:, 0, k] = i * (i - 1) * x ** (i - 2) * y**j
            if j >= 2:
                second[:, 1, k] = j * (j - 1) * x**i * y ** (j - 2)
        return straight + terms @ factors, second @ factors / scale**2
    return straight, np.zeros((len(uv), 2, 2))


def orders(uv: NDArray[np.float64], positions: NDArray[np.float64], columns: int) -> Iterator:
    """Yield the orders ``(points,)`` in which an image's points may be the target's, row by row.

    The search begins at any corner and goes along columns or rows; seen from its front a target
    has the image's handedness, and a homography maps it. ``uv[order]`` are the images of
    ``positions``; the order whose first point is nearest to the image's upper left comes first.
    """
    grid = np.arange(len(uv)).reshape(-1, columns)
    turned = [np.rot90(side, turn) for side in (grid, grid[:, ::-1]) for turn in range(4)]
    possible = []
    for order in (side.ravel() for side in turned if side.shape == grid.shape):
        homography = cv2.findHomography(positions, uv[order], 0)[0]
        if homography is None:
            continue
        off = cv2.perspectiveTransform(positions[None], homography)[0] - uv[order]
        steps = np.column_stack([positions - positions.mean(axis=0), np.ones(len(positions))])
        axes = np.linalg.lstsq(steps, uv[order], rcond=None)[0][:2]
        if np.linalg.det(axes) > 0:
            step = np.sqrt(np.linalg.det(axes))
            possible.append((np.sqrt(np.mean(off**2)) / step, order))
    least = min((off for off, _ in possible), default=1.0)
    kept = [order for off, order in possible if off < 1.01 * least + 1e-3 and off < _FARTHEST]
    yield from sorted(kept, key=lambda order: float(uv[order[0]].sum()))


def lattice(columns: NDArray, rows: NDArray, asymmetric: bool = False) -> NDArray[np.float64]:
    """Return positions ``(..., 2)`` of columns and rows of a grid, in row spacings."""
    if asymmetric:
        columns = 2 * columns + rows % 2
    return np.stack([columns, rows], axis=-1).astype(np.float64)


def border(columns: int, rows: int, asymmetric: bool = False) -> list[NDArray[np.float64]]:
    """Return the positions ``(points, 2)`` next to each of a grid's four sides."""
    across, down = np.arange(columns), np.arange(rows)
    return [
        lattice(across, np.full(columns, -1), asymmetric),
        lattice(across, np.full(columns, rows), asymmetric),
        lattice(np.full(rows, -1), down, asymmetric),
        lattice(np.full(rows, columns), down, asymmetric),
    ]
