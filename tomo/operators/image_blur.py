"""Images blurred by one kernel a view: an operator from pixels to pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig
from tomo._compute.jit import compiled
from tomo._compute.threads import threads_worth
from tomo.operators.composition import ImageOperator
from tomo.operators.operator import as_float
from tomo.operators.spmv import FORWARD_NANOSECONDS

Kernel = tuple[NDArray[np.int64], NDArray[np.float32]]
"""``offsets`` (n, 2), columns and rows from a pixel, and the ``weight`` (n,) of each."""


@dataclass(frozen=True, eq=False)
class Places:
    """Where the entries of a flat vector of pixels lie in the images, ``(n,)`` each.

    Entries that are not ``seen`` neither give nor receive light.
    """

    view: NDArray[np.int64]
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    seen: NDArray[np.bool_]

    @classmethod
    def of(
        cls,
        rig: Rig | Sequence[CameraLike],
        pixels: Sequence[NDArray[np.integer]],
        seen: NDArray[np.bool_] | None = None,
    ) -> Places:
        """Return the places of some pixels ``row * width + column`` of each camera."""
        split = [np.divmod(kept, one.image_size[0]) for one, kept in zip(rig, pixels, strict=True)]
        row, column = (np.concatenate(parts) for parts in zip(*split, strict=True))
        view = np.repeat(np.arange(len(pixels)), [len(kept) for kept in pixels])
        return cls(view, row, column, np.ones(len(view), bool) if seen is None else seen)

    def take(self, numbers: NDArray[np.integer]) -> Places:
        """Return some of the entries."""
        return Places(*(part[numbers] for part in (self.view, self.row, self.column, self.seen)))

    def runs(self, canvas: _Canvases) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return pieces of image rows without a gap, and where those of each view begin.

        ``(runs, 3)``: the first entry, its place on the view's canvas, and the number of pixels;
        ``(views + 1,)``.
        """
        own = np.flatnonzero(self.seen)
        view, row, column = self.view[own], self.row[own], self.column[own]
        same = (np.diff(view) == 0) & (np.diff(row) == 0) & (np.diff(column) == 1)
        same &= np.diff(own) == 1
        first = np.flatnonzero(np.r_[True, ~same][: len(own)])
        count = np.diff(np.r_[first, len(own)])
        place = (row - canvas.top[view]) * canvas.width[view] + column - canvas.left[view]
        order = np.argsort(view[first], kind="stable")
        found = np.stack([own[first], place[first], count], axis=1)[order]
        begins = np.searchsorted(view[first][order], np.arange(len(canvas.width) + 1))
        return found, begins


class _Canvases(NamedTuple):
    """The rectangle that holds the pixels of each view and what their kernels reach: (views,)."""

    top: NDArray[np.int64]
    left: NDArray[np.int64]
    width: NDArray[np.int64]
    size: NDArray[np.int64]


