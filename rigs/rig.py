"""An ordered set of cameras around one scene."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.camera_protocol import CameraLike
from rigs.geometry.points import box_points
from rigs.geometry.rotation import numbers, rotation

if TYPE_CHECKING:
    from rigs.scene.scene import Scene


@dataclass(frozen=True)
class Volume:
    """The box of voxels that a rig was made for; the default grid of commands.

    Parameters
    ----------
    shape : (int, int, int)
        Number of voxels along x, y, z.
    spacing : (float, float, float)
        Edge lengths of a voxel; a single length applies to all three.
    center : (float, float, float)
        The middle of the box.
    """

    shape: tuple[int, int, int]
    spacing: tuple[float, float, float]
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)

    if TYPE_CHECKING:  # as called: sequences of any kind, and one length for all axes

        def __init__(
            self,
            shape: Sequence[int],
            spacing: float | Sequence[float],
            center: Sequence[float] = (0.0, 0.0, 0.0),
        ) -> None: ...

    def __post_init__(self) -> None:
        """Normalise to plain tuples, so that volumes compare, hash and print as values."""
        shape = numbers(self.shape, (3,), "volume.shape")
        if (shape < 1).any() or (shape != np.floor(shape)).any():
            raise ValueError(f"volume.shape: found {self.shape!r}, expected 3 whole numbers >= 1")
        size = (3,) if np.ndim(self.spacing) else ()
        spacing = np.broadcast_to(numbers(self.spacing, size, "volume.spacing"), 3)
        if not (spacing > 0).all():
            raise ValueError(f"volume.spacing: found {self.spacing!r}, expected positive lengths")
        center = numbers(self.center, (3,), "volume.center")
        object.__setattr__(self, "shape", tuple(int(n) for n in shape))
        object.__setattr__(self, "spacing", tuple(spacing.tolist()))
        object.__setattr__(self, "center", tuple(center.tolist()))

    def corners(self) -> NDArray[np.float64]:
        """Return the corners of the box, ``(8, 3)``."""
        half = np.multiply(self.shape, self.spacing) / 2
        return self.center + box_points(-half, half, 2)

    def transformed(self, R: NDArray, t: NDArray) -> Volume | None:
        """Return the box after a rigid motion; None if its faces leave the axes' directions."""
        turn = np.rint(R)
        if np.abs(R - turn).max() > 1e-9:
            return None
        shape, spacing = np.abs(turn) @ self.shape, np.abs(turn) @ self.spacing
        return Volume(tuple(shape), tuple(spacing), tuple(R @ self.center + t))

    def with_lengths_scaled(self, factor: float) -> Volume:
        """Return the box of a world whose lengths are ``factor`` times as large."""
        return Volume(
            self.shape,
            tuple(length * factor for length in self.spacing),
            tuple(length * factor for length in self.center),
        )


