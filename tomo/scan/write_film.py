"""Film scans onto disk, frame by frame: a TIFF stack a camera, the truths, and scan.yaml."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from numpy.typing import DTypeLike, NDArray

from rigs import Rig, save_rig
from rigs.files import whole_folder
from tomo.grid import VoxelGrid
from tomo.io.volume_film import VolumeFilm
from tomo.io.volumes import check_length_unit
from tomo.scan.corrections import Corrections
from tomo.scan.write import SCAN_FILE, check_image, plain_corrections

if TYPE_CHECKING:
    from os import PathLike

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
    ``films/<camera>.tif``, ``truth.zarr``, ``scan.yaml``. One frame at a time is in memory.

    Parameters
    ----------
    folder : path-like
        What a film there held before is replaced.
    rig : Rig
    grid : VoxelGrid
        Where the truths lie.
    frames : int
        How many will come.
    frame_rate : float
        Frames a second.
    dtype : dtype
        Of the pixels: uint8, uint16 or float32.
    corrections : Corrections, optional
        Numbers only.
    effects : mapping, optional
        See `tomo.scan.Scan`.

    Yields
    ------
    put : callable
        ``put(images, truth)`` with camera to ``(h, w)``, and ``(nx, ny, nz)``.

    Raises
    ------
    ValueError
        If an image is not of its camera's size, or other than ``frames`` frames came.
    """
    import tifffile

    folder = Path(folder)
    check_length_unit(rig.length_unit)
    content: dict[str, Any] = {"format": "emission-scan", "version": 1, "rig": "rig.yaml"}
    content |= {"grid": grid.to_mapping(), "frame_rate": frame_rate, "truth": TRUTH}
    content["films"] = {name: f"films/{name}.tif" for name in rig.names}
    if corrections is not None:
        content["corrections"], _ = plain_corrections(folder, corrections)
    if effects is not None:
        content["effects"] = {name: value for name, value in effects.items() if value is not None}
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
