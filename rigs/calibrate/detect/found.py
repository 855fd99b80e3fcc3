"""The detection of a target in one image, and helpers for all kinds of targets."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

_SEARCHED = 1600  # pixels of the longer side; more take longer and find no more


@dataclass(frozen=True, eq=False)
class Found:
    """The target's points in one image.

    Parameters
    ----------
    point : (points,) int64
        Indices of the target's points.
    uv : (points, 2) float64
        Pixel coordinates (column, row), pixel centres at integers.
    blur : float
        Blur of the edges: standard deviation in pixels, the median over the points.
    reason : str
        Why nothing was found; empty if points were.
    legacy : bool, optional
        Which of two layouts the markers show; None where both fit.
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
    """One image in two forms: small and 8-bit to search, whole to measure.

    Parameters
    ----------
    whole : (rows, columns) float32
    small : (rows, columns) uint8
        Contrast stretched to the full range, at most 1600 pixels across.
    """

    whole: NDArray[np.float32]
    small: NDArray[np.uint8]

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
    """Return the derivative of pixels by positions on the target, at each of its points.

    Parameters
    ----------
    positions : (points, 2) float64
        Positions on the target, in steps from point to point.
    uv : (points, 2) float64

    Returns
    -------
    axes : (points, 2, 2) float64
        Columns are one step along the target's x and along its y, in pixels, from an affine map
        fitted to each point's neighbours.
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
    """Fit a homography and, given enough points, a polynomial for the lens.

    Parameters
    ----------
    positions, uv : (points, 2) float64

    Returns
    -------
    smooth : (points, 2) float64
        The fitted ``uv``.
    bending : (points, 2, 2) float64
        Rows are the second derivatives of the polynomial along the target's x and y, in pixels
        by step², the curvature of straight edges. Zero without a polynomial.
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
