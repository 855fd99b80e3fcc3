"""Scans and film scans onto disk: rig, images and scan.yaml, written whole or not at all."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from numpy.typing import ArrayLike, DTypeLike, NDArray

from rigs import Rig, save_rig
from rigs.files import whole_folder
from rigs.recordings import write_image
from tomo.grid import VoxelGrid
from tomo.io import write_volume
from tomo.io.volume_film import VolumeFilm
from tomo.io.volumes import check_length_unit
from tomo.scan.corrections import Corrections
from tomo.scan.image_source import MeanImage
from tomo.scan.radiometry import Radiometry

if TYPE_CHECKING:
    from os import PathLike

SCAN_FILE = "scan.yaml"


def save_scan(
    folder: str | PathLike,
    rig: Rig,
    frames: Mapping[str, Mapping[str, ArrayLike]],
    *,
    grid: VoxelGrid | None = None,
    truth: ArrayLike | None = None,
    corrections: Corrections | None = None,
    effects: Mapping[str, Any] | None = None,
    radiometry: Radiometry | None = None,
    peak: float | None = None,
    frame_rate: float | None = None,
) -> Path:
    """Write a scan folder: ``rig.yaml``, ``images/<camera>/<frame>.tif``, ``scan.yaml``.

    Until all is written, the folder keeps what stood there before: see `rigs.files.whole_folder`.

    Parameters
    ----------
    frames : mapping
        Frame name to a mapping from camera name to image ``(h, w)``.
    truth : (nx, ny, nz) array, optional
        The true volume on ``grid``; stored as ``truth.npz``.
    corrections, radiometry : optional
        Paths of images must lie inside ``folder``; arrays are written to ``corrections/`` and
        ``radiometry/``.
    effects, peak, frame_rate : optional
        See `Scan`.

    Returns
    -------
    scan_file : Path

    Raises
    ------
    ValueError
        If a name cannot be a file's, an image is not of its camera's size, or a truth has no grid.
    """
    folder = Path(folder)
    if truth is not None and grid is None:
        raise ValueError(f"{folder}: truth: found no grid, expected the one that it lies on")
    if truth is not None:
        check_length_unit(rig.length_unit)
    for frame, images in frames.items():
        for camera, image in images.items():
            check_image(folder, frame, camera, np.shape(image), rig)
    plain, images_of_corrections = plain_corrections(folder, corrections)
    light, images_of_light = plain_corrections(folder, radiometry, "radiometry")
    content = _content(
        grid=None if grid is None else grid.to_mapping(),
        frames=[
            {"name": frame, "images": {name: f"images/{name}/{frame}.tif" for name in images}}
            for frame, images in frames.items()
        ],
        corrections=plain,
        radiometry=light,
        peak=peak,
        frame_rate=frame_rate,
        truth=None if truth is None else "truth.npz",
        effects=_known(effects),
    )
    with whole_folder(folder, last=(SCAN_FILE,)) as staging:
        save_rig(rig, staging / "rig.yaml")
        for frame, images in frames.items():
            for camera, image in images.items():
                write_image(staging / "images" / camera / f"{frame}.tif", image)
        for place, image in (images_of_corrections | images_of_light).items():
            write_image(staging / place, image)
        if truth is not None:
            unit = "" if radiometry is None else radiometry.value_unit
            write_volume(staging / "truth.npz", truth, grid, rig.length_unit, value_unit=unit)
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
        (staging / SCAN_FILE).write_text(text, encoding="utf-8")
    return folder / SCAN_FILE


def _content(**more: Any) -> dict[str, Any]:
    """Return what a scan.yaml holds, without what is None."""
    head = {"format": "emission-scan", "version": 1, "rig": "rig.yaml"}
    return head | (_known(more) or {})


def _known(values: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if values is None:
        return None
    return {name: value for name, value in values.items() if value is not None}


def check_image(folder: Path, frame: str, camera: str, shape: tuple, rig: Rig) -> None:
    """Refuse names that no file can have, and images that are not of their camera's size."""
    check_cameras(folder, f"frame {frame!r}", [camera], rig)
    for name in (frame, camera):
        if not name or name.startswith(".") or set(name) & set('/\\:*?"<>|\0'):
            raise ValueError(f"{folder}: found the name {name!r}, expected one fit for a file")
    width, height = rig[camera].image_size
    if shape != (height, width):
        raise ValueError(
            f"{folder}: frame {frame!r}: camera {camera}: found an image of shape {shape}, "
            f"expected {(height, width)}"
        )


