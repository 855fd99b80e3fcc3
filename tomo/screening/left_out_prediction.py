"""What some of the views say of the others, on few and large pixels and voxels."""

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
from tomo.solvers.initial_volume import log_smears
from tomo.solvers.quick_volume import quick_volume

CROSSINGS = 250_000
"""About the size of the coarser system."""

COARSEST = 16
"""Pixels along an image's shorter side, and voxels along the grid's longest, left at least."""

ITERATIONS = 4
BLUR = 1.0
"""Standard deviation, in large pixels, of the blur before images are compared: the edges of
single voxels are no part of what is predicted."""

DETAIL = 0.5
"""Standard deviation of the logarithm of what a rehearsal's volume is multiplied by."""

FEW_VIEWS, MANY_VIEWS = 6, 20
PARTIES = 5
"""Of many views: so many interleaved parties, an odd number since cameras may alternate."""


@dataclass(frozen=True, eq=False)
class Predictions:
    """Each view's image, and what several parties of other views predict of it.

    A wrong view spoils what its own party says, and nothing else.

    Attributes
    ----------
    images, masks : tuple of (rows, columns)
        Of large pixels, blurred; the masks are True where a usable pixel sees the grid.
    parties : tuple of tuple of int
        The views that each volume was made from.
    predicted : tuple of tuple of (rows, columns) float32
        For each party what its volume shows in every view.
    factor : int
        How many pixels a large pixel is wide.
    """

    images: tuple[NDArray[np.float32], ...]
    masks: tuple[NDArray[np.bool_], ...]
    parties: tuple[tuple[int, ...], ...]
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
        """Predict all views from parties of the first ``trusted`` ones.

        Parameters
        ----------
        rig, images, masks, grid
            See `tomo.selfcal.shifts.align_views`.
        trusted : int
            The views after these are predicted only.

        Raises
        ------
        tomo.operators.system.VolumeNotSeenError
            If no usable pixel sees the grid.
        """
        factor = coarsening(rig, grid, CROSSINGS, COARSEST)
        coarse = Coarser.of(rig, images, masks, grid, factor)
        system = LinearSystem.from_rig(coarse.rig, coarse.grid, masks=coarse.masks)
        measured = system.flatten(coarse.images)
        seeing = system.images(np.ones(len(measured), np.float32))
        parties = parties_of(trusted)
        return cls(
            tuple(gaussian_filter(image, BLUR) for image in coarse.images),
            tuple(image > 0 for image in seeing),
            tuple(parties),
            _predicted(system, measured, parties),
            factor,
            system,
            measured,
        )

    def rehearsed(self, views: Sequence[int]) -> Self:
        """Return the same for images that are certainly right: those of a volume.

        The volume is made from ``views``, with detail of all directions alike added: its own is
        what those views could see. Which view is harder to predict than others, at the end of an
        arc or where none looks from the opposite side, shows here too.
        """
        volume = quick_volume(self.system.projector, self.measured, views, iterations=ITERATIONS)
        active = self.system.projector.active
        random = np.random.default_rng(0).standard_normal(active.grid.shape)
        detail = gaussian_filter(random, BLUR)
        detail /= detail.std() or 1.0  # of a single voxel
        volume = volume * np.exp(DETAIL * active.compress(detail))
        shown = np.asarray(self.system.projector @ volume, np.float32)
        return replace(
            self,
            images=tuple(gaussian_filter(image, BLUR) for image in self.system.images(shown)),
            predicted=_predicted(self.system, shown, self.parties),
            measured=shown,
        )

    def of_view(self, view: int) -> list[NDArray[np.float32]]:
        """Return what the parties without a view predict of it."""
        return [
            images[view]
            for party, images in zip(self.parties, self.predicted, strict=True)
            if view not in party
        ]


def _predicted(
    system: LinearSystem, measured: NDArray[np.float32], parties: Sequence[Sequence[int]]
) -> tuple[tuple[NDArray[np.float32], ...], ...]:
    """Return what each party's volume shows in every view."""
    smears = log_smears(system.projector, measured)
    predicted = []
    for party in parties:
        volume = quick_volume(
            system.projector, measured, party, iterations=ITERATIONS, smears=smears
        )
        seen = system.images(system.projector @ volume)
        predicted.append(tuple(gaussian_filter(image, BLUR) for image in seen))
    return tuple(predicted)


def parties_of(views: int) -> list[tuple[int, ...]]:
    """Return parties of views such that each view is predicted by several without a wrong one.

    Few views: all threes. Many: five interleaved parties. Between: one party a view, spread
    evenly round it.
    """
    if views <= FEW_VIEWS:
        return list(combinations(range(views), 3))
    if views >= MANY_VIEWS:
        return [tuple(range(first, views, PARTIES)) for first in range(PARTIES)]
    size = math.ceil(views / 4) + 1
    return [
        tuple(sorted({(first + step * views // size) % views for step in range(size)}))
        for first in range(views)
    ]
