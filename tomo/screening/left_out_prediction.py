"""Views predicted from subsets of the other views, on coarse pixels and voxels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem
from tomo.scan.downsample import Coarser, coarsening
from tomo.solvers.initial_volume import log_back_projections
from tomo.solvers.quick_volume import quick_volume

SEGMENTS = 250_000
"""Segments of the coarse system, about: more take longer and find the same."""

COARSEST = 16
"""Least pixels along an image's shorter side, and voxels along the grid's longest."""

ITERATIONS = 4
BLUR = 1.0
"""Standard deviation, in coarse pixels, of the blur before images are compared: it removes the
edges of single voxels."""

DETAIL = 0.5
"""Standard deviation of the logarithm of the random factor on a bootstrap's volume."""

FEW_VIEWS, MANY_VIEWS = 6, 20
SUBSETS = 5
"""Interleaved subsets of many views: an odd number, since cameras may alternate."""


@dataclass(frozen=True, eq=False)
class Predictions:
    """Each view's image, and its predictions from several subsets of the other views.

    An inconsistent view only affects the predictions of its own subset.

    Attributes
    ----------
    images, masks : tuple of (rows, columns)
        On coarse pixels, blurred; the masks are True where a usable pixel sees the grid.
    subsets : tuple of tuple of int
        The views that each volume was made from.
    predicted : tuple of tuple of (rows, columns) float32
        For each subset the projection of its volume into every view.
    factor : int
        Pixels along the side of a coarse pixel.
    """

    images: tuple[NDArray[np.float32], ...]
    masks: tuple[NDArray[np.bool_], ...]
    subsets: tuple[tuple[int, ...], ...]
    predicted: tuple[tuple[NDArray[np.float32], ...], ...]
    factor: int
    system: LinearSystem
    measured: NDArray[np.float32]

    @classmethod
    def of(
        cls,
        rig: Rig,
        images: Sequence[NDArray[np.float32]],
        masks: Sequence[NDArray[np.bool_]],
        grid: VoxelGrid,
        trusted: int,
    ) -> Self:
        """Predict all views from subsets of the first ``trusted`` ones.

        Parameters
        ----------
        rig, images, masks, grid
            See `tomo.selfcal.shifts.align_views`.
        trusted : int
            The views after these are only predicted.

        Raises
        ------
        tomo.operators.system.VolumeNotSeenError
            If no usable pixel sees the grid.
        """
        factor = coarsening(rig, grid, SEGMENTS, COARSEST)
        coarse = Coarser.of(rig, images, masks, grid, factor)
        system = LinearSystem.from_rig(coarse.rig, coarse.grid, masks=coarse.masks)
        measured = system.flatten(coarse.images)
        seeing = system.images(np.ones(len(measured), np.float32))
        subsets = subsets_of(trusted)
        return cls(
            tuple(gaussian_filter(image, BLUR) for image in coarse.images),
            tuple(image > 0 for image in seeing),
            tuple(subsets),
            _predicted(system, measured, subsets),
            factor,
            system,
            measured,
        )

    def bootstrapped(self, views: Sequence[int]) -> Self:
        """Return the predictions of simulated, consistent images: a parametric bootstrap.

        The volume is made from ``views`` and multiplied by isotropic random detail, since its own
        detail is only what those views resolve. A view that is hard to predict, at the end of an
        arc or without an opposite camera, is hard to predict here too.
        """
        volume = quick_volume(self.system.projector, self.measured, views, iterations=ITERATIONS)
        active = self.system.projector.active
        random = np.random.default_rng(0).standard_normal(active.grid.shape)
        detail = gaussian_filter(random, BLUR)
        detail /= detail.std() or 1.0  # a single voxel has none
        volume = volume * np.exp(DETAIL * active.compress(detail))
        shown = np.asarray(self.system.projector @ volume, np.float32)
        return replace(
            self,
            images=tuple(gaussian_filter(image, BLUR) for image in self.system.images(shown)),
            predicted=_predicted(self.system, shown, self.subsets),
            measured=shown,
        )

    def of_view(self, view: int) -> list[NDArray[np.float32]]:
        """Return the predictions of a view from the subsets without it."""
        return [
            images[view]
            for subset, images in zip(self.subsets, self.predicted, strict=True)
            if view not in subset
        ]


def _predicted(
    system: LinearSystem, measured: NDArray[np.float32], subsets: Sequence[Sequence[int]]
) -> tuple[tuple[NDArray[np.float32], ...], ...]:
    """Return the projection of each subset's volume into every view."""
    back_projections = log_back_projections(system.projector, measured)
    predicted = []
    for subset in subsets:
        volume = quick_volume(
            system.projector,
            measured,
            subset,
            iterations=ITERATIONS,
            back_projections=back_projections,
        )
        seen = system.images(system.projector @ volume)
        predicted.append(tuple(gaussian_filter(image, BLUR) for image in seen))
    return tuple(predicted)


def subsets_of(views: int) -> list[tuple[int, ...]]:
    """Return subsets such that several predictions of each view are free of an inconsistent one.

    Few views: all triples. Many: five interleaved subsets. Between: one subset a view, spread
    evenly from it.
    """
    if views <= FEW_VIEWS:
        return list(combinations(range(views), 3))
    if views >= MANY_VIEWS:
        return [tuple(range(first, views, SUBSETS)) for first in range(SUBSETS)]
    size = math.ceil(views / 4) + 1
    return [
        tuple(sorted({(first + step * views // size) % views for step in range(size)}))
        for first in range(views)
    ]
