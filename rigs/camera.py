"""One camera by a lens model: projection of points, rays of pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
from rigs.lens import Distortion, turned

_LONGEST_FOCUS = 1e9
"""Pixels: 1 km of focal length and pixels of 1 um. A longer one makes images of a voxel that no
memory holds; a lower bound refuses cameras that stand for parallel light."""

_MOST_STRETCHED = 10.0
"""Ratio of the focal lengths: anamorphic lenses have 2, lines binned by eight 8. More is no
camera's; a lower bound refuses those."""


@dataclass(frozen=True, eq=False, repr=False)
class Camera(OnImage):
    """A camera in OpenCV's convention: ``x_cam = R @ x_world + t``, pixel centres at integers.

    Cameras are values: their arrays are read-only, they compare and hash by content, and their
    ``repr`` builds them again.

    Parameters
    ----------
    name : str
        Also names files and folders: printable, without slashes.
    image_size : (int, int)
        Width and height in pixels.
    camera_matrix : (3, 3) array_like
        ``[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]`` in pixels; (0, 0) is the centre of the
        top-left pixel.
    distortion : Distortion
    R : (3, 3) array_like
        Rotation from world to camera axes (x right, y down, z forward). Within 1e-6 of orthonormal
        it is replaced by the nearest rotation (see ``rigs.geometry.rotation.rotation``).
    t : (3,) array_like
        Translation, in the rig's length unit.
    optics : Optics, optional
        Focal length, f-number, focus distance and pixel pitch, where known.
    status : {"calibrated", "nominal", "virtual"}
        How the parameters are known.
    accuracy : Accuracy, optional
        How exactly they are known.

    Raises
    ------
    ValueError
        Naming the camera and the field, if a value is out of range.

    Examples
    --------
    >>> camera = Camera("cam00", (9, 9), [[80, 0, 4], [0, 80, 4], [0, 0, 1]], t=[0, 0, 100])
    >>> camera.project([[0, 0, 0], [10, 0, 0]])[0]
    array([[ 4.,  4.],
           [12.,  4.]])
    """

    name: str
    image_size: tuple[int, int]
    camera_matrix: NDArray[np.float64]
    distortion: Distortion = field(default_factory=Distortion)
    R: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    t: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    optics: Optics | None = None
    status: str = "virtual"
    accuracy: Accuracy | None = None

    if TYPE_CHECKING:  # arrays may be given in any form; the fields are arrays

        def __init__(
            self,
            name: str,
            image_size: Sequence[int],
            camera_matrix: ArrayLike,
            distortion: Distortion = ...,
            R: ArrayLike = ...,
            t: ArrayLike = ...,
            optics: Optics | None = None,
            status: str = "virtual",
            accuracy: Accuracy | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        """Check every field and make its arrays read-only."""
        what = check_labels(self)
        if not isinstance(self.distortion, Distortion):
            raise ValueError(f"{what}: distortion: found {self.distortion!r}, expected Distortion")
        checked = {
            "image_size": image_size(self.image_size, what),
            "camera_matrix": _camera_matrix(self.camera_matrix, what),
            "R": rotation(self.R, f"{what}: R"),
            "t": numbers(self.t, (3,), f"{what}: t"),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        """Return the expression that builds this camera again."""
        return (
            f"Camera(name={self.name!r}, image_size={self.image_size!r}, "
            f"camera_matrix={self.camera_matrix.tolist()!r}, distortion={self.distortion!r}, "
            f"R={self.R.tolist()!r}, t={self.t.tolist()!r}, optics={self.optics!r}, "
            f"status={self.status!r}, accuracy={self.accuracy!r})"
        )

    def _values(self) -> tuple:
        """Return all values of the camera, comparable and hashable."""
        arrays = (self.camera_matrix, self.R, self.t)
        numbers = tuple(value for array in arrays for value in array.ravel().tolist())
        return (
            self.name,
            self.image_size,
            numbers,
            self.distortion,
            self.optics,
            self.status,
            self.accuracy,
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Camera):
            return NotImplemented
        return self._values() == other._values()

    def __hash__(self) -> int:
        return hash(self._values())

    @property
    def is_pinhole(self) -> bool:
        """Whether straight lines have straight images: there is no distortion."""
        return self.distortion.model != "fisheye" and not any(self.distortion.coefficients)

    has_lens_model = True
    has_pose = True
    sees_once = True
    is_straight = True

    @property
    def position(self) -> NDArray[np.float64]:
        """The centre of projection in world coordinates, ``(3,)``."""
        return -self.R.T @ self.t

    def project(self, points: ArrayLike) -> tuple[NDArray, NDArray, NDArray]:
        """Return the pixel coordinates of world points.

        Parameters
        ----------
        points : (N, 3) array_like

        Returns
        -------
        uv : (N, 2) float64
            Pixel coordinates (column, row), inside the image or not; NaN where not valid.
        depth : (N,) float64
            Distance along the optical axis; negative behind the camera.
        valid : (N,) bool
            True where the point is in front of the camera and inside the domain of its lens
            (see `Distortion`). A fisheye also sees points behind it.
        """
        points = rows_of(points, 3, "points to project")
        with np.errstate(invalid="ignore", over="ignore"):  # NaN and infinity are not valid
            in_camera = points @ self.R.T + self.t
        plane, valid = self.distortion.project(in_camera)
        (fx, skew, cx), (_, fy, cy) = self.camera_matrix[:2]
        u = fx * plane[:, 0] + skew * plane[:, 1] + cx
        return np.stack([u, fy * plane[:, 1] + cy], axis=-1), in_camera[:, 2], valid

    def rays(self, uv: ArrayLike | None = None) -> tuple[NDArray, NDArray]:
        """Return the lines of sight of pixels, the inverse of `project`.

        Parameters
        ----------
        uv : (N, 2) array_like, optional
            Pixel coordinates (column, row); by default every pixel's centre, row by row.

        Returns
        -------
        origins, directions : (N, 3) float64
            The camera's position, repeated, and unit vectors in the world; NaN where the lens maps
            no direction to the pixel.
        """
        uv = pixel_centres(self.image_size) if uv is None else rows_of(uv, 2, "pixel coordinates")
        (fx, skew, cx), (_, fy, cy) = self.camera_matrix[:2]
        y = (uv[:, 1] - cy) / fy
        plane = np.stack([(uv[:, 0] - cx - skew * y) / fx, y], axis=-1)
        directions = self.distortion.unproject(plane) @ self.R
        return np.repeat(self.position[None], len(uv), axis=0), directions

    def with_pose(self, camera_matrix: ArrayLike, R: ArrayLike, t: ArrayLike) -> Camera:
        """Return the camera with other intrinsics and another pose, their accuracy unknown."""
        K, R, t = (np.asarray(value, np.float64) for value in (camera_matrix, R, t))
        return replace(self, camera_matrix=K, R=R, t=t, accuracy=None)

    def scaled(self, scale: float) -> Camera:
        """Return the camera of the image resized by ``scale``, pixels as areas: 0.5 halves it.

        ``u' = scale (u + 1/2) - 1/2``; fractions of pixels right and below drop out.
        """
        width, height = scaled_size(self.image_size, scale, f"camera {self.name}")
        shift = (scale - 1) / 2
        resize = np.array([[scale, 0, shift], [0, scale, shift], [0, 0, 1]])
        return replace(
            self,
            image_size=(width, height),
            camera_matrix=resize @ self.camera_matrix,
            optics=self.optics and self.optics.with_pixels_scaled(1 / scale),
            accuracy=self.accuracy and self.accuracy.with_pixels_scaled(1 / scale),
        )

    def cropped(self, x: int, y: int, width: int, height: int) -> Camera:
        """Return the camera of the window whose top-left pixel was column ``x``, row ``y``."""
        check_window((x, y, width, height), self.image_size, f"camera {self.name}")
        matrix = self.camera_matrix - [[0, 0, x], [0, 0, y], [0, 0, 0]]
        return replace(self, image_size=(int(width), int(height)), camera_matrix=matrix)

    def rotated(self, degrees: int) -> Camera:
        """Return the camera of the image turned clockwise by 90, 180 or 270 degrees.

        The camera turns about its axis and the lens's terms turn along: see `rigs.lens.turned`.
        """
        quarters = quarter_turns(degrees, f"camera {self.name}")
        about = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), quarters)
        last = about @ np.subtract(self.image_size, 1.0)
        K, roll = np.eye(3), np.eye(3)
        K[:2, :2], lens, roll[:2, :2] = turned(self.distortion, about @ self.camera_matrix[:2, :2])
        K[:2, 2] = about @ self.camera_matrix[:2, 2] + np.maximum(-last, 0)
        size = np.abs(last).astype(int) + 1
        R, t = roll @ self.R, roll @ self.t
        return replace(self, image_size=size, camera_matrix=K, distortion=lens, R=R, t=t)

    def shifted(self, right: float, down: float) -> Camera:
        """Return the camera whose image lies that many pixels further right and down."""
        matrix = np.array(self.camera_matrix)
        matrix[:2, 2] += right, down
        return replace(self, camera_matrix=matrix)

    def transformed(self, R: ArrayLike, t: ArrayLike) -> Camera:
        """Return the camera after the rigid motion ``x_new = R @ x_old + t`` of the world."""
        R = rotation(R, f"camera {self.name}: motion R")
        t = numbers(t, (3,), f"camera {self.name}: motion t")
        turned = self.R @ R.T
        return replace(self, R=turned, t=self.t - turned @ t)

    def with_lengths_scaled(self, factor: float) -> Camera:
        """Return the camera of a world whose lengths are ``factor`` times as large."""
        optics = self.optics and self.optics.with_lengths_scaled(factor)
        return replace(self, t=self.t * factor, optics=optics)


