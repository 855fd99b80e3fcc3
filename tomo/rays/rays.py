"""Straight pieces of lines of sight, grouped by the pixel that they feed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.aperture import Aperture
from tomo._compute.grouping import take_groups
from tomo.grid import VoxelGrid
from tomo.rays.pixel_rays import (
    BAD_LENGTH,
    FINE,
    NOT_FINITE,
    NOT_UNIT,
    first_fault,
    lines_of_sight,
    points_of_aperture,
    positions_in_pixel,
    rays_of_pixel,
)

if TYPE_CHECKING:
    from rigs import CameraLike

_WRONG = {
    NOT_FINITE: "rays origins: found NaN or infinity, expected finite coordinates",
    NOT_UNIT: "rays directions: expected unit vectors",
    BAD_LENGTH: "rays lengths: found a negative or NaN length, expected >= 0",
}


def _chief_rays(
    camera: CameraLike, pixels: NDArray[np.integer], supersample: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the rays of pixels through the centre of projection, ``(P * K², 3)`` each."""
    positions = positions_in_pixel(supersample)
    if camera.is_pinhole:
        return lines_of_sight(camera, pixels, positions)
    row, column = np.divmod(pixels, camera.image_size[0])
    v, u = row[:, None] + positions[:, 0], column[:, None] + positions[:, 1]  # (P, K²)
    return camera.rays(np.stack([u, v], axis=-1).reshape(-1, 2))


