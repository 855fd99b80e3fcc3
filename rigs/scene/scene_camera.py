"""A camera that looks through a scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.camera_protocol import CameraLike
from rigs.figures import Accuracy, Optics
from rigs.geometry.image_checks import OnImage, pixel_centres, rows_of
from rigs.geometry.rotation import numbers, rotation
from rigs.ray_table.nearest_pinhole import NearestPinhole, fitted_pinhole, spread_pixels
from rigs.scene.paths import EVERYWHERE, Paths
from rigs.scene.projection import pixels_that_pass
from rigs.scene.scene import Scene
from rigs.scene.solids import vector_of
from rigs.scene.surfaces import Reflecting
from rigs.scene.tracing import OPEN


@dataclass(frozen=True)
class SceneCamera(OnImage, NearestPinhole):
    """A camera whose light comes through windows, past hardware and by mirrors.

    Parameters
    ----------
    camera : CameraLike
        The camera itself, in the scene's medium.
    scene : Scene
    middle : (3,)
        Where the flame is. `rays` are the pieces of the paths that pass nearest to it.

    Notes
    -----
    `position`, `R`, `t` and `camera_matrix` are those of the pinhole nearest to the rays that
    reach the middle, as of `rigs.RayTable`: behind a mirror that is the virtual camera. They
    serve drawings, footprints and start values; `rays`, `paths` and `project` are exact.
    """

    camera: CameraLike
    scene: Scene
    middle: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Check the fields, and that the camera does not stand in a solid."""
        middle = numbers(self.middle, (3,), f"camera {self.camera.name}: middle")
        object.__setattr__(self, "middle", tuple(middle.tolist()))
        if not isinstance(self.scene, Scene):
            raise ValueError(f"camera {self.name}: scene: found {self.scene!r}, expected a Scene")
        self.scene.check_outside(np.array(self.camera.position), f"camera {self.name}")

    has_lens_model = False
    is_pinhole = False
    is_straight = False

    @property
    def name(self) -> str:
        """The camera's name."""
        return self.camera.name

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.camera.image_size

    @property
    def status(self) -> str:
        """How the camera's parameters are known."""
        return self.camera.status

    @property
    def optics(self) -> Optics | None:
        """The lens's figures."""
        return self.camera.optics

    @property
    def accuracy(self) -> Accuracy | None:
        """How exactly the camera is known, seen through the scene."""
        return self.camera.accuracy

    @property
    def has_pose(self) -> bool:
        """Whether the camera itself can be moved; by a mirror it would move the other way."""
        return self.camera.has_pose and not self.scene.has_mirrors

    @cached_property
    def _pinhole(self) -> tuple[NDArray, NDArray, NDArray]:
        """Camera matrix, R and position of the pinhole nearest to the rays.

        Those of the camera itself where hardware hides all.
        """
        looked_at = (spread_pixels(self.image_size, 1.0), None)  # all only where few see nothing
        if not any(np.isfinite(self.rays(uv)[1]).any() for uv in looked_at):
            return self.camera.camera_matrix, self.camera.R, self.camera.position
        return fitted_pinhole(self.name, self.image_size, self.rays, self._in_main_view)

    @cached_property
    def sees_once(self) -> bool:
        """Whether all pixels look by the same number of mirrors: else a point may appear twice."""
        mirrors = self._mirrors(spread_pixels(self.image_size, 1.0))
        return len(np.unique(mirrors[mirrors >= 0])) <= 1

    def _mirrors(self, uv: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return by how many mirrors pixels see the middle, ``(N,)``; -1 without a ray."""
        paths, pixels = self.paths(uv)
        counts = np.full(len(uv), -1)
        is_mirror = [isinstance(solid.material, Reflecting) for solid in self.scene.solids]
        reflects = np.append(is_mirror, False)[paths.solids]  # number -1: no solid
        before = np.concatenate([[0], np.cumsum(reflects)])
        piece = paths.nearest_pieces(np.array(self.middle))
        counts[pixels] = before[piece] - before[paths.ray_ptr[:-1]]
        return counts

    def _in_main_view(self, uv: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether pixels look by as many mirrors as most pixels do, ``(N,)``."""
        mirrors = self._mirrors(uv)
        known = mirrors[mirrors >= 0]
        return mirrors == np.bincount(known).argmax() if len(known) else mirrors >= 0

    def paths(
        self, uv: ArrayLike | None = None, region: NDArray[np.float64] = EVERYWHERE
    ) -> tuple[Paths, NDArray[np.int64]]:
        """Return the paths of pixels ``(N, 2)``, by default all centres, row by row.

        The second value is the number in ``uv`` of each ray's pixel: those without a direction
        have none. Pieces that miss the box ``region`` ``(2, 3)`` are left out.
        """
        uv = pixel_centres(self.image_size) if uv is None else rows_of(uv, 2, "pixel coordinates")
        origins, directions = self.camera.rays(uv)
        pixels = np.flatnonzero(np.isfinite(directions).all(axis=1))
        return self.scene.paths(origins[pixels], directions[pixels], region), pixels

    def rays(self, uv: ArrayLike | None = None) -> tuple[NDArray, NDArray]:
        """Return the pieces of pixels' paths that pass nearest to the middle; see `paths`.

        Origins and unit directions ``(N, 3)``; NaN directions where the path ends before it comes
        nearest to the middle, or the lens has no direction for the pixel.
        """
        uv = pixel_centres(self.image_size) if uv is None else rows_of(uv, 2, "pixel coordinates")
        origins, directions = self.camera.rays(uv)
        pixels = np.flatnonzero(np.isfinite(directions).all(axis=1))
        paths = self.scene.paths(origins[pixels], directions[pixels])
        piece = paths.nearest_pieces(np.array(self.middle))
        origin, direction = paths.origins[piece], paths.directions[piece]
        ahead = np.einsum("ij,ij->i", np.array(self.middle) - origin, direction)
        stopped = (ahead > paths.lengths[piece]) & (paths.ends != OPEN)
        stopped &= piece == paths.ray_ptr[1:] - 1
        direction[stopped] = np.nan
        origins[pixels], directions[pixels] = origin, direction
        return origins, directions

    def project(self, points: ArrayLike) -> tuple[NDArray, NDArray, NDArray]:
        """Return the pixel coordinates of world points, seen through the scene.

        As `Camera.project` does. Valid is a point that a pixel's path passes through: one of its
        images where there are several. Depth is along the axis of the nearest pinhole.
        """
        points = rows_of(points, 3, "points to project")
        uv = pixels_that_pass(self.camera, self.scene, points)
        with np.errstate(invalid="ignore", over="ignore"):
            depth = (points - self.position) @ self.R[2]
        return uv, depth, np.asarray(np.isfinite(uv).all(axis=1))

    def _changed(self, change: Callable[[CameraLike], CameraLike]) -> Self:
        return replace(self, camera=change(self.camera))

    def with_pose(self, camera_matrix: ArrayLike, R: ArrayLike, t: ArrayLike) -> Self:
        """Return the camera itself with other intrinsics and another pose, in the same scene."""
        return self._changed(lambda camera: camera.with_pose(camera_matrix, R, t))

    def renamed(self, name: str) -> Self:
        """Return the camera under another name."""
        return self._changed(lambda camera: camera.renamed(name))

    def with_accuracy(self, accuracy: Accuracy | None) -> Self:
        """Return the camera of which another accuracy is known, or none."""
        return self._changed(lambda camera: camera.with_accuracy(accuracy))

    def scaled(self, scale: float) -> Self:
        """Return the camera of the image resized by ``scale``: see `Camera.scaled`."""
        return self._changed(lambda camera: camera.scaled(scale))

    def cropped(self, x: int, y: int, width: int, height: int) -> Self:
        """Return the camera of the window whose top-left pixel was column ``x``, row ``y``."""
        return self._changed(lambda camera: camera.cropped(x, y, width, height))

    def rotated(self, degrees: int) -> Self:
        """Return the camera of the image turned clockwise by 90, 180 or 270 degrees."""
        return self._changed(lambda camera: camera.rotated(degrees))

    def shifted(self, right: float, down: float) -> Self:
        """Return the camera whose image lies that many pixels further right and down."""
        return self._changed(lambda camera: camera.shifted(right, down))

    def transformed(self, R: ArrayLike, t: ArrayLike) -> Self:
        """Return the camera and its scene after the rigid motion ``x_new = R @ x_old + t``."""
        R = rotation(R, f"camera {self.name}: motion R")
        t = numbers(t, (3,), f"camera {self.name}: motion t")
        return replace(
            self,
            camera=self.camera.transformed(R, t),
            scene=self.scene.transformed(R, t),
            middle=vector_of(R @ np.array(self.middle) + t),
        )

    def with_lengths_scaled(self, factor: float) -> Self:
        """Return the camera of a world whose lengths are ``factor`` times as large."""
        return replace(
            self,
            camera=self.camera.with_lengths_scaled(factor),
            scene=self.scene.with_lengths_scaled(factor),
            middle=vector_of(factor * np.array(self.middle)),
        )


def own_camera(camera: CameraLike) -> CameraLike:
    """Return the camera itself of one that looks through a scene; any other as it is."""
    return camera.camera if isinstance(camera, SceneCamera) else camera


def with_own_camera(camera: CameraLike, own: CameraLike) -> CameraLike:
    """Return ``own`` as it looks through the scene of ``camera``, if that looks through one."""
    return replace(camera, camera=own) if isinstance(camera, SceneCamera) else own
