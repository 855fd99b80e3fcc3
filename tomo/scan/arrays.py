"""A scan of arrays: their shapes against their cameras and the grid; images as one array."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.io.xarray_volumes import xarray_or_pip_line
from tomo.scan.corrections import Corrections
from tomo.scan.films import Frame
from tomo.scan.images import Images, Masks
from tomo.scan.write import check_cameras

if TYPE_CHECKING:
    from xarray import DataArray, Dataset


def frames_of(
    rig: Rig, images: Mapping[str, ArrayLike] | DataArray | Dataset
) -> tuple[Frame, ...]:
    """Return the frames ``frame_000``, ``frame_001`` ... of images, see `Scan.from_arrays`."""
    stacks = _stacks_of(rig, images, "images")
    return tuple(
        Frame(f"frame_{number:03d}", {name: stack[number] for name, stack in stacks.items()})
        for number in range(len(next(iter(stacks.values()), ())))
    )


def corrections_with(
    masks: Mapping[str, ArrayLike] | None, corrections: Corrections, rig: Rig
) -> Corrections:
    """Return the corrections of images in memory, with masks of their own."""
    for name in rig.names:
        if corrections.of("channel", name) and not corrections.of("bayer", name):
            raise ValueError(f"camera {name}: channel: found grey arrays, expected bayer too")
    if masks is None:
        return corrections
    if corrections.mask is not None:
        raise ValueError("masks: found masks in corrections too, expected one of the two")
    usable = _stacks_of(rig, masks, "masks")
    for name, mask in usable.items():
        if len(mask) > 1:
            raise ValueError(f"masks: camera {name}: found {len(mask)}, expected one for all")
    return replace(corrections, mask={name: mask[0] for name, mask in usable.items()})


def truth_on(grid: VoxelGrid | None, truth: ArrayLike) -> NDArray[np.float32]:
    """Return a true volume, if it lies on the grid."""
    truth = np.asarray(truth, np.float32)
    if grid is None or truth.shape != grid.shape:
        expected = "a grid that it lies on" if grid is None else f"the grid's {grid.shape}"
        raise ValueError(f"truth: found shape {truth.shape}, expected {expected}")
    return truth


def as_data_array(where: str, rig: Rig, frame: str, images: Images, masks: Masks) -> DataArray:
    """Return images of equal size as ``(camera, row, column)``; NaN is not usable."""
    sizes = {camera.image_size for camera in rig}
    if len(sizes) > 1:
        found = ", ".join(f"{width} x {height}" for width, height in sorted(sizes))
        raise ValueError(
            f"{where}images: found sizes {found}, expected one for an array of all: take some "
            "cameras by only(...)"
        )
    values = np.where(np.array(masks), np.array(images), np.float32(np.nan))
    coordinates = {"camera": list(rig.names)}
    dims = ("camera", "row", "column")
    return xarray_or_pip_line().DataArray(values, coordinates, dims, "image", {"frame": frame})


def _stacks_of(
    rig: Rig, images: Mapping[str, ArrayLike] | DataArray | Dataset, field: str
) -> dict[str, NDArray]:
    """Return each camera's images as ``(frames, h, w)``; ``field`` names them in errors."""
    each = images if isinstance(images, Mapping) else _of_each_camera(images, field)
    own = {str(name): image for name, image in each.items()}
    check_cameras(field, "", own, rig)
    stacks = {name: _stack(field, name, rig, image) for name, image in own.items()}
    counts = {name: len(stack) for name, stack in stacks.items()}
    if len(set(counts.values())) > 1:
        found = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise ValueError(f"{field}: frames: found {found}, expected as many of every camera")
    return stacks


def _of_each_camera(array: DataArray, field: str) -> dict[str, NDArray]:
    """Return the images of each camera of a DataArray along ``camera``."""
    if "camera" not in getattr(array, "dims", ()) or "camera" not in array.coords:
        found = ", ".join(map(str, getattr(array, "dims", ()))) or "none"
        raise ValueError(
            f"{field}: found the dimensions {found}, expected camera, with the cameras' names as "
            "its coordinate, and row and column"
        )
    order = [name for name in ("frame", "row", "column") if name in array.dims]
    if set(array.dims) == {"camera", *order}:
        array = array.transpose("camera", *order)
    names = [str(name) for name in array.coords["camera"].values]
    return dict(zip(names, np.moveaxis(array.values, array.dims.index("camera"), 0), strict=True))


def _stack(field: str, camera: str, rig: Rig, images: ArrayLike) -> NDArray:
    """Return one or several images of a camera as ``(frames, h, w)``."""
    width, height = rig[camera].image_size
    stack = np.asarray(images)
    stack = stack[None] if stack.ndim == 2 else stack
    if stack.ndim != 3 or stack.shape[1:] != (height, width) or not len(stack):
        raise ValueError(
            f"{field}: camera {camera}: found shape {np.shape(images)}, expected "
            f"{(height, width)} or frames of it"
        )
    return stack
