"""Images with poses, as structure from motion gives them, sorted into cameras and frames."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from rigs.camera import Camera

Frames = list[tuple[str, dict[str, Path]]]


def named(
    images: Sequence[PurePosixPath],
    cameras: Sequence[Camera],
    given: Sequence[str | None],
    file_stem: str,
) -> tuple[list[str], list[str]]:
    """Return each image's camera name and frame name.

    An image's camera is the one given, else its folder, else the image itself, named by its
    stem; the frame is the image's stem. A folder of *all* images names no camera if their
    cameras differ: each image is then a camera, and all belong to one frame, ``file_stem``.
    """
    unnamed = [i for i, name in enumerate(given) if name is None]
    folders = {images[i].parent for i in unnamed}
    alone = len(folders) == 1 and any(difference(cameras[i], cameras[unnamed[0]]) for i in unnamed)
    alike = Counter(folder.name for folder in folders)
    names, frame_names = [], []
    for image, name in zip(images, given, strict=True):
        if name is not None:
            names.append(name)
            frame_names.append(image.stem)
        elif alone or not image.parent.name:
            names.append(image.stem)
            frame_names.append(file_stem)
        else:
            folder = image.parent  # all of its parts where another folder ends the same
            names.append(folder.name if alike[folder.name] == 1 else "_".join(folder.parts))
            frame_names.append(image.stem)
    return names, frame_names


def grouped(
    folder: Path,
    images: Sequence[PurePosixPath],
    cameras: Sequence[Camera],
    names: Sequence[str],
    frame_names: Sequence[str],
    fields: Mapping[str, str],
) -> tuple[list[Camera], Frames]:
    """Return the different cameras and the images by frame and camera.

    ``fields`` gives the file's names of a camera's fields, for the error about two images of one
    camera that differ.
    """
    by_name: dict[str, tuple[Camera, PurePosixPath]] = {}
    frames: dict[str, dict[str, Path]] = {}
    for image, camera, name, frame in zip(images, cameras, names, frame_names, strict=True):
        first, first_image = by_name.setdefault(name, (camera, image))
        field = difference(camera, first)
        if field:
            raise ValueError(
                f"camera {name}: {fields[field]}: differs between {first_image} and {image}, "
                "expected the same in all its entries"
            )
        views = frames.setdefault(frame, {})
        if name in views:
            raise ValueError(f"camera {name}: frame {frame}: found twice, expected one image")
        views[name] = folder / image
    renamed = [replace(camera, name=name) for name, (camera, _) in by_name.items()]
    return renamed, list(frames.items())


def difference(camera: Camera, other: Camera) -> str:
    """Return the name of the first field in which two cameras differ, or nothing."""
    for field in ("image_size", "distortion"):
        if getattr(camera, field) != getattr(other, field):
            return field
    for field in ("camera_matrix", "R", "t"):
        if not np.allclose(getattr(camera, field), getattr(other, field), rtol=1e-9, atol=1e-12):
            return field
    return ""