def pinhole_matrix(
    image_size: tuple[int, int],
    fx: float,
    fy: float,
    principal_point: tuple[float, float] | None = None,
) -> list[list[float]]:
    """Return a camera matrix, in pixels; the principal point is the image's middle if None."""
    cx, cy = principal_point or ((image_size[0] - 1) / 2, (image_size[1] - 1) / 2)
    return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]


def look_at(
    position: ArrayLike, target: ArrayLike, up: ArrayLike = (0, 1, 0)
) -> tuple[NDArray, NDArray]:
    """Return ``R`` and ``t`` of a camera at ``position`` that sees ``target`` in its middle.

    ``up`` points to the top of the image, projected across the line of sight.
    """
    position = numbers(position, (3,), "position")
    forward = numbers(target, (3,), "look_at") - position
    upward = numbers(up, (3,), "up")
    distance = np.linalg.norm(forward)
    if not distance > 0:
        raise ValueError(f"look_at: found the position {position.tolist()}, expected another")
    forward = forward / distance
    length = np.linalg.norm(upward)
    down = -upward / (length if length > 0 else 1.0)
    down = down - (down @ forward) * forward
    if not np.linalg.norm(down) > 1e-6:
        raise ValueError(f"up: found {upward.tolist()}, expected a direction across the view")
    down = down / np.linalg.norm(down)
    R = np.stack([np.cross(down, forward), down, forward])
    return R, -R @ position


