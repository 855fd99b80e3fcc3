"""Thumbnails of the cameras' images: in a rig's geometry, and side by side on one sheet."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig
from rigs.recordings import find_images, image_notes, luminance, read_still, without_pattern
from rigs.recordings.layout import ONLY, how_to_name
from tomo.draw.figures import INK, new_figure, plain, png_bytes
from tomo.draw.rig.camera_view import box_edges
from tomo.draw.rig.rig_scene import Target, on_symbol, symbol_length
from tomo.draw.scene import ColourScale, Scene
from tomo.draw.volume.planes import lattice_mesh
from tomo.grid import VoxelGrid
from tomo.scan import Scan, load_scan

_LONGEST = 480  # pixels of a thumbnail's longer side
_LONGEST_IN_SPACE = 48  # and of the one that hangs in the camera's symbol


def load_thumbnails(
    rig: Rig,
    source: Scan | str | os.PathLike,
    frame: str | None = None,
    pattern: str | None = None,
    note: Callable[[str], None] | None = None,
    longest: int = _LONGEST,
) -> dict[str, NDArray[np.uint8]]:
    """Return each camera's picture, shrunk by area means; cameras without one are left out.

    The source is a scan (a folder with a scan.yaml, or a transforms.json), whose images are
    corrected as it says, or a folder of images named by ``pattern``, see
    `rigs.recordings.find_images`. The first moment is read where ``frame`` is None. ``note`` is
    called with a line on what files say and reading does not heed. Pictures ``(rows, columns)``
    have one scale: the brightest 0.1 % of all cameras' pixels are white.

    Raises
    ------
    ValueError
        If no camera has an image, or one has another size than the camera's.
    """
    if isinstance(source, Scan) or (_is_scan(Path(source)) and pattern is None):
        scan = source if isinstance(source, Scan) else load_scan(source)
        source = Path("images") if scan.source is None else scan.source
        files, images = _of_scan(rig, source, scan, frame)
    else:
        source = Path(source)
        found = find_images(source, rig.names, pattern)
        chosen = {name: _of_frame(each, frame) for name, each in found.items()}
        files = {name: path for name, path in chosen.items() if path is not None}
        images = {name: _read(path, rig[name]) for name, path in files.items()}
    if note is not None:
        for line in image_notes({name: [path] for name, path in files.items()}):
            note(line)
    if not images:
        moment = "" if frame is None else f" of frame {frame}"
        raise ValueError(
            f"{source}: found no image{moment} of any camera, expected some of the rig's "
            f"{', '.join(rig.names)}: {how_to_name((), source, rig.names)}"
        )
    small = {name: shrunk(image, longest) for name, image in images.items()}
    bright = np.quantile(np.concatenate([image.ravel() for image in small.values()]), 0.999)
    scale = 255 / bright if bright > 0 else 1.0
    return {name: np.clip(image * scale, 0, 255).astype(np.uint8) for name, image in small.items()}


def image_scene(rig: Rig, target: Target, images: Mapping[str, NDArray]) -> Scene:
    """Return the thumbnails in the faces of the cameras' symbols; the group is ``images``."""
    length, scale = symbol_length(rig, target), ColourScale("", 0.0, 255.0, "gray")
    meshes = []
    for camera in rig:
        if camera.name not in images:
            continue
        small = _in_symbol(images[camera.name])
        rows, columns = small.shape
        u, v = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
        uv = np.stack([u.ravel(), v.ravel()], axis=-1) * camera.image_size - 0.5
        directions = camera.rays(uv)[1]
        finite = np.isfinite(directions).all(axis=1)
        points = on_symbol(camera, np.where(finite[:, None], directions, camera.R[2]), length)
        mesh = lattice_mesh(camera.name, "images", points, small, scale)
        kept = finite[mesh.triangles].all(axis=1)
        meshes.append(replace(mesh, triangles=mesh.triangles[kept]))
    return Scene(tuple(meshes), length_unit=rig.length_unit)


def symbol_values(picture: NDArray) -> NDArray[np.uint8]:
    """Return a thumbnail's numbers at its mesh in `image_scene`, as pages hold them: 1 to 255."""
    return np.round(1 + 254 / 255 * _in_symbol(picture).ravel()).astype(np.uint8)


