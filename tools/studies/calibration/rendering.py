"""Photographs of flat targets with known truth: distorted rays, blur, noise, 8 bits."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs import Camera

if TYPE_CHECKING:
    import open3d

    from rigs.calibrate.targets.boards import Target

_CHANGE = 1e-3  # grey values between a pixel's corners, above which one ray does not do
_MARGIN = 2  # pixels round the board's outline that are rendered too: lenses bend straight lines


@dataclass(frozen=True)
class Exposure:
    """How light becomes grey values."""

    # black, white: grey values of ink and paper
    black: float = 30.0
    white: float = 210.0
    surroundings: float = 95.0  # grey value of what is not the target, its back included
    shading: float = 0.15  # share by which the image's right edge is darker than its left
    blur: float = 0.7  # standard deviation of the lens's Gaussian blur, in pixels
    noise: float = 2.0  # standard deviation of each pixel's noise, in grey values


class Board:
    """A printed target as RaycastingScene sees it, from where z is negative.

    ``image`` ``(rows, columns)`` uint8 is the print, 0 ink and 255 paper. The outer corner of its
    top-left pixel lies at ``corner`` in the target's axes; x grows with columns, y with rows. A
    pixel's edge is ``texel`` long, in the target's unit.
    """

    def __init__(self, image: NDArray[np.uint8], corner: NDArray, texel: float) -> None:
        import open3d

        self.image = np.asarray(image, np.float32) / 255.0
        self.corner = np.asarray(corner, np.float64)
        self.texel = float(texel)
        size = self.texel * np.array(self.image.shape[::-1])
        outline = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
        self.outline = np.array(outline) * [*size, 0] + [*self.corner, 0]  # (4, 3)
        self._scene = open3d.t.geometry.RaycastingScene()
        # single precision: relative to the middle, in print widths
        self._middle, self._scale = self.outline.mean(axis=0), size.max()
        self._scene.add_triangles(
            self._tensor((self.outline - self._middle) / self._scale),
            open3d.core.Tensor(np.array([[0, 1, 2], [0, 2, 3]], np.uint32)),
        )

    @classmethod
    def of(cls, target: Target, pixels_per_unit: float) -> Board:
        """Return a target as printed.

        Its edges are where they belong if a square's and a marker cell's side is a whole number
        of the print's pixels, to half a pixel of the print otherwise.
        """
        image, corner = target.drawing(pixels_per_unit)
        return cls(image, corner, 1 / pixels_per_unit)

    @staticmethod
    def _tensor(array: NDArray) -> open3d.core.Tensor:
        import open3d

        return open3d.core.Tensor(np.ascontiguousarray(array, np.float32))

    def light(
        self, origin: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        """Return what rays see of the print: 0 for ink to 1 for paper, NaN outside and behind it.

        Origin and directions ``(N, 3)`` are in the target's axes. Open3D says whether a ray meets
        the board; where it does follows in float64.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = -origin[2] / directions[:, 2]
            spot = origin + distance[:, None] * directions  # (N, 3)
        light = np.full(len(directions), np.nan, np.float32)
        front = np.flatnonzero((directions[:, 2] > 0) & (distance > 0))
        start = (spot[front] - self._middle) / self._scale - directions[front]
        rays = self._tensor(np.concatenate([start, directions[front]], axis=1))
        hit = np.isfinite(self._scene.cast_rays(rays)["t_hit"].numpy())
        light[front[hit]] = self._sampled(spot[front[hit], :2])
        return light

    def _sampled(self, xy: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the print at ``xy`` ``(N, 2)``, linear between the middles of its pixels."""
        rows, columns = self.image.shape
        place = (xy - self.corner) / self.texel - 0.5
        low = np.floor(place).astype(np.int64)
        u, v = (place - low).astype(np.float32).T
        left, right = (np.clip(low[:, 0] + step, 0, columns - 1) for step in (0, 1))
        top, bottom = (np.clip(low[:, 1] + step, 0, rows - 1) * columns for step in (0, 1))
        flat = self.image.reshape(-1)
        above = flat[top + left] * (1 - u) + flat[top + right] * u
        below = flat[bottom + left] * (1 - u) + flat[bottom + right] * u
        return above * (1 - v) + below * v


class Photographer:
    """Takes one camera's pictures of boards, by K x K rays a pixel where the board changes."""

    def __init__(self, camera: Camera, rays_per_side: int = 4) -> None:
        self.camera = camera
        self.rays_per_side = rays_per_side
        width, height = camera.image_size
        u, v = np.meshgrid(np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5)
        directions = camera.rays(np.stack([u, v], axis=-1).reshape(-1, 2))[1] @ camera.R.T
        if not np.isfinite(directions).all():
            raise ValueError(f"camera {camera.name}: sees nothing in some pixels, expected rays")
        plane = directions[:, :2] / directions[:, 2:]
        self._plane = plane.reshape(height + 1, width + 1, 2)  # at the pixels' corners

    def picture(
        self,
        board: Board,
        R: NDArray[np.float64],
        t: NDArray[np.float64],
        exposure: Exposure | None = None,
    ) -> NDArray[np.float64]:
        """Return grey values ``(height, width)`` without noise; ``x_world = R @ x_target + t``."""
        from scipy.ndimage import gaussian_filter

        exposure = Exposure() if exposure is None else exposure
        turn = self.camera.R @ R  # from the target's axes to the camera's
        origin = -turn.T @ (self.camera.R @ t + self.camera.t)
        height, width = (n - 1 for n in self._plane.shape[:2])
        image = np.full((height, width), exposure.surroundings)
        window = self._window(board, turn, origin)
        if window is not None:
            image[window] = self._seen(board, turn, origin, window, exposure)
        image *= 1 - exposure.shading * np.arange(width) / max(width - 1, 1)
        return gaussian_filter(image, exposure.blur) if exposure.blur > 0 else image

    def _window(self, board: Board, turn: NDArray, origin: NDArray) -> tuple[slice, slice] | None:
        """Return the rows and columns that may see the board, or None."""
        corners = (board.outline - origin) @ turn.T  # (4, 3), in the camera's axes
        height, width = (n - 1 for n in self._plane.shape[:2])
        if (corners[:, 2] <= 0).any():
            return slice(0, height), slice(0, width)
        plane = corners[:, :2] / corners[:, 2:]
        inside = ((self._plane >= plane.min(axis=0)) & (self._plane <= plane.max(axis=0))).all(-1)
        if not inside.any():
            return None
        spans = []
        for axis, count in ((1, height), (0, width)):
            places = np.flatnonzero(inside.any(axis=axis))
            spans.append(slice(max(places[0] - _MARGIN, 0), min(places[-1] + _MARGIN, count)))
        return spans[0], spans[1]

    def _seen(
        self, board: Board, turn: NDArray, origin: NDArray, window: tuple, exposure: Exposure
    ) -> NDArray[np.float64]:
        """Return grey values in a window: one ray a pixel corner, K x K where they differ."""
        rows, columns = window
        plane = self._plane[rows.start : rows.stop + 1, columns.start : columns.stop + 1]
        values = self._values(board, turn, origin, plane.reshape(-1, 2), exposure)
        values = values.reshape(plane.shape[:2])
        corners = (values[:-1, :-1], values[:-1, 1:], values[1:, :-1], values[1:, 1:])
        image = corners[0].copy()
        row, column = np.nonzero(np.ptp(corners, axis=0) > _CHANGE)
        steps = (np.arange(self.rays_per_side) + 0.5) / self.rays_per_side
        first, across = plane[row, column], plane[row, column + 1] - plane[row, column]
        along = plane[row + 1, column] - plane[row, column]
        both = plane[row + 1, column + 1] - first - across - along
        total = np.zeros(len(row))
        for down, right in itertools.product(steps, steps):
            at = first + right * across + down * along + right * down * both
            total += self._values(board, turn, origin, at, exposure)
        image[row, column] = total / len(steps) ** 2
        return image

    @staticmethod
    def _values(
        board: Board, turn: NDArray, origin: NDArray, plane: NDArray, exposure: Exposure
    ) -> NDArray[np.float64]:
        """Return the grey values of rays through ``plane`` ``(N, 2)`` at depth one."""
        directions = plane @ turn[:2] + turn[2]
        light = board.light(origin, directions)
        paper = exposure.black + (exposure.white - exposure.black) * light
        return np.where(np.isnan(light), exposure.surroundings, paper)


def developed(
    picture: NDArray[np.float64], exposure: Exposure, generator: np.random.Generator
) -> NDArray[np.uint8]:
    """Return a picture with noise, in 8 bits."""
    noisy = picture + exposure.noise * generator.standard_normal(picture.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