def _camera_matrix(matrix: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return a checked camera matrix ``(3, 3)``."""
    K = numbers(matrix, (3, 3), f"{what}: camera_matrix")
    if not (K[0, 0] > 0 and K[1, 1] > 0):
        raise ValueError(
            f"{what}: camera_matrix: found focal lengths {K[0, 0]} and {K[1, 1]}, "
            "expected positive pixels"
        )
    if max(K[0, 0], K[1, 1]) > _LONGEST_FOCUS:
        raise ValueError(
            f"{what}: camera_matrix: found focal lengths {K[0, 0]:g} and {K[1, 1]:g}, expected at "
            f"most {_LONGEST_FOCUS:g} pixels"
        )
    if not 1 / _MOST_STRETCHED <= K[1, 1] / K[0, 0] <= _MOST_STRETCHED:
        raise ValueError(
            f"{what}: camera_matrix: found focal lengths {K[0, 0]:g} and {K[1, 1]:g}, expected a "
            f"ratio of at most {_MOST_STRETCHED:g}"
        )
    if abs(K[0, 1]) > K[0, 0]:
        raise ValueError(
            f"{what}: camera_matrix: found a skew of {K[0, 1]:g}, expected at most the focal "
            f"length, {K[0, 0]:g} pixels"
        )
    if K[1, 0] != 0 or K[2].tolist() != [0, 0, 1]:
        raise ValueError(
            f"{what}: camera_matrix: found lower rows {K[1].tolist()} and {K[2].tolist()}, "
            "expected [0, fy, cy] and [0, 0, 1]"
        )
    return K
