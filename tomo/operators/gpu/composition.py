"""Blurred images and the linear basis on a device: the compositions of the CPU, computed there."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.operators.basis import LinearBasis
from tomo.operators.composition import ComposedProjector
from tomo.operators.gpu.device import Device
from tomo.operators.gpu.device_operator import DeviceOperator
from tomo.operators.image_blur import ImageBlur, Places

Runs = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Pieces of image rows and where those of each view begin, as `Places.runs` returns them."""


class DeviceBlur:
    """The blur of images of `ImageBlur`, and its transpose, on a device."""

    def __init__(self, blur: ImageBlur, device: Device) -> None:
        self.device = device
        moves, weights, first = blur._weights
        one = np.ones(len(blur.rays.view), np.float32)
        self._pixels = self._side(blur.pixels, blur._pixel_runs, blur.own, blur)
        self._rays = self._side(blur.rays, blur._ray_runs, one, blur)
        self._kernel = device.array(first.astype(np.int64))
        self._weight = device.array(weights.astype(np.float64))
        self._moves = device.array(moves), device.array(-moves)

    def _side(self, places: Places, runs: Runs, own: NDArray, blur: ImageBlur) -> tuple[Any, ...]:
        """Return the images on one side of the blur, as the kernel takes them.

        The number of entries; the cell of each on all canvases, negative where it takes no part,
        and its view; the entry in each cell, negative where none is; what an entry gives to its
        own place.
        """
        bases = np.cumsum([0, *blur._canvases.size])
        cell = np.full(len(places.view), -1, np.int64)
        entry = np.full(int(bases[-1]), -1, np.int32)
        found, ptr = runs
        views = np.repeat(np.arange(len(ptr) - 1), np.diff(ptr))
        for view, (first, place, count) in zip(views.tolist(), found.tolist(), strict=True):
            here = slice(bases[view] + place, bases[view] + place + count)
            cell[first : first + count] = np.arange(here.start, here.stop)
            entry[here] = np.arange(first, first + count)
        array = self.device.array
        return (
            len(cell), array(cell), array(places.view.astype(np.int64)), array(entry),
            array(own.astype(np.float64)),
        )  # fmt: skip

    def forward(self, values: Any) -> Any:
        """Return the images ``(pixels, columns)`` after the blur of those before it."""
        return self._blurred(values, self._pixels, self._rays, self._moves[0])

    def adjoint(self, values: Any) -> Any:
        """Return the transposed blur ``(rays, columns)`` of images ``(pixels, columns)``."""
        return self._blurred(values, self._rays, self._pixels, self._moves[1])

    def _blurred(self, values: Any, to: tuple[Any, ...], of: tuple[Any, ...], moves: Any) -> Any:
        (count, cell, view, _, own), (*_, entry, own_of_source) = to, of
        images = self.device.zeros((count, values.shape[1]), values.dtype)
        self.device.launch(
            "blurred", values.dtype, images.size, np.int64(count), np.int64(values.shape[1]),
            cell, view, own, own_of_source, entry, self._kernel, moves, self._weight, values,
            images,
        )  # fmt: skip
        return images


class DeviceComposed(DeviceOperator, ComposedProjector):
    """The projection ``B A`` on a device: rays there, whose images are blurred there.

    Parameters
    ----------
    images : ImageBlur
        ``B``.
    rays : DeviceOperator
        ``A``.
    view_ptr : (views + 1,) int, optional
        The first pixel of each view; that of the rays when None.
    """

    def __init__(
        self, images: ImageBlur, rays: DeviceOperator, view_ptr: ArrayLike | None = None
    ) -> None:
        ComposedProjector.__init__(self, images, rays, view_ptr)
        self.device = rays.device

    @property
    def on_cpu(self) -> ComposedProjector:
        """The same composition on the CPU."""
        return ComposedProjector(self.images, self.rays.on_cpu, self.view_ptr)

    @cached_property
    def _blur(self) -> DeviceBlur:
        return DeviceBlur(self.images, self.device)

    def forward(self, x: Any) -> Any:
        """Return the images ``(pixels, columns)`` of unknowns ``(unknowns, columns)``."""
        return self._blur.forward(self.rays.forward(x))

    def adjoint(self, y: Any) -> Any:
        """Return the unknowns ``(unknowns, columns)`` of images ``(pixels, columns)``."""
        return self.rays.adjoint(self._blur.adjoint(y))


class DeviceLinear(DeviceOperator, LinearBasis):
    """The linear basis on a device, see `LinearBasis`.

    Parameters
    ----------
    projector : DeviceOperator
        The voxel basis, seen through the blur of a voxel's footprint.
    """

    def __init__(self, projector: DeviceOperator) -> None:
        LinearBasis.__init__(self, projector)
        self.device = projector.device

    @property
    def on_cpu(self) -> LinearBasis:
        """The same basis on the CPU."""
        return LinearBasis(self.projector.on_cpu)

    def _on(self, projector: Any) -> DeviceLinear:
        return DeviceLinear(projector)

    def forward(self, x: Any) -> Any:
        """Return the images ``(pixels, columns)`` of unknowns ``(unknowns, columns)``."""
        return self.projector.forward(x)

    def adjoint(self, y: Any) -> Any:
        """Return the unknowns ``(unknowns, columns)`` of images ``(pixels, columns)``."""
        return self.projector.adjoint(y)