def plain_corrections(
    folder: Path, corrections: Corrections | Radiometry | None, name: str = "corrections"
) -> tuple[dict[str, Any] | None, dict[str, NDArray]]:
    """Return corrections as a scan.yaml holds them, and the images to write, by their paths."""
    images: dict[str, NDArray] = {}

    def plain(value: Any, place: str) -> Any:
        if isinstance(value, MeanImage):
            raise ValueError(
                f"{folder}: {place}: found the mean of {len(value.images)} images, expected one"
            )
        if is_dataclass(value):
            each = {one.name: getattr(value, one.name) for one in fields(value)}
            found = {key: plain(one, f"{place}/{key}") for key, one in each.items()}
            return {key: one for key, one in found.items() if one is not None}
        if isinstance(value, Mapping):
            return {camera: plain(one, f"{place}_{camera}") for camera, one in value.items()}
        if isinstance(value, np.ndarray):
            images[f"{place}.tif"] = value.astype(np.uint8) if value.dtype == bool else value
            return f"{place}.tif"
        if isinstance(value, tuple):
            return list(value)
        return os.path.relpath(value, folder) if isinstance(value, Path) else value

    return plain(corrections, name), images


def check_cameras(path: object, field: str, cameras: Iterable[str], rig: Rig) -> None:
    """Refuse names that are no cameras of the rig; ``path`` and ``field`` say where they stand."""
    for camera in cameras:
        if camera not in rig.names:
            known = ", ".join(rig.names)
            where = f"{path}: {field}: " if field else f"{path}: "
            raise ValueError(f"{where}found camera {camera!r}, expected one of the rig's: {known}")


TRUTH = "truth.zarr"

_CLASSIC = 2**31
"""Bytes of pixels from which on a stack is a BigTIFF: the classic format ends at 2**32."""

Put = Callable[[Mapping[str, NDArray], NDArray], None]


@contextmanager
def writing_film(
    folder: str | PathLike,
    rig: Rig,
    grid: VoxelGrid,
    *,
    frames: int,
    frame_rate: float,
    dtype: DTypeLike,
    corrections: Corrections | None = None,
    effects: Mapping[str, Any] | None = None,
) -> Iterator[Put]:
    """Yield what takes the images and the truth of one frame after the other.

    The folder appears when the block succeeds, whole or not at all: ``rig.yaml``,
    ``films/<camera>.tif``, ``truth.zarr``, ``scan.yaml``. One frame at a time is in memory:
    ``put(images, truth)`` takes camera to ``(h, w)``, and ``(nx, ny, nz)``. Pixels are uint8,
    uint16 or float32; corrections are numbers.
    """
    import tifffile

    folder = Path(folder)
    check_length_unit(rig.length_unit)
    content = _content(
        grid=grid.to_mapping(),
        frame_rate=frame_rate,
        truth=TRUTH,
        films={name: f"films/{name}.tif" for name in rig.names},
        corrections=plain_corrections(folder, corrections)[0],
        effects=_known(effects),
    )
    old = folder / TRUTH / "emission" / "c"
    stale = [str(path.relative_to(folder)) for path in old.rglob("*") if path.is_file()]
    with whole_folder(folder, last=(SCAN_FILE,), others=stale) as staging, ExitStack() as files:
        save_rig(rig, staging / "rig.yaml")
        (staging / "films").mkdir()
        stacks = {}
        for camera in rig:
            size = frames * math.prod(camera.image_size) * np.dtype(dtype).itemsize
            path = staging / content["films"][camera.name]
            stacks[camera.name] = files.enter_context(
                tifffile.TiffWriter(path, bigtiff=size >= _CLASSIC)
            )
        times = np.arange(frames) / frame_rate
        truths = VolumeFilm.create(staging / TRUTH, grid, times.tolist(), rig.length_unit)
        done = 0

        def put(images: Mapping[str, NDArray], truth: NDArray) -> None:
            nonlocal done
            for name, image in images.items():
                check_image(folder, str(done), name, np.shape(image), rig)
                stacks[name].write(
                    image.astype(dtype, copy=False), photometric="minisblack", metadata=None,
                    contiguous=False,
                )  # fmt: skip
            truths.write(done, truth)
            done += 1

        yield put
        if done != frames:
            raise ValueError(f"{folder}: frames: found {done}, expected {frames}")
        files.close()
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
        (staging / SCAN_FILE).write_text(text, encoding="utf-8")
