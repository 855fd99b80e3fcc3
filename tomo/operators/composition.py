"""Operators made of operators: images mapped after a projection, unknowns mapped before it.

Two compositions cover every effect on the way from unknowns to pixels::

    blur @ rays           B A    an image operator behind a projection: `ComposedProjector`
    BasisProjector(rays)  A M    a projection of coefficients of other basis functions

Both are projection operators: they know their views, give their adjoint, and take some of their
pixels, so that they compose further.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import LinearOperator

from tomo.grid import ActiveVoxels
from tomo.operators.operator import ArrayProducts, ProjectionOperator
from tomo.trace import Segments

Change = Callable[[ProjectionOperator], ProjectionOperator]


class ImageOperator(LinearOperator):
    """A linear operator ``B`` from pixels to pixels; ``B @ A`` of a projection ``A`` is one too.

    Subclasses compute ``_matvec`` and ``_rmatvec`` and take some of the rows.
    """

    @abstractmethod
    def take(self, pixels: NDArray[np.integer]) -> tuple[Self, NDArray[np.int64]]:
        """Return the operator to some pixels from those that they need, and the latter."""

    @property
    @abstractmethod
    def arrays(self) -> tuple[NDArray, ...]:
        """The arrays that define the entries: operators are equal where these are."""

    def __matmul__(self, other):
        """Return ``B A`` of a projection ``A``, ``B y`` of images ``y``."""
        if isinstance(other, ProjectionOperator):
            return ComposedProjector(self, other)
        return super().__matmul__(other)

    def _transpose(self) -> LinearOperator:
        return self._adjoint()  # scipy's own copies both vectors to conjugate them


class _OfRays(ProjectionOperator):
    """A composition, which hands on what its inner projection says of the rays."""

    @property
    @abstractmethod
    def _inner(self) -> ProjectionOperator:
        """The projection that it is made on."""

    @property
    def is_stored(self) -> bool:
        """Whether the entries of the rays are stored."""
        return self._inner.is_stored

    @property
    def n_segments(self) -> int:
        """Number of segments of rays in voxels."""
        return self._inner.n_segments

    @property
    def segments(self) -> Segments:
        """The segments of the rays, before any blur."""
        return self._inner.segments

    @property
    def arrays(self) -> tuple[NDArray, ...]:
        """The arrays that define the entries."""
        return self._inner.arrays

    def with_lengths(self, length: NDArray[np.floating]) -> Self:
        """Return the operator with ``length`` (segments,), of either sign, instead of its own."""
        return self.with_rays(lambda rays: rays.with_lengths(length))


class ComposedProjector(_OfRays):
    """The projection ``B A`` of rays ``A`` whose images an operator ``B`` maps.

    ``images`` is ``B``, ``(pixels, rays)``, such as an `ImageBlur`, ``rays`` is ``A``. Where it is
    stored, `segments` and `with_lengths` are there. ``view_ptr`` is that of the rays when None.
    Forward ``B (A x)``, adjoint ``A^T (B^T y)``: each of the two by its own operator. ValueError:
    ``B`` takes another number of pixels than ``A`` has rows.
    """

    rows_are_single_rays = False

    def __init__(
        self, images: ImageOperator, rays: ProjectionOperator, view_ptr: ArrayLike | None = None
    ) -> None:
        if images.shape[1] != rays.shape[0]:
            raise ValueError(
                f"image operator: found one of {images.shape[1]} pixels, expected the "
                f"{rays.shape[0]} of the rays"
            )
        self.images, self.rays = images, rays
        view_ptr = rays.view_ptr if view_ptr is None else view_ptr
        super().__init__(images.shape[0], rays.grid, view_ptr, rays.dtype, rays.active)

    def __repr__(self) -> str:
        """Name both operators."""
        return f"<{self.images!r} @ {self.rays!r}>"

    def _matvec(self, x: NDArray) -> NDArray:
        return self.images @ (self.rays @ x.ravel())

    def _rmatvec(self, y: NDArray) -> NDArray:
        return self.rays.T @ (self.images.T @ y.ravel())

    def _matmat(self, x: NDArray) -> NDArray:
        return self.images @ (self.rays @ x)

    def _rmatmat(self, y: NDArray) -> NDArray:
        return self.rays.T @ (self.images.T @ y)

    @property
    def _inner(self) -> ProjectionOperator:
        return self.rays

    @property
    def basis(self) -> str:
        """The basis of the rays' unknowns."""
        return self.rays.basis

    @property
    def without_blur(self) -> ProjectionOperator:
        """``A``."""
        return self.rays.without_blur

    @property
    def arrays(self) -> tuple[NDArray, ...]:
        """The arrays that define the entries."""
        return *self.rays.arrays, *self.images.arrays

    def with_rays(self, change: Change) -> Self:
        """Return the same composition on other rays; see `ProjectionOperator.with_rays`."""
        return type(self)(self.images, self.rays.with_rays(change), self.view_ptr)

    def rows(self, start: int, stop: int) -> Self:
        """Return the operator of pixels ``start:stop`` as one view, with the rays they need."""
        return self._taken(np.arange(start, stop), np.array([0, stop - start]))

    def _taken(self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]) -> Self:
        images, needed = self.images.take(pixels)
        return type(self)(images, self.rays.take(needed), view_ptr)


