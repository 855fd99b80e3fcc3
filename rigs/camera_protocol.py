"""The protocol of a camera: members that every kind of camera has."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, Self, TypeGuard

from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from rigs.figures import Accuracy, Optics
    from rigs.lens import Distortion


class CameraLike(Protocol):
    """A camera of any kind: `rigs.Camera` by a lens model, `rigs.RayTable` by stored rays.

    Callers rely on these members alone. Members of a lens model (``distortion``, an exact
    ``camera_matrix``) may be used where `has_lens_model` holds.

    Cameras are values: what a camera has can be read and not set.
    """

    @property
    def name(self) -> str:
        """Unique in a rig; names files and folders too."""

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height in pixels."""

    @property
    def status(self) -> str:
        """How the parameters are known: ``"calibrated"``, ``"nominal"`` or ``"virtual"``."""

    @property
    def optics(self) -> Optics | None:
        """Focal length, f-number, focus distance and pixel pitch, where known."""

    @property
    def accuracy(self) -> Accuracy | None:
        """How exactly the parameters are known, where that is stated."""

    @property
    def camera_matrix(self) -> NDArray:
        """Intrinsics ``(3, 3)``; without a lens model those of the nearest pinhole."""

    @property
    def R(self) -> NDArray:  # noqa: N802 (the field's symbol)
        """Rotation ``(3, 3)`` from world to camera axes, or that of the nearest pinhole."""

    @property
    def t(self) -> NDArray:
        """Translation ``(3,)``: ``x_cam = R @ x_world + t``, or that of the nearest pinhole."""

    @property
    def position(self) -> NDArray:
        """Centre of projection ``(3,)``; without a lens model the point nearest to all rays."""

    @property
    def has_lens_model(self) -> bool:
        """Whether `camera_matrix`, ``distortion`` and pose describe the camera exactly.

        All rays then meet in `position`.
        """

    @property
    def has_pose(self) -> bool:
        """Whether the camera can be moved and zoomed by `with_pose`; a table of rays cannot."""

    @property
    def is_pinhole(self) -> bool:
        """Whether ``camera_matrix @ [R | t]`` projects exactly: a lens without distortion."""

    @property
    def sees_once(self) -> bool:
        """Whether no point has two images."""

    @property
    def is_straight(self) -> bool:
        """Whether every pixel sees along one straight ray; else ``paths`` gives its pieces."""

    def project(self, points: ArrayLike) -> tuple[NDArray, NDArray, NDArray]:
        """Return pixel coordinates ``(N, 2)``, depth ``(N,)`` and validity ``(N,)`` of points."""

    def rays(self, uv: ArrayLike | None = None) -> tuple[NDArray, NDArray]:
        """Return origins and unit directions ``(N, 3)`` of pixels' lines of sight."""

    def inside(self, uv: ArrayLike) -> NDArray:
        """Return whether pixel coordinates ``(N, 2)`` lie on the image, ``(N,)``."""

    def with_pose(self, camera_matrix: ArrayLike, R: ArrayLike, t: ArrayLike) -> Self:
        """Return the camera, where it `has_pose`, with other intrinsics and another pose.

        Its `accuracy` is then unknown.
        """

    def renamed(self, name: str) -> Self:
        """Return the camera under another name."""

    def with_accuracy(self, accuracy: Accuracy | None) -> Self:
        """Return the camera of which another accuracy is known, or none."""

    def scaled(self, scale: float) -> Self:
        """Return the camera of the image resized by ``scale``."""

    def cropped(self, x: int, y: int, width: int, height: int) -> Self:
        """Return the camera of a window of the image."""

    def rotated(self, degrees: int) -> Self:
        """Return the camera of the image turned clockwise by 90, 180 or 270 degrees."""

    def shrunk(self, factor: int) -> Self:
        """Return the camera of area means over ``factor`` x ``factor`` pixels."""

    def shifted(self, right: float, down: float) -> Self:
        """Return the camera whose image lies that many pixels further right and down."""

    def transformed(self, R: ArrayLike, t: ArrayLike) -> Self:
        """Return the camera after the rigid motion ``x_new = R @ x_old + t`` of the world."""

    def with_lengths_scaled(self, factor: float) -> Self:
        """Return the camera of a world whose lengths are ``factor`` times as large."""


class LensCamera(CameraLike, Protocol):
    """A camera whose `camera_matrix`, ``distortion`` and pose describe it exactly."""

    @property
    def distortion(self) -> Distortion:
        """The lens's deviation from a pinhole."""


def has_lens(camera: CameraLike) -> TypeGuard[LensCamera]:
    """Return whether a camera `has_lens_model`, in a form that type checkers follow."""
    return camera.has_lens_model
