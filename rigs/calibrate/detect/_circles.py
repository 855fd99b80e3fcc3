"""Detection of grids of circles, complete ones only."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.detect.found import (
    Found,
    Search,
    border,
    lattice,
    local_axes,
    orders,
    smooth_map,
)
from rigs.calibrate.targets import CircleGrid

_LEAST = 6.0  # pixels of a circle's diameter; smaller ones have too few edge pixels


class _Circle(NamedTuple):
    """A circle's image: centre, mean radius and blur in pixels, white less black."""

    uv: NDArray[np.float64]  # (2,)
    radius: float
    blur: float
    contrast: float


def find_circles(search: Search, target: CircleGrid) -> Found:
    """Return the centres of the grid's circles in an image, dark circles or bright."""
    size = f"{target.columns}x{target.rows}"
    for image in (search, search.negative()):
        rough = _rough(image, target)
        if rough is not None:
            break
    else:
        return Found.nothing(f"no grid of {size} circles")
    row, column = np.divmod(np.arange(len(rough)), target.columns)
    positions = lattice(column, row, target.asymmetric)
    order = next(orders(rough, positions, target.columns), None)
    if order is None:
        return Found.nothing(f"a grid of {size} circles, but mirrored")
    start = rough[order]
    reach = _half_way(target)
    axes = local_axes(positions, start)
    tried = [_ellipse(image.whole, uv, step, reach) for uv, step in zip(start, axes, strict=True)]
    point = np.array([k for k, circle in enumerate(tried) if circle is not None], np.int64)
    if len(point) < max(4, 0.8 * len(tried)):
        return Found.nothing(f"a grid of {size} spots, but not of circles")
    circles = [tried[k] for k in point]
    positions, uv = positions[point], np.array([circle.uv for circle in circles])
    radius = np.array([circle.radius for circle in circles])
    contrast = float(np.median([circle.contrast for circle in circles]))
    steps = float(np.median(radius / np.sqrt(np.linalg.det(local_axes(positions, uv)))))
    shift = _shift(positions, uv, steps)
    if _continues(image.whole, target, positions, uv, steps, 0.5 * contrast):
        return Found.nothing(f"a grid of more than {size} circles")
    return Found(point, uv + shift, float(np.median([circle.blur for circle in circles])))


def _half_way(target: CircleGrid) -> float:
    """Return half the distance of neighbours, in steps from row to row."""
    return 0.5 * (np.sqrt(2) if target.asymmetric else 1.0)


def _rough(search: Search, target: CircleGrid) -> NDArray[np.float64] | None:
    """Return the centres ``(points, 2)`` within about a pixel, in any order of a grid."""
    blobs = cv2.SimpleBlobDetector.Params()
    blobs.minArea, blobs.maxArea = 20.0, search.small.size / 20
    blobs.minDistBetweenBlobs = 4.0
    blobs.minThreshold, blobs.maxThreshold, blobs.thresholdStep = 20.0, 235.0, 10.0
    detector = cv2.SimpleBlobDetector.create(blobs)
    kind = cv2.CALIB_CB_ASYMMETRIC_GRID if target.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    for flags in (kind, kind | cv2.CALIB_CB_CLUSTERING):
        found, centers = cv2.findCirclesGrid(
            search.small, (target.columns, target.rows), flags=flags, blobDetector=detector
        )
        if found:
            return search.in_whole(centers.reshape(-1, 2))
    return None