class ImageBlur(ImageOperator):
    """The blur ``B`` of images: each pixel passes on its light by the weights of a kernel.

    ``blur @ images`` blurs images ``(pixels,)``; ``blur @ rays`` of a projection operator is the
    projection of blurred images. A kernel, one a view, are the ``rays`` that one of the ``pixels``
    gets its light from, in columns and rows from its own (n, 2), and the fraction (n,) of each;
    ``own`` (pixels,) is what it gets beside that from the ray at its place.

    Forward ``(B y)_p = sum_k w_k y_(p + k) + own_p y_p``, summed in double precision; the adjoint
    goes through the same weights. Rays that take no part are dark. Each view is laid out as an
    image, whose rows the kernel runs along. The same bits on any number of threads.

    Examples
    --------
    >>> out_of_focus = lens_blur(rig, pixels, grid, 0.5) @ rays    # doctest: +SKIP
    """

    def __init__(
        self,
        kernels: Sequence[Kernel],
        pixels: Places,
        rays: Places,
        own: NDArray[np.float32] | None = None,
    ) -> None:
        self.kernels, self.pixels, self.rays = tuple(kernels), pixels, rays
        self.own = np.zeros(len(pixels.view), np.float32) if own is None else own
        shape = len(pixels.view), len(rays.view)
        super().__init__(dtype=np.dtype(np.float32), shape=shape)

    @classmethod
    def from_kernels(
        cls,
        rig: Rig | Sequence[CameraLike],
        pixels: Sequence[NDArray[np.integer]],
        kernels: Sequence[Kernel],
        *,
        seen: NDArray[np.bool_] | None = None,
        keeps_light: bool = False,
    ) -> ImageBlur:
        """Return the blur of the pixels of a rig's images by one kernel a camera.

        ``pixels`` are each camera's flat numbers ``row * width + column`` that take part, the
        others count as dark; ``kernels`` the pixels that the light of a ray reaches, in columns
        and rows from its own, and the fraction that reaches each. Only ``seen`` (pixels,) take
        part after all. If it ``keeps_light``, what would come from dark pixels is taken to be that
        of the pixel itself.
        """
        places = Places.of(rig, pixels, seen)
        found = cls(kernels, places, places)
        if not keeps_light:
            return found
        missing = places.seen - found @ np.ones(len(places.view))
        return cls(kernels, places, places, missing.astype(np.float32))

    def __repr__(self) -> str:
        """Name the size."""
        return f"<ImageBlur: {self.shape[0]} pixels>"

    @cached_property
    def _canvases(self) -> _Canvases:
        reach = np.array([np.abs(offsets).max(initial=0) for offsets, _ in self.kernels], np.int64)
        low = np.full((2, len(reach)), np.iinfo(np.int64).max)
        high = np.full((2, len(reach)), -1, np.int64)
        for part in (self.pixels, self.rays):
            for axis, place in enumerate((part.row, part.column)):
                np.minimum.at(low[axis], part.view, place)
                np.maximum.at(high[axis], part.view, place)
        empty = high[0] < 0
        low, high = np.where(empty, 0, low - reach), np.where(empty, -1, high + reach)
        height, width = high - low + 1
        return _Canvases(low[0], low[1], width, height * width)

    @cached_property
    def _weights(self) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.int64]]:
        """Where each weight is on its view's canvas, the weights, and the first of each view."""
        width = self._canvases.width
        moves = [
            offsets[:, 1] * step + offsets[:, 0]
            for (offsets, _), step in zip(self.kernels, width, strict=True)
        ]
        first = np.cumsum([0, *(len(weight) for _, weight in self.kernels)])
        weights = [np.asarray(weight, np.float32) for _, weight in self.kernels]
        return np.concatenate(moves), np.concatenate(weights), first

    @cached_property
    def _pixel_runs(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return self.pixels.runs(self._canvases)

    @cached_property
    def _ray_runs(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return self._pixel_runs if self.rays is self.pixels else self.rays.runs(self._canvases)

    @cached_property
    def _work(self) -> float:
        """Nanoseconds of one product on one thread, about."""
        counts = np.bincount(self.pixels.view, minlength=len(self.kernels))
        return FORWARD_NANOSECONDS * float(counts @ np.diff(self._weights[2]))

    def _matvec(self, x: NDArray) -> NDArray:
        x, images = as_float(x.ravel()), np.zeros(self.shape[0], as_float(x).dtype)
        moves, weights, first = self._weights
        one = np.ones(self.shape[1], np.float32)
        with threads_worth(self._work):
            _blurred(
                x, one, *self._ray_runs, images, self.own, *self._pixel_runs,
                self._canvases.size, moves, weights, first,
            )  # fmt: skip
        return images

    def _rmatvec(self, y: NDArray) -> NDArray:
        y, gathered = as_float(y.ravel()), np.zeros(self.shape[1], as_float(y).dtype)
        moves, weights, first = self._weights
        one = np.ones(self.shape[1], np.float32)
        with threads_worth(self._work):
            _blurred(
                y, self.own, *self._pixel_runs, gathered, one, *self._ray_runs,
                self._canvases.size, -moves, weights, first,
            )  # fmt: skip
        return gathered

    def _matmat(self, x: NDArray) -> NDArray:
        columns = [self._matvec(np.ascontiguousarray(column)) for column in x.T]
        return np.stack(columns, axis=1)

    def _rmatmat(self, y: NDArray) -> NDArray:
        columns = [self._rmatvec(np.ascontiguousarray(column)) for column in y.T]
        return np.stack(columns, axis=1)

    def take(self, pixels: NDArray[np.integer]) -> tuple[ImageBlur, NDArray[np.int64]]:
        """Return the blur of some pixels, from the rays that reach them, and those rays."""
        even = [(offsets, np.ones_like(weight)) for offsets, weight in self.kernels]
        some, own = self.pixels.take(pixels), self.own[pixels]
        order, first = self._rays_of_views
        own_rays = [order[first[view] : first[view + 1]] for view in np.unique(some.view)]
        near = np.sort(np.concatenate([np.zeros(0, np.int64), *own_rays]))
        everything = ImageBlur(even, some, self.rays.take(near), np.ones_like(own))
        needed = near[np.flatnonzero(everything.T @ np.ones(len(pixels), np.float32))]
        return ImageBlur(self.kernels, some, self.rays.take(needed), own), needed

    @cached_property
    def _rays_of_views(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The rays in the order of their views, and where those of each view begin."""
        order = np.argsort(self.rays.view, kind="stable")
        return order, np.searchsorted(self.rays.view[order], np.arange(len(self.kernels) + 1))

    @property
    def arrays(self) -> tuple[NDArray, ...]:
        """The places of pixels and rays, and the weights."""
        parts = (self.pixels, self.rays)
        places = [array for part in parts for array in (part.view, part.row, part.column)]
        return *places, self.own, *self._weights


@compiled(parallel=True)
def _blurred(
    values, own, runs, run_ptr, out, own_out, out_runs, out_ptr, sizes, moves, weights, kernel_ptr
):
    """Write to ``out`` the weighted ``values`` around each of its places, and those at it.

    ``out_p = sum_k weights_k values_(p + moves_k) + own_out_p own_p values_p``.
    """
    for view in numba.prange(len(sizes)):
        canvas = np.zeros(sizes[view], values.dtype)
        alone = np.zeros(sizes[view], values.dtype)
        longest = np.int64(0)
        for run in range(run_ptr[view], run_ptr[view + 1]):
            first, place = np.uint64(runs[run, 0]), np.uint64(runs[run, 1])
            for i in range(np.uint64(runs[run, 2])):
                canvas[place + i] = values[first + i]
                alone[place + i] = own[first + i] * values[first + i]
        for run in range(out_ptr[view], out_ptr[view + 1]):
            longest = max(longest, out_runs[run, 2])
        sums = np.zeros(longest)
        for run in range(out_ptr[view], out_ptr[view + 1]):
            first, place = np.uint64(out_runs[run, 0]), np.uint64(out_runs[run, 1])
            count = np.uint64(out_runs[run, 2])
            for i in range(count):
                sums[i] = np.float64(own_out[first + i]) * alone[place + i]
            for k in range(kernel_ptr[view], kernel_ptr[view + 1]):
                weight = np.float64(weights[k])
                near = np.uint64(out_runs[run, 1] + moves[k])
                for i in range(count):
                    sums[i] += weight * canvas[near + i]
            for i in range(count):
                out[first + i] = sums[i]
