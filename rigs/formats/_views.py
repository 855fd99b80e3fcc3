"""Images with poses, as structure from motion gives them, sorted into cameras and frames."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath

import numpy as np

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike, LensCamera
from rigs.files.text import shortened
from rigs.files.units import UNKNOWN
from rigs.formats._lens import limited
from rigs.rig import Rig

logger = logging.getLogger(__name__)

Frames = list[tuple[str, dict[str, Path]]]


@dataclass
class Views:
    """The images of the file ``path`` with their cameras, collected one by one.

    ``lost`` are views without a pose, which are left out.
    """

    path: Path
    images: list[PurePosixPath] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    sensors: list[object] = field(default_factory=list)
    finish: list[Callable[[Camera], CameraLike]] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)

    def add(
        self,
        image: str,
        camera: Camera,
        sensor: object = None,
        finish: Callable[[Camera], CameraLike] | None = None,
    ) -> None:
        """Add an image and its camera under a placeholder name.

        ``sensor`` is the physical camera, see `named`; ``finish``, a function or its
        `functools.partial` with keywords, makes a table of rays where no lens holds the camera's.
        """
        path = PurePosixPath(image.strip().replace("\\", "/"))
        if not path.name:
            raise ValueError(f"found {shortened(image)}, expected an image's name")
        known = re.fullmatch(r"\.[A-Za-z]\w{1,4}", path.suffix)  # cam1.5 has no ending
        self.images.append(path if known else path.with_name(f"{path.name}.png"))
        self.cameras.append(camera)
        self.sensors.append(sensor)
        self.finish.append(finish or _unchanged)

    def rig(self, unit: str = UNKNOWN, frame: str | None = None) -> Rig:
        """Return the rig of the images; those in ``lost`` are named."""
        if not self.images:
            raise ValueError(f"found a pose of none of {len(self.lost)} views, expected some")
        if self.lost:
            logger.warning("%s: left out %d views without a pose: %s", self.path, len(self.lost),
                           shortened(", ".join(self.lost)))  # fmt: skip
        given = [None] * len(self.images)
        sensors = None if None in self.sensors else self.sensors
        names, frames = named(self.images, self.cameras, given, self.path.stem, sensors)
        cameras = finished(self.images, self.cameras, names, frames, self.finish)
        return Rig(cameras, unit, frame or f"as in {self.path.name}")


def finished(
    images: Sequence[PurePosixPath],
    cameras: Sequence[Camera],
    names: Sequence[str],
    frames: Sequence[str],
    finish: Sequence[Callable[[Camera], CameraLike]],
) -> tuple[CameraLike, ...]:
    """Return the different cameras of images, each made by its images' ``finish``."""
    found, _ = grouped(Path(), images, cameras, names, frames)
    first = dict(zip(reversed(names), reversed(finish), strict=True))
    for name, other in zip(names, finish, strict=True):
        if _parts(other) != _parts(first[name]):
            raise ValueError(f"camera {name}: distortion: differs between images, expected one")
    return limited(first[camera.name](camera) for camera in found)


def _parts(finish: Callable) -> tuple[object, ...]:
    """Return what makes two partial functions the same."""
    return getattr(finish, "func", finish), getattr(finish, "keywords", None)


def _unchanged(camera: Camera) -> CameraLike:
    return camera


def named(
    images: Sequence[PurePosixPath],
    cameras: Sequence[Camera],
    given: Sequence[str | None],
    file_stem: str,
    sensors: Sequence[object] | None = None,
) -> tuple[list[str], list[str]]:
    """Return each image's camera name and frame name.

    An image's camera is the one given, else its folder, else the image itself, named by its stem;
    the frame is the image's stem. A folder of *all* images names no camera if their cameras
    differ: each image is then a camera, and all belong to one frame, ``file_stem``. Images of
    equal pose and lens among those are moments of one camera: see `_moments`. Where ``sensors``,
    an image's physical camera each, are all one that moved, every image is a camera too.
    """
    unnamed = [i for i, name in enumerate(given) if name is None]
    folders = {images[i].parent for i in unnamed}
    first = {images[i].parent: cameras[i] for i in reversed(unnamed)}
    has_moved = any(difference(cameras[i], first[images[i].parent]) for i in unnamed)
    is_one_sensor = sensors is not None and len(set(sensors)) == 1
    alone = has_moved and (len(folders) == 1 or is_one_sensor)
    stems = Counter(images[i].stem for i in unnamed)
    flat = [i for i in unnamed if alone or not images[i].parent.name]
    moments = dict(
        zip(flat, _moments([images[i] for i in flat], [cameras[i] for i in flat]), strict=False)
    )
    alike = Counter(folder.name for folder in folders)
    names, frame_names = [], []
    for index, (image, name) in enumerate(zip(images, given, strict=True)):
        if name is not None:
            names.append(name)
            frame_names.append(image.stem)
        elif index in moments:
            names.append(moments[index][0])
            frame_names.append(moments[index][1])
        elif alone or not image.parent.name:
            is_clear = stems[image.stem] == 1 or len(folders) == 1
            names.append(image.stem if is_clear else "_".join(image.with_suffix("").parts))
            frame_names.append(file_stem)
        else:
            folder = image.parent  # all of its parts where another folder ends the same
            names.append(folder.name if alike[folder.name] == 1 else "_".join(folder.parts))
            frame_names.append(image.stem)
    return names, frame_names


