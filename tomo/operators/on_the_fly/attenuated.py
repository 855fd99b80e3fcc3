"""The projection through absorbing gas, never stored."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo.operators.absorption import Absorption, attenuating
from tomo.operators.on_the_fly.projector import OnTheFlyProjector
from tomo.operators.operator import ProjectionOperator, as_float
from tomo.operators.stored import Projector
from tomo.rays import Rays


class AttenuatedProjector(ProjectionOperator):
    """The matrix of segments that count by the light that arrives, computed at every product.

    ``emission`` (unknowns,) is needed where ``absorption.emission`` is not 0. What is in front of
    a segment is summed up while a ray is walked: running sums along an axis, which
    `OnTheFlyProjector` is fast by, cannot serve. Rays are therefore traced at every product, some
    at a time, and both products go through the entries of that chunk: the adjoint is exact. It
    takes some five times as long, and the memory of one chunk's segments.
    """

    def __init__(
        self,
        rays: OnTheFlyProjector,
        absorption: Absorption,
        emission: NDArray[np.floating] | None = None,
    ) -> None:
        self.rays, self.absorption, self.emission = rays, absorption, emission
        super().__init__(rays.shape[0], rays.grid, rays.view_ptr, rays.dtype, rays.active)
        self._trace = attenuating(self.grid, absorption, emission, active=self.active)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<AttenuatedProjector: {self.n_views} views, {self.shape[0]} pixels, {self.grid}>"

    @property
    def n_segments(self) -> int:
        """Number of segments of rays in voxels."""
        return self.rays.n_segments

    @property
    def without_absorption(self) -> OnTheFlyProjector:
        """The operator of the same rays through transparent gas."""
        return self.rays

    def rows(self, start: int, stop: int) -> AttenuatedProjector:
        """Return the projector of pixels ``start:stop`` as one view."""
        return self._on(self.rays.rows(start, stop))

    def _taken(
        self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]
    ) -> AttenuatedProjector:
        return self._on(self.rays._taken(pixels, view_ptr))

    def _on(self, rays: OnTheFlyProjector) -> AttenuatedProjector:
        return AttenuatedProjector(rays, self.absorption, self.emission)

    def _chunk(self, rays: Rays) -> Projector:
        return Projector(self._trace(rays), self.grid, active=self.active)

    def _matvec(self, x: NDArray) -> NDArray:
        x = as_float(x.ravel())
        images = np.zeros(self.shape[0], x.dtype)
        for start, stop, rays in self.rays.some_rays():
            images[start:stop] = self._chunk(rays) @ x
        return images

    def _rmatvec(self, y: NDArray) -> NDArray:
        y = as_float(y.ravel())
        volume = np.zeros(self.shape[1])
        for start, stop, rays in self.rays.some_rays():
            volume += self._chunk(rays).T @ y[start:stop]
        return volume.astype(y.dtype)