def _in_symbol(picture: NDArray) -> NDArray[np.float32]:
    return shrunk(picture.astype(np.float32), _LONGEST_IN_SPACE)


def _is_scan(source: Path) -> bool:
    """Tell whether there is a scan, no mere folder of images."""
    if not source.exists():
        raise FileNotFoundError(f"{source}: no such folder of images")
    names = ("scan.yaml", "transforms.json")
    return source.suffix == ".json" or any((source / name).exists() for name in names)


def _of_scan(
    rig: Rig, source: Path, scan: Scan, frame: str | None
) -> tuple[dict[str, Path], dict[str, NDArray[np.float32]]]:
    """Return the files and the images of a scan's cameras that the rig has too."""
    held = scan.frame(frame).images
    common = [name for name in scan.rig.names if name in rig.names and name in held]
    if not common:
        return {}, {}
    scan = scan.only(*common)
    for camera in scan.rig:
        size = scan.recorded_sizes[camera.name]
        if rig[camera.name].image_size != camera.image_size:  # all of a mosaic's colours
            _check_size(source, size, rig[camera.name])
    images = dict(zip(scan.rig.names, scan.images(frame), strict=True))
    return {name: held[name] for name in images if isinstance(held[name], Path)}, images


def _of_frame(files: Mapping[str, Path], frame: str | None) -> Path | None:
    """Return a camera's file of a frame, its first, or its only one; None where there is none."""
    return next(iter(files.values())) if frame is None else files.get(frame, files.get(ONLY))


def _read(path: Path, camera: CameraLike) -> NDArray[np.float32]:
    """Return a photograph as grey levels."""
    try:
        still = read_still(path)
        image = luminance(without_pattern(still.pixels) if still.is_mosaic else still.pixels)
    except (OSError, ValueError) as error:
        raise ValueError(f"camera {camera.name}: {error}") from None
    _check_size(path, image.shape[::-1], camera)
    return np.nan_to_num(image.astype(np.float32), posinf=0.0, neginf=0.0)


def _check_size(path: Path, size: tuple[int, int], camera: CameraLike) -> None:
    if tuple(size) != camera.image_size:
        raise ValueError(
            f"{path}: camera {camera.name}: found an image of {size[0]} x {size[1]} pixels, "
            f"expected {camera.image_size[0]} x {camera.image_size[1]}, the camera's image_size"
        )


def shrunk(image: NDArray, longest: int) -> NDArray:
    """Return the image's area means, its longer side at most ``longest``."""
    import cv2

    rows, columns = image.shape
    scale = longest / max(rows, columns)
    if scale >= 1:
        return image
    size = (max(1, round(columns * scale)), max(1, round(rows * scale)))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def contact_sheet(
    rig: Rig, images: Mapping[str, NDArray[np.uint8]], grid: VoxelGrid, title: str = ""
) -> bytes:
    """Return a PNG of `load_thumbnails`' images, the box's edges drawn into each."""
    cameras = [camera for camera in rig if camera.name in images]
    tall = max(camera.image_size[1] / camera.image_size[0] for camera in cameras)
    columns = min(len(cameras), max(1, round(math.sqrt(1.5 * tall * len(cameras)))))
    rows = -(-len(cameras) // columns)
    columns = -(-len(cameras) // rows)
    figure = new_figure(10.0, rows * (10.0 / columns * tall + 0.2) + 0.35, dpi=110)
    figure.set_layout_engine("compressed", w_pad=0.01, h_pad=0.01, wspace=0, hspace=0)
    figure.suptitle(plain(title), fontsize=10, color=INK)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels:
        axes.set_axis_off()
    for axes, camera in zip(panels, cameras, strict=False):
        width, height = camera.image_size
        extent = (-0.5, width - 0.5, height - 0.5, -0.5)
        axes.imshow(images[camera.name], cmap="inferno", vmin=0, vmax=255, extent=extent)
        for edge in box_edges(camera, grid):
            axes.plot(*edge.T, color="#7fd4ff", linewidth=0.8)
        axes.set(xlim=extent[:2], ylim=extent[2:])
        axes.set_title(plain(camera.name), fontsize=8, color=INK, pad=2)
    return png_bytes(figure)