def _ellipse(
    image: NDArray[np.float32], uv: NDArray[np.float64], axes: NDArray[np.float64], reach: float
) -> _Circle | None:
    """Return the circle near ``uv``, or None.

    Tangents at the edge's pixels are the dual conic's points: ``l C l = 0`` with the line ``l``
    across a pixel's gradient, least squares weighted by the gradient (Ouellet and Hebert,
    Precise ellipse estimation without contour point extraction, 2009).
    """
    half = int(np.ceil(reach * np.abs(axes).sum(axis=1).max())) + 2
    column, row = np.round(uv).astype(int)
    if min(column, row) < half or not (
        column + half < image.shape[1] and row + half < image.shape[0]
    ):
        half = int(min(column, row, image.shape[1] - 1 - column, image.shape[0] - 1 - row))
    if half < 4:
        return None
    crop = image[row - half : row + half + 1, column - half : column + half + 1]
    slope = [cv2.Scharr(crop, cv2.CV_64F, *by)[1:-1, 1:-1] / 32 for by in ((1, 0), (0, 1))]
    y, x = np.mgrid[-half + 1 : half, -half + 1 : half].astype(np.float64)
    x, y = x + column - uv[0], y + row - uv[1]
    position = np.linalg.solve(axes, np.stack([x.ravel(), y.ravel()]))
    size = np.hypot(*slope)
    near = np.hypot(*position).reshape(x.shape) < reach
    if not near.any() or size[near].max() <= 0:
        return None
    peak = np.percentile(size[near], 98)
    edge = near & (size > 0.25 * peak)
    a, b, x, y = slope[0][edge], slope[1][edge], x[edge], y[edge]
    scale = max(float(np.hypot(x, y).mean()), 1e-6)
    c = -(a * x + b * y) / scale
    terms = np.stack([a * a, a * b, b * b, a * c, b * c], axis=-1)
    if len(terms) < 12:
        return None
    xx, xy, yy, xz, yz = np.linalg.lstsq(terms, -c * c, rcond=None)[0]
    center = np.array([xz, yz]) / 2
    shape = np.outer(center, center) - np.array([[xx, xy / 2], [xy / 2, yy]])
    if not (np.linalg.det(shape) > 0 and np.trace(shape) > 0):
        return None
    radius = scale * np.linalg.det(shape) ** 0.25
    off = np.linalg.solve(axes, center * scale)
    if 2 * radius < _LEAST or np.hypot(*off) > 0.3:
        return None
    inside = crop[1:-1, 1:-1][near]
    contrast = np.percentile(inside, 98) - np.percentile(inside, 2)
    blur = contrast / (np.sqrt(2 * np.pi) * peak)
    return _Circle(uv + center * scale, float(radius), float(blur), float(contrast))


def _shift(
    positions: NDArray[np.float64], uv: NDArray[np.float64], radius: float
) -> NDArray[np.float64]:
    """Return the shift from each ellipse's centre to the image of its circle's centre.

    A homography H takes a circle's dual conic Q to H Q Hᵀ, whose centre is not the image of the
    circle's. The lens adds to the rim, on average, r² / 4 of the Laplacian of its displacement.
    """
    homography = cv2.findHomography(positions, uv, 0)[0]
    middle = cv2.perspectiveTransform(positions[None], homography)[0]
    moved = np.tile(np.eye(3), (len(positions), 1, 1))
    moved[:, :2, 2] = positions
    projected = homography @ moved
    dual = projected @ np.diag([radius**2, radius**2, -1.0]) @ projected.transpose(0, 2, 1)
    _, bending = smooth_map(positions, uv)
    return middle - dual[:, :2, 2] / dual[:, 2:, 2] - radius**2 / 4 * bending.sum(axis=1)


def _continues(image, target: CircleGrid, positions, uv, radius: float, contrast: float) -> bool:
    """Return whether such circles continue beyond one of the sides."""
    homography = cv2.findHomography(positions, uv, 0)[0]
    for side in border(target.columns, target.rows, target.asymmetric):
        beyond = cv2.perspectiveTransform(side[None], homography)[0]
        axes = local_axes(np.concatenate([positions, side]), np.concatenate([uv, beyond]))
        like = []
        for start, step in zip(beyond, axes[len(positions) :], strict=True):
            if (start < 6).any() or (start > np.array(image.shape[::-1]) - 7).any():
                continue
            circle = _ellipse(image, start, step, _half_way(target))
            expected = radius * np.sqrt(abs(np.linalg.det(step)))
            like.append(
                circle is not None
                and circle.contrast > contrast
                and 0.7 < circle.radius / expected < 1.4
            )
        if len(like) >= 2 and np.mean(like) > 0.5:
            return True
    return False