class BasisProjector(_OfRays, ArrayProducts):
    """The projection ``A M`` whose unknowns are coefficients of other basis functions.

    Subclasses say what ``M`` does, `to_voxels` and its adjoint, and how they are made of another
    projection ``A`` of the same unknowns. ``active`` are those of ``A M``, or of ``A`` when None.
    """

    def __init__(self, projector: ProjectionOperator, active: ActiveVoxels | None = None) -> None:
        self.projector = projector
        active = projector.active if active is None else active
        pixels, _ = projector.shape
        super().__init__(pixels, projector.grid, projector.view_ptr, projector.dtype, active)

    @abstractmethod
    def _on(self, projector: ProjectionOperator) -> Self:
        """Return the same basis on another projection."""

    def to_voxels(self, coefficients: NDArray) -> NDArray:
        """Return ``M z``, the unknowns of ``A``; ``(unknowns,)`` or ``(unknowns, columns)``."""
        return coefficients

    def to_voxels_adjoint(self, unknowns: NDArray) -> NDArray:
        """Return ``M^T x``; ``(unknowns,)`` or ``(unknowns, columns)``."""
        return unknowns

    def array(self, values: Any) -> Any:
        """Return values where the products of ``A`` are computed."""
        return self.projector.array(values)

    def takes(self, values: Any) -> bool:
        """Return whether products of another library's array are arrays of that library."""
        return self.projector.takes(values)

    def computing(self) -> AbstractContextManager[None]:
        """Return the context in which arrays are computed with that `array` returned."""
        return self.projector.computing()

    def product_there(self, x: Any) -> Any:
        """Return ``A M x`` of an array that ``A`` takes."""
        return self.projector @ self.to_voxels(x)

    def transposed_product_there(self, y: Any) -> Any:
        """Return ``M^T A^T y`` of an array that ``A`` takes."""
        return self.to_voxels_adjoint(self.projector.T @ y)

    def _matvec(self, x: NDArray) -> NDArray:
        return self.projector @ self.to_voxels(x.ravel())

    def _rmatvec(self, y: NDArray) -> NDArray:
        return self.to_voxels_adjoint(self.projector.T @ y.ravel())

    _matmat, _rmatmat = product_there, transposed_product_there

    @property
    def _inner(self) -> ProjectionOperator:
        return self.projector

    @cached_property
    def rows_are_single_rays(self) -> bool:
        """Whether a row holds the rays of its own pixel alone."""
        return self.projector.rows_are_single_rays

    @property
    def without_blur(self) -> ProjectionOperator:
        """The same basis on the projection before an image blur."""
        return self._on(self.projector.without_blur)

    def with_rays(self, change: Change) -> Self:
        """Return the same basis on other rays; see `ProjectionOperator.with_rays`."""
        return self._on(self.projector.with_rays(change))

    def rows(self, start: int, stop: int) -> Self:
        """Return the operator of pixels ``start:stop`` as one view."""
        return self._on(self.projector.rows(start, stop))

    def _taken(self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]) -> Self:
        return self._on(self.projector._taken(pixels, view_ptr))
