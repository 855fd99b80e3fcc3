"""Images in memory: their shapes against their cameras, and their shrinking by area means."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs import Rig
from tomo.scan.write import check_cameras

if TYPE_CHECKING:
    from xarray import DataArray, Dataset


def stacks_of(
    rig: Rig, images: Mapping[str, ArrayLike] | DataArray | Dataset, field: str
) -> dict[str, NDArray]:
    """Return each camera's image or images as ``(frames, h, w)``; ``field`` names them in errors.

    Raises
    ------
    ValueError
        If a camera is unknown, an image is not of its camera's size, or cameras have different
        numbers of frames.
    """
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


def _blocks(image: NDArray, factor: int) -> NDArray:
    """Return a view ``(rows, factor, columns, factor)`` of the whole blocks of an image."""
    rows, columns = (side // factor for side in image.shape)
    whole = image[: rows * factor, : columns * factor]
    return whole.reshape(rows, factor, columns, factor)


def area_means(image: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Return the means of an image over blocks of ``factor`` x ``factor`` pixels."""
    if factor == 1:
        return image
    return _blocks(image, factor).mean(axis=(1, 3), dtype=np.float64).astype(np.float32)


def all_of_area(usable: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """Return the blocks of ``factor`` x ``factor`` pixels that are usable throughout."""
    return usable if factor == 1 else np.asarray(_blocks(usable, factor).all(axis=(1, 3)))
