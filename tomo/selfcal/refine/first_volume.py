"""The quick volume on a smooth basis that cameras are refined against and evaluated with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo import solvers
from tomo.operators import GaussianBasis
from tomo.operators.operator import ProjectionOperator
from tomo.selection.folds import FEW_VIEWS
from tomo.solvers.initial_volume import mlos_start

WIDTH = 0.8
"""Width of the Gaussian blobs in voxels. Narrower, the volume's gradient is noise; wider, edges of
the flame vanish and cameras are hardly determined."""

ITERATIONS = {"mlem": 12, "nnls": 20}
"""Iterations by solver. Fewer leave the volume too smooth; more take longer and fit noise."""


@dataclass(frozen=True, eq=False)
class FirstVolume:
    """The coefficients of a volume and their basis.

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
    """Solve for a volume with a few iterations on a smooth basis.

    The solver is MLEM for few views, since it stays smooth where they do not determine the volume,
    and non-negative least squares otherwise.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,) float32
    """
    basis = GaussianBasis(projector, WIDTH)
    name = "mlem" if len(projector.views_with_pixels) <= FEW_VIEWS else "nnls"
    start = mlos_start(projector, measured) if name == "mlem" else None
    found = getattr(solvers, name)(basis, measured, iterations=ITERATIONS[name], start=start)
    return FirstVolume(basis, projector.active.compress(found.volume))
