"""A quick volume of smooth blobs: what the cameras are refined against and judged by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo import solvers
from tomo.operators import GaussianBasis
from tomo.operators.operator import ProjectionOperator
from tomo.selection.choose import FEW_VIEWS
from tomo.solvers.initial_volume import mlos_start

WIDTH = 0.8
"""Of the blobs, in voxels: the gradient of the volume has to be one of the flame."""

ITERATIONS = {"mlem": 12, "nnls": 20}


@dataclass(frozen=True, eq=False)
class FirstVolume:
    """A volume and its basis.

    Attributes
    ----------
    basis : GaussianBasis
    coefficients : (unknowns,) float32
        Never negative.
    """

    basis: GaussianBasis
    coefficients: NDArray[np.float32]

    @property
    def values(self) -> NDArray[np.float32]:
        """The active voxels, ``(unknowns,)``."""
        return self.basis.to_voxels(self.coefficients)


def first_volume(projector: ProjectionOperator, measured: NDArray[np.float32]) -> FirstVolume:
    """Return a few iterations on a smooth basis.

    Of MLEM where views are few, which fills what they leave open with what all of them allow;
    else of non-negative least squares.
    """
    basis = GaussianBasis(projector, WIDTH)
    views = int(np.count_nonzero(np.diff(projector.view_ptr)))
    name = "mlem" if views <= FEW_VIEWS else "nnls"
    start = mlos_start(projector, measured) if name == "mlem" else None
    found = getattr(solvers, name)(basis, measured, iterations=ITERATIONS[name], start=start)
    return FirstVolume(basis, projector.active.compress(found.volume))
