"""A camera by stored rays: for mirrors, fibre bundles, windows, any optics."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.camera_protocol import CameraLike
from rigs.figures import Accuracy, Optics
from rigs.geometry.image_checks import (
    OnImage,
    check_labels,
    check_window,
    image_size,
    pixel_centres,
    quarter_turns,
    rows_of,
    scaled_size,
)
from rigs.geometry.rotation import numbers, rotation
from rigs.ray_table.interpolation import interpolated_rays, project_to_table
from rigs.ray_table.nearest_pinhole import NearestPinhole, fitted_pinhole
from rigs.ray_table.ray_arrays import (
    finite_or_zero,
    in_largest_view,
    origins_for,
    unit_or_nan,
    vectors,
    view_labels,
)


@dataclass(frozen=True, eq=False, repr=False)
class RayTable(OnImage, NearestPinhole):
    """A camera whose every pixel has a ray of its own; it serves wherever a `Camera` does.

    Rays are interpolated between pixel centres, so neighbours should belong to one view. Where
    two views meet in one image (the edge of a mirror), set a line of pixels to NaN.

    Parameters
    ----------
    name : str
        Also names files and folders: printable, without slashes.
    origins : (h, w, 3) or (3,) array_like
        The start of each pixel's ray; one point for all rays of a central camera.
    directions : (h, w, 3) array_like
        Any length but zero. NaN for a pixel without a ray.
    image_size : (int, int), optional
        Width and height in pixels; by default the table's.
    scale : float
        Table pixels along an image pixel.
    offset : (float, float)
        Table column and row of the image's top-left pixel at scale one. Image coordinates (u, v)
        are the table's ``(u + 1/2) scale - 1/2 + offset``: so images that are shrunk, cropped or
        shifted share one table.
    optics : Optics, optional
    status : {"calibrated", "nominal", "virtual"}
    accuracy : Accuracy, optional

    Raises
    ------
    ValueError
        Naming the camera and the field, if a value is out of range.

    Notes
    -----
    `position`, `R`, `t` and `camera_matrix` are those of the pinhole nearest to the rays
    (`rigs.ray_table.nearest_pinhole`), to the largest view where there are several in the image.
    They serve drawings, footprints and start values; `rays` and `project` do not use them. For a
    point with several images `project` gives one. Rays are extrapolated up to 8 table pixels
    beyond the outermost centres.

    Examples
    --------
    >>> from rigs import Camera
    >>> camera = Camera("cam00", (9, 9), [[80, 0, 4], [0, 80, 4], [0, 0, 1]], t=[0, 0, 100])
    >>> RayTable.of(camera).project([[10, 0, 0]])[0].round(6)
    array([[12.,  4.]])
    """

    name: str
    origins: NDArray[np.float64]
    directions: NDArray[np.float64]
    # None is the size of the table, which takes its place
    image_size: tuple[int, int] = None  # type: ignore[assignment]
    scale: float = 1.0
    offset: tuple[float, float] = (0.0, 0.0)
    optics: Optics | None = None
    status: str = "virtual"
    accuracy: Accuracy | None = None

    def __post_init__(self) -> None:
        """Check every field, make directions unit vectors and arrays read-only."""
        what = check_labels(self)
        directions = vectors(self.directions, f"{what}: directions")
        height, width = directions.shape[:2]
        size = (width, height) if self.image_size is None else self.image_size
        origins = origins_for(self.origins, directions.shape, f"{what}: origins")
        directions = unit_or_nan(directions, origins, f"{what}: directions")
        scale = float(numbers(self.scale, (), f"{what}: scale"))
        if not scale > 0:
            raise ValueError(f"{what}: scale: found {scale}, expected positive")
        checked = {
            "origins": origins,
            "directions": directions,
            "image_size": image_size(size, what),
            "scale": scale,
            "offset": tuple(numbers(self.offset, (2,), f"{what}: offset").tolist()),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, camera: CameraLike) -> RayTable:
        """Return the table of a camera's rays, one per pixel; see `rigs.scene.SceneCamera.rays`.

        The fraction of light that glass takes, and pieces behind mirrors, are not kept.
        """
        width, height = camera.image_size
        origins, directions = camera.rays()
        is_central = bool((origins == origins[0]).all())
        return cls(
            camera.name,
            origins[0] if is_central else origins.reshape(height, width, 3),
            directions.reshape(height, width, 3),
            optics=camera.optics,
            status=camera.status,
            accuracy=camera.accuracy,
        )

    def __repr__(self) -> str:
        """Name the sizes; the arrays are too long to print."""
        height, width = self.directions.shape[:2]
        return (
            f"<RayTable {self.name}: {self.image_size[0]} x {self.image_size[1]} pixels, "
            f"table of {width} x {height}, {self.status}>"
        )

    @cached_property
    def _values(self) -> tuple:
        """All values of the camera, comparable and hashable."""
        digest = hashlib.sha256()
        for array in (self.origins, self.directions):
            digest.update(np.ascontiguousarray(array).tobytes())
        own = (self.name, self.image_size, self.scale, self.offset, self.optics, self.status)
        return (*own, self.accuracy, self.directions.shape, digest.digest())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RayTable):
            return NotImplemented
        return self._values == other._values

    def __hash__(self) -> int:
        return hash(self._values)

    has_lens_model = False
    has_pose = False
    is_pinhole = False
    is_straight = True

    @cached_property
    def _pinhole(self) -> tuple[NDArray, NDArray, NDArray]:
        """Camera matrix, R and position of the pinhole nearest to the rays."""
        return fitted_pinhole(self.name, self.image_size, self.rays, self._in_largest_view)

    def _in_largest_view(self, uv: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether pixel coordinates ``(N, 2)`` are in the largest connected view."""
        if self.sees_once:
            return np.ones(len(uv), bool)
        return in_largest_view(self._view_labels, self._table_pixels(uv))

    @cached_property
    def sees_once(self) -> bool:
        """Whether pixels with rays form one connected view: else a point may have two images."""
        return bool(self._view_labels.max() <= 1)

    @cached_property
    def _view_labels(self) -> NDArray[np.integer]:
        """Label of the connected view of each pixel of the table, ``(h, w)``."""
        return view_labels(self.directions)

    @cached_property
    def _is_whole(self) -> bool:
        """Whether the table has neither holes nor jumps."""
        return self.sees_once and not np.isnan(self.directions).any()

    def project(self, points: ArrayLike) -> tuple[NDArray, NDArray, NDArray]:
        """Return pixel coordinates ``(N, 2)``, depth and validity ``(N,)`` of points ``(N, 3)``.

        Coordinates are inside the image or up to 8 table pixels outside, NaN where not valid;
        depth is along the optical axis of the nearest pinhole. Valid is a point that a ray of the
        table passes beyond its origin.
        """
        points = rows_of(points, 3, "points to project")
        xy = project_to_table(self.origins, self.directions, points, self._is_whole)
        uv = (xy + 0.5 - self.offset) / self.scale - 0.5
        with np.errstate(invalid="ignore", over="ignore"):
            depth = (points - self.position) @ self.R[2]
        return uv, depth, np.asarray(np.isfinite(uv).all(axis=1))

    def rays(self, uv: ArrayLike | None = None) -> tuple[NDArray, NDArray]:
        """Return origins and unit directions ``(N, 3)`` of pixels; see `Camera.rays`.

        Origins are always finite; directions NaN where the pixel has no ray.
        """
        if uv is None:
            height, width = self.directions.shape[:2]
            if (self.image_size, self.scale, self.offset) == ((width, height), 1.0, (0.0, 0.0)):
                origins = finite_or_zero(self.origins.reshape(-1, 3))
                return origins, self.directions.reshape(-1, 3).copy()
            uv = pixel_centres(self.image_size)
        uv = rows_of(uv, 2, "pixel coordinates")
        rays = interpolated_rays(self.origins, self.directions, self._table_pixels(uv))
        with np.errstate(invalid="ignore", divide="ignore"):
            directions = rays.direction / np.linalg.norm(rays.direction, axis=1, keepdims=True)
        return finite_or_zero(rays.origin), directions

    def _table_pixels(self, uv: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return column and row in the table of pixel coordinates, ``(N, 2)``."""
        return (uv + 0.5) * self.scale - 0.5 + self.offset

    def with_pose(self, camera_matrix: ArrayLike, R: ArrayLike, t: ArrayLike) -> RayTable:
        """Raise ValueError: a table of rays has no pose, see `transformed` for rigid motions."""
        raise ValueError(f"camera {self.name}: found a table of rays, expected a lens and a pose")

    def scaled(self, scale: float) -> RayTable:
        """Return the camera of the image resized by ``scale``: see `Camera.scaled`."""
        size = scaled_size(self.image_size, scale, f"camera {self.name}")
        optics = self.optics and self.optics.with_pixels_scaled(1 / scale)
        accuracy = self.accuracy and self.accuracy.with_pixels_scaled(1 / scale)
        return replace(
            self, image_size=size, scale=self.scale / scale, optics=optics, accuracy=accuracy
        )

    def cropped(self, x: int, y: int, width: int, height: int) -> RayTable:
        """Return the camera of the window whose top-left pixel was column ``x``, row ``y``."""
        check_window((x, y, width, height), self.image_size, f"camera {self.name}")
        moved = self.shifted(-x, -y)
        return replace(moved, image_size=(int(width), int(height)))

    def rotated(self, degrees: int) -> RayTable:
        """Return the camera of the image turned clockwise by 90, 180 or 270 degrees."""
        quarters = quarter_turns(degrees, f"camera {self.name}")
        directions, size, offset = self.directions, self.image_size, self.offset
        for _ in range(quarters):  # column u and row v of h rows become h - 1 - v and u
            offset = directions.shape[0] - size[1] * self.scale - offset[1], offset[0]
            directions, size = np.rot90(directions, -1), (size[1], size[0])
        origins = self.own_origins
        if origins.ndim == 3:
            origins = np.rot90(origins, -quarters)
        return replace(
            self, origins=origins, directions=directions, image_size=size, offset=offset
        )

    def shifted(self, right: float, down: float) -> RayTable:
        """Return the camera whose image lies that many pixels further right and down."""
        x, y = self.offset
        return replace(self, offset=(x - right * self.scale, y - down * self.scale))

    def transformed(self, R: ArrayLike, t: ArrayLike) -> RayTable:
        """Return the camera after the rigid motion ``x_new = R @ x_old + t`` of the world."""
        R = rotation(R, f"camera {self.name}: motion R")
        t = numbers(t, (3,), f"camera {self.name}: motion t")
        return replace(self, origins=self.own_origins @ R.T + t, directions=self.directions @ R.T)

    def with_lengths_scaled(self, factor: float) -> RayTable:
        """Return the camera of a world whose lengths are ``factor`` times as large."""
        optics = self.optics and self.optics.with_lengths_scaled(factor)
        return replace(self, origins=self.own_origins * factor, optics=optics)

    @property
    def own_origins(self) -> NDArray[np.float64]:
        """The origins, not repeated: ``(3,)`` where all rays share one, else ``(h, w, 3)``."""
        central = self.origins.strides[:2] == (0, 0)
        return self.origins[0, 0] if central else self.origins