def _moments(images: Sequence[PurePosixPath], cameras: Sequence[Camera]) -> list[tuple[str, str]]:
    """Return each image's camera and moment where several are of one camera, else nothing."""
    kinds = _kinds(cameras)
    first = {kind: index for index, kind in reversed(list(enumerate(kinds)))}
    repeated = next((i for i, kind in enumerate(kinds) if first[kind] != i), None)
    if repeated is None:
        return []
    words = [re.fullmatch(r"(.*?)[_\-. ]*(\d+)", image.stem) for image in images]
    found = [(w[1] or "camera", w[2]) if w else ("", "") for w in words]
    by_name = {name: kind for (name, _), kind in zip(found, kinds, strict=True)}
    if (
        all(words)
        and len(set(found)) == len(found)
        and len(by_name) == len(first)
        and all(by_name[name] == kind for (name, _), kind in zip(found, kinds, strict=True))
    ):
        return found
    raise ValueError(
        f"images {images[first[kinds[repeated]]]} and {images[repeated]} have the same pose and "
        "lens: are they moments of one camera? If so, name them by the moment's number, like "
        "left_0001.png, left_0002.png; if they are two cameras, put them into folders of the "
        "cameras' names"
    )


def _kinds(cameras: Sequence[Camera]) -> list[int]:
    """Return a number for each camera, the same for those without a `difference`."""
    # compared along one sorted line of a weighted sum of their parameters
    sums = []
    for camera in cameras:
        K, R = camera.camera_matrix.ravel(), camera.R.ravel()
        lens = camera.distortion.coefficients
        values = np.concatenate([K, R, camera.t, camera.image_size, lens])
        sums.append(float(values @ np.sqrt(np.arange(2.0, 2 + len(values)))))
    kinds, last = [0] * len(cameras), None
    for index in np.argsort(sums, kind="stable").tolist():
        if last is None or difference(cameras[index], cameras[last]):
            last = index
        kinds[index] = last
    return kinds


def grouped(
    folder: Path,
    images: Sequence[PurePosixPath],
    cameras: Sequence[Camera],
    names: Sequence[str],
    frame_names: Sequence[str],
) -> tuple[list[Camera], Frames]:
    """Return the different cameras and the images by frame and camera."""
    by_name: dict[str, tuple[Camera, PurePosixPath]] = {}
    frames: dict[str, dict[str, Path]] = {}
    for image, camera, name, frame in zip(images, cameras, names, frame_names, strict=True):
        first, first_image = by_name.setdefault(name, (camera, image))
        field = difference(camera, first)
        if field:
            raise ValueError(
                f"camera {name}: {field}: differs between {first_image} and {image}, "
                "expected the same in all its entries: where cameras moved round a still scene, "
                "put their images into one folder, which makes each image a camera"
            )
        views = frames.setdefault(frame, {})
        if name in views:
            raise ValueError(f"camera {name}: frame {frame}: found twice, expected one image")
        views[name] = folder / image
    renamed = [replace(camera, name=name) for name, (camera, _) in by_name.items()]
    return renamed, list(frames.items())


def difference(camera: LensCamera, other: LensCamera) -> str:
    """Return the name of the first field in which two cameras differ, or nothing."""
    for name in ("image_size", "distortion"):
        if getattr(camera, name) != getattr(other, name):
            return name
    for name in ("camera_matrix", "R", "t"):
        if not np.allclose(getattr(camera, name), getattr(other, name), rtol=1e-9, atol=1e-12):
            return name
    return ""