@dataclass(frozen=True, eq=False)
class Rays:
    """Straight pieces of rays; pixel ``p`` owns the pieces ``pixel_ptr[p]:pixel_ptr[p + 1]``.

    A pixel's projection is the sum over its pieces of ``weight`` times the line integral from
    ``origins`` along ``directions`` over ``lengths``. One ray a pixel has weight 1; K x K rays a
    pixel have 1 / K² each, rays over an aperture those of a quadrature; a bent ray is several
    pieces one behind the other.

    Attributes
    ----------
    origins : (N, 3) float64
        Where each piece starts, in world coordinates.
    directions : (N, 3) float64
        Unit vectors.
    lengths : (N,) float64
        How long each piece is; infinite for a ray that nothing ends.
    weight : (N,) float64
        Quadrature weights.
    pixel_ptr : (pixels + 1,) int64
        Where each pixel's pieces begin.
    path_ptr : (paths + 1,) int64, optional
        Where the pieces of each path begin, those that light passes one behind the other; the
        first is the camera's. None: every piece is a path by itself. Gas that absorbs asks for
        it: a piece is seen through those before it.
    """

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]
    lengths: NDArray[np.float64]
    weight: NDArray[np.float64]
    pixel_ptr: NDArray[np.int64]
    path_ptr: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        """Check shapes and that directions are unit vectors: every tracer relies on it."""
        n = len(self.origins)
        for name, shape in (
            ("origins", (n, 3)),
            ("directions", (n, 3)),
            ("lengths", (n,)),
            ("weight", (n,)),
        ):
            found = getattr(self, name)
            if found.shape != shape or found.dtype != np.float64:
                raise ValueError(
                    f"rays {name}: found {found.dtype} {found.shape}, expected float64 {shape}"
                )
            # kernels are compiled anew for another order in memory
            object.__setattr__(self, name, np.ascontiguousarray(found))
        wrong = first_fault(self.origins, self.directions, self.lengths)
        if wrong != FINE:
            raise ValueError(_WRONG[wrong])
        ptr = self.pixel_ptr
        if ptr.dtype != np.int64 or len(ptr) < 1 or ptr[0] != 0 or ptr[-1] != n:
            raise ValueError(f"rays pixel_ptr: expected int64 from 0 to the number of pieces, {n}")
        if self.path_ptr is not None:
            _check_paths(self.path_ptr, ptr)

    def __len__(self) -> int:
        """Return the number of straight pieces."""
        return len(self.origins)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<Rays: {self.n_pixels} pixels, {len(self)} pieces>"

    @property
    def n_pixels(self) -> int:
        """Number of pixels."""
        return len(self.pixel_ptr) - 1

    @property
    def paths(self) -> NDArray[np.int64]:
        """Where each path's pieces begin, ``(paths + 1,)``."""
        return np.arange(len(self) + 1) if self.path_ptr is None else self.path_ptr

    @classmethod
    def from_lines(
        cls, origins: ArrayLike, directions: ArrayLike, lengths: ArrayLike = np.inf
    ) -> Rays:
        """Return one ray a pixel from ``origins`` and ``directions``, ``(N, 3)`` or ``(3,)``.

        Directions are normalised here; a single origin, direction or length serves all rays.
        """
        origins = np.atleast_2d(np.asarray(origins, np.float64))
        way: NDArray = np.atleast_2d(np.asarray(directions, np.float64))
        if not np.isfinite(way).all():
            raise ValueError("rays directions: found NaN or infinity, expected finite vectors")
        largest = np.abs(way).max(axis=1, keepdims=True)
        if not (largest > 0).all():
            raise ValueError("rays directions: found a zero vector, expected non-zero")
        _, exponent = np.frexp(largest)  # by powers of two: squares neither overflow nor vanish
        way = np.ldexp(way, -exponent)
        norms = np.linalg.norm(way, axis=1, keepdims=True)
        far = np.atleast_1d(np.asarray(lengths, np.float64))
        n = max(len(origins), len(way), len(far)) if len(origins) else 0
        origins = np.array(np.broadcast_to(origins, (n, 3)))
        way = np.array(np.broadcast_to(way / norms, (n, 3)))
        far = np.array(np.broadcast_to(far, (n,)))
        return cls(origins, way, far, np.ones(n), np.arange(n + 1))

    @classmethod
    def from_camera(
        cls,
        camera: CameraLike,
        pixels: NDArray[np.integer] | None = None,
        supersample: int = 1,
        aperture_rays: int = 1,
        grid: VoxelGrid | None = None,
        *,
        aperture: Aperture | None = None,
    ) -> Rays:
        """Return the rays of a camera's pixels, ``supersample`` x ``supersample`` for each.

        Sub-pixel rays sit at the centres of equal squares of the pixel (midpoint rule), so their
        mean is the mean over the pixel's area to second order. With several aperture rays, those
        at each position start all over the lens' pupil and cross in the plane in focus: their
        mean is that over the aperture.

        Parameters
        ----------
        camera : CameraLike
        pixels : (P,) int, optional
            Flat pixel numbers ``row * width + column``; all pixels when None.
        supersample : int
            K, rays along each side of a pixel.
        aperture_rays : int
            Rays of a pixel in all, over its positions and the aperture: rounded up to a multiple
            of K², from 2 K² on. 1: the lens is a pinhole, and a pixel has K² rays.
        grid : VoxelGrid, optional
            Pieces of bent lines of sight that miss it are left out.
        aperture : Aperture, optional
            That of the camera's optics when None.

        Raises
        ------
        ValueError
            If a number is no whole number from one on, or there are several aperture rays and the
            camera's optics name no aperture, see `rigs.aperture.Aperture.of`.

        Notes
        -----
        A pixel that the lens maps from no direction at all (beyond the fold of its distortion
        polynomial) keeps its row and owns no ray. Rays over the aperture of a camera that looks
        through a scene leave it as without the scene, which then bends each of them.
        """
        total, several = rays_of_pixel(supersample, aperture_rays), supersample**2
        width, height = camera.image_size
        pixels = np.arange(width * height) if pixels is None else np.asarray(pixels, np.int64)
        own = camera if camera.is_straight else camera.camera
        origins, directions = _chief_rays(own, pixels, supersample)
        weight = np.full(len(origins), 1.0 / several)
        pixel_ptr = several * np.arange(len(pixels) + 1)
        seen: slice | NDArray[np.bool_] = slice(None)
        if not np.isfinite(directions).all():
            seen = np.asarray(np.isfinite(directions).all(axis=1))
            per_pixel = seen.reshape(-1, several).sum(axis=1)
            origins, directions = origins[seen], directions[seen]
            weight = np.repeat(1.0 / np.maximum(per_pixel, 1), per_pixel)
            pixel_ptr = np.concatenate([[0], np.cumsum(per_pixel)]).astype(np.int64)
        if aperture_rays > 1:
            lens = Aperture.of(camera) if aperture is None else aperture
            points, shares = points_of_aperture(supersample, aperture_rays)
            points = np.tile(points, (len(pixels), 1, 1))[seen]
            starts, towards = lens.rays(own, origins, directions, points)
            origins, directions = starts.reshape(-1, 3), towards.reshape(-1, 3)
            weight = (weight[:, None] * shares).ravel()
            pixel_ptr = pixel_ptr * (total // several)
        if camera.is_straight:
            return cls(origins, directions, np.full(len(origins), np.inf), weight, pixel_ptr)
        region = () if grid is None else (np.stack([grid.lower, grid.upper]),)
        paths = camera.scene.paths(origins, directions, *region)
        weight = paths.weight * np.repeat(weight, np.diff(paths.ray_ptr))
        pixel_ptr = paths.ray_ptr[pixel_ptr]
        pieces = paths.origins, paths.directions, paths.lengths, weight
        return cls(*pieces, pixel_ptr, np.unique(paths.ray_ptr))  # rays without a piece are none

    def take(self, pixels: NDArray[np.integer]) -> Rays:
        """Return the rays of some pixels, in the order given."""
        ptr, kept = take_groups(self.pixel_ptr, pixels)
        paths = None
        if self.path_ptr is not None:
            _, own = take_groups(np.searchsorted(self.path_ptr, self.pixel_ptr), pixels)
            paths = np.append(0, np.cumsum(np.diff(self.path_ptr)[own]))
        return Rays(
            self.origins[kept], self.directions[kept], self.lengths[kept], self.weight[kept], ptr,
            paths,
        )  # fmt: skip

    @staticmethod
    def concatenate(parts: Iterable[Rays]) -> Rays:
        """Return the rays of ``parts`` one after another."""
        parts = list(parts)
        offsets = np.cumsum([0] + [len(part) for part in parts])
        ptr = [part.pixel_ptr[1:] + o for part, o in zip(parts, offsets[:-1], strict=True)]
        paths = None
        if any(part.path_ptr is not None for part in parts):
            own = [part.paths[1:] + o for part, o in zip(parts, offsets[:-1], strict=True)]
            paths = np.concatenate([np.zeros(1, np.int64), *own])
        return Rays(
            np.concatenate([part.origins for part in parts]),
            np.concatenate([part.directions for part in parts]),
            np.concatenate([part.lengths for part in parts]),
            np.concatenate([part.weight for part in parts]),
            np.concatenate([np.zeros(1, np.int64), *ptr]),
            paths,
        )


def _check_paths(ptr: NDArray[np.int64], pixel_ptr: NDArray[np.int64]) -> None:
    """Raise unless paths have pieces, and each lies in one pixel."""
    if ptr.dtype != np.int64 or len(ptr) < 1 or not (np.diff(ptr) > 0).all():
        raise ValueError("rays path_ptr: expected int64 numbers that increase")
    at = np.searchsorted(ptr, pixel_ptr)
    if ptr[-1] != pixel_ptr[-1] or not np.array_equal(ptr[at], pixel_ptr):
        raise ValueError("rays path_ptr: found a path in two pixels, expected each in one")