@dataclass(frozen=True)
class Rig(Sequence[CameraLike]):
    """Cameras in order: ``rig[3]`` and ``rig["cam03"]`` are cameras, ``rig[0::3]`` is a rig.

    Parameters
    ----------
    cameras : sequence of Camera or RayTable
        No two have the same name. A rig may be empty.
    length_unit : str
        Unit of every length in the rig.
    world_frame : str
        Origin and axes of the world in words.
    volume : Volume, optional
        The voxels the rig was made for.
    calibration : dict, optional
        Quality figures and provenance as plain data, kept unchanged.

    Raises
    ------
    ValueError
        If two cameras have one name, or a field has the wrong type.
    """

    cameras: tuple[CameraLike, ...]
    length_unit: str = "mm"
    world_frame: str = ""
    volume: Volume | None = None
    calibration: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        """Check the fields and copy mutable ones."""
        cameras = tuple(self.cameras)
        names = set()
        for index, camera in enumerate(cameras):
            if not all(hasattr(type(camera), name) for name in ("project", "rays")):
                raise ValueError(f"rig cameras[{index}]: found {camera!r}, expected a Camera")
            if camera.name in names:
                raise ValueError(f"camera {camera.name}: name: found twice, expected once")
            names.add(camera.name)
        if not isinstance(self.length_unit, str) or not self.length_unit.strip():
            raise ValueError(f"length_unit: found {self.length_unit!r}, expected a unit, like mm")
        if not isinstance(self.world_frame, str):
            raise ValueError(f"world_frame: found {self.world_frame!r}, expected text")
        if self.volume is not None and not isinstance(self.volume, Volume):
            raise ValueError(f"volume: found {self.volume!r}, expected Volume or None")
        object.__setattr__(self, "cameras", cameras)
        object.__setattr__(self, "calibration", copy.deepcopy(self.calibration))

    def __repr__(self) -> str:
        """Return one line: cameras, their sizes and the unit; a camera prints in full."""
        names = self.names if len(self) < 4 else (*self.names[:2], "...", self.names[-1])
        sizes = {"{} x {}".format(*camera.image_size): None for camera in self.cameras}
        pixels = f", {', '.join(list(sizes)[:3])}{' ...' if len(sizes) > 3 else ''} pixels"
        shown = f" ({', '.join(names)}){pixels}" if names else ""
        return f"<Rig: {len(self)} camera{'s' * (len(self) != 1)}{shown}, in {self.length_unit}>"

    def __hash__(self) -> int:
        return hash((self.cameras, self.length_unit, self.world_frame, self.volume))

    def __len__(self) -> int:
        return len(self.cameras)

    def __iter__(self) -> Iterator[CameraLike]:
        return iter(self.cameras)

    def __contains__(self, item: object) -> bool:
        """Return whether ``item``, a camera or a name, is in the rig."""
        return item in self.names if isinstance(item, str) else item in self.cameras

    @overload
    def __getitem__(self, key: int | str) -> CameraLike: ...

    @overload
    def __getitem__(self, key: slice) -> Rig: ...

    def __getitem__(self, key: int | str | slice) -> CameraLike | Rig:
        """Return a camera by number or name, or the rig of a slice of the cameras."""
        if isinstance(key, slice):
            return replace(self, cameras=self.cameras[key])
        if isinstance(key, str):
            return self.cameras[self._index(key)]
        return self.cameras[key]

    @property
    def names(self) -> tuple[str, ...]:
        """The cameras' names, in order."""
        return tuple(camera.name for camera in self.cameras)

    @property
    def scene(self) -> Scene | None:
        """What the cameras look through; None where nothing is in the way."""
        scenes = [camera.scene for camera in self.cameras if hasattr(camera, "scene")]
        return scenes[0] if scenes else None

    def through(self, scene: Scene) -> Rig:
        """Return the rig whose cameras look through ``scene``, in place of any they had.

        They look at the volume's centre; without a volume, where their middle rays meet.
        """
        from rigs.geometry.points import point_in_view
        from rigs.scene.scene_camera import SceneCamera, own_camera

        cameras = tuple(own_camera(camera) for camera in self.cameras)
        middle = self.volume.center if self.volume else point_in_view(cameras)
        middle = (0.0, 0.0, 0.0) if middle is None else tuple(middle)
        return replace(
            self, cameras=tuple(SceneCamera(camera, scene, middle) for camera in cameras)
        )

    def with_fresnel(self, fresnel: bool) -> Rig:
        """Return the rig whose scene's glass takes the light that it reflects, or does not."""
        if self.scene is None:
            raise ValueError(f"fresnel: found {fresnel} without a scene, expected one in rig.yaml")
        return self.through(replace(self.scene, fresnel=fresnel))

    def without(self, *names: str) -> Rig:
        """Return the rig of all other cameras."""
        left_out = {self._index(name) for name in names}
        kept = (camera for i, camera in enumerate(self.cameras) if i not in left_out)
        return replace(self, cameras=tuple(kept))

    def transformed(self, R: ArrayLike, t: ArrayLike) -> Rig:
        """Return the rig after the rigid motion ``x_new = R @ x_old + t`` of the world.

        The volume moves along if its faces stay parallel to the axes; otherwise it is dropped.
        """
        R, t = rotation(R, "motion R"), numbers(t, (3,), "motion t")
        return replace(
            self,
            cameras=tuple(camera.transformed(R, t) for camera in self.cameras),
            volume=self.volume and self.volume.transformed(R, t),
        )

    def with_lengths_scaled(self, factor: float) -> Rig:
        """Return the rig of a world whose lengths are ``factor`` times as large, in its unit.

        The calibration's figures are kept as they are.
        """
        return replace(
            self,
            cameras=tuple(camera.with_lengths_scaled(factor) for camera in self.cameras),
            volume=self.volume and self.volume.with_lengths_scaled(factor),
        )

    def footprint(self, point: ArrayLike = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
        """Return each camera's pixel size at ``point``, ``(cameras,)``, distortion ignored.

        Depth over focal length (geometric mean of both axes); NaN behind the camera.
        """
        point = numbers(point, (3,), "point")
        sizes = []
        for camera in self.cameras:
            depth = float(camera.R[2] @ point + camera.t[2])
            focal = math.sqrt(camera.camera_matrix[0, 0] * camera.camera_matrix[1, 1])
            sizes.append(depth / focal if depth > 0 else math.nan)
        return np.array(sizes, np.float64)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the cameras around the volume, and a table."""
        from rigs.files.text import some
        from rigs.notebook import drawing, facts, framed, times

        volume, unit = self.volume, self.length_unit
        corners = None if volume is None else volume.corners()
        rows: list[tuple[str, object]] = [("names", some(self.names) or "none")]
        sizes = sorted({camera.image_size for camera in self.cameras})
        rows.append(("images", some([f"{times(size)} pixels" for size in sizes]) or "none"))
        if volume is not None:
            middle = np.array(volume.center)
            away = [float(np.linalg.norm(one.position - middle)) for one in self.cameras]
            if away:
                ends = dict.fromkeys(f"{each:.5g}" for each in (min(away), max(away)))
                rows.append(("distance", f"{' to '.join(ends)} {unit}"))
            rows.append(("voxels", f"{times(volume.shape)} of {times(volume.spacing)} {unit}"))
        rows.append(("status", some(sorted({one.status for one in self.cameras})) or "none"))
        if self.scene is not None:
            rows.append(("looks through", some([solid.name for solid in self.scene.solids])))
        rows.append(("world", self.world_frame or "not described"))
        count = f"{len(self)} camera{'s' if len(self) != 1 else ''}"
        return framed(f"Rig of {count}", drawing(self.cameras, corners), facts(rows))

    def _index(self, name: str) -> int:
        """Return the index of the camera called ``name``."""
        try:
            return self.names.index(name)
        except ValueError:
            known = ", ".join(self.names) or "none"
            raise ValueError(f"camera {name}: not in the rig, expected one of {known}") from None
