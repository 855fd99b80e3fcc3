"""Patches of the images: sums of residuals, and the part of them that is noise."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from tomo.operators import Projector
from tomo.wernet.default.ray_features import RayFeatures

PATCH = 0.2
"""Side of a patch, where the widest image is two across. Smaller: errors of single voxels and rays
do not cancel in a patch. Larger: what weights change cancels too."""

OVERLAP = 1.27
"""Variance of the squared noise summed over overlapping patches, relative to separate ones."""

SURE = 2.0
"""Standard deviations of the squared noise below which a misfit beyond the noise is not known.
Smaller: chance counts as misfit. Larger: weak terms are missed."""

CLEAR = 9.0
"""Squared standard deviations by which a term must explain more than the noise along it."""

SMOOTH = 2.25
"""Noise along a smooth term in overlapping patches, relative to noise in one patch."""


@dataclass(frozen=True, eq=False)
class Patches:
    """Neighbouring pixels of a view, summed with weights.

    A patch is a tent, two sides wide, that overlaps its neighbours. A pattern that changes sign
    from pixel to pixel cancels within a tent; a box would cut through it at its edge.

    Attributes
    ----------
    tents : (patches, pixels) sparse, float64
        Weight of each pixel; their squares add up to one in each patch.
    view : (patches,) int64
    """

    tents: scipy.sparse.csr_array
    view: NDArray[np.int64]

    @property
    def pixels_per_patch(self) -> float:
        """Number of pixels over the number of patches."""
        return self.tents.shape[1] / max(self.tents.shape[0], 1)

    @classmethod
    def of(cls, projector: Projector, features: RayFeatures, side: float = PATCH) -> Patches:
        """Lay tents ``side`` apart over each view's pixels, by their position in the image."""
        view = np.repeat(np.arange(projector.n_views), np.diff(projector.view_ptr))
        position = features.image_position.numpy().astype(np.float64) / side  # (pixels, 2)
        corner = np.floor(position).astype(np.int64)
        fraction, corner = position - corner, corner - corner.min(axis=0)
        across, up = corner.max(axis=0) + 2
        neighbours = [
            (
                (view * across + corner[:, 0] + right) * up + corner[:, 1] + above,
                np.abs(1 - right - fraction[:, 0]) * np.abs(1 - above - fraction[:, 1]),
            )
            for right, above in itertools.product((0, 1), repeat=2)
        ]
        number, weight = (np.concatenate(each) for each in zip(*neighbours, strict=True))
        pixel, inside = np.tile(np.arange(len(view)), 4), weight > 0
        found, patch = np.unique(number[inside], return_inverse=True)
        norm = np.sqrt(np.bincount(patch, weight[inside] ** 2))
        tents = scipy.sparse.csr_array(
            (weight[inside] / norm[patch], (patch, pixel[inside])), (len(found), len(view))
        )
        return cls(tents, found // (across * up))

    def sum(self, image: NDArray) -> NDArray[np.float64]:
        """Return the sums over patches of ``image`` (pixels,); white noise keeps its size."""
        return self.tents @ np.asarray(image, np.float64)


def beyond_noise(squared: float, noise: float, patches: int) -> float:
    """Return the root of the known part of a squared misfit beyond the noise.

    It is at least the chance variation of the noise's squares: a smaller misfit is not known, and
    to explain a fraction of it means nothing.

    Parameters
    ----------
    squared, noise : float
        Squares summed over the patches: the whole misfit, and the part expected of noise.
    patches : int
        Number of patches.
    """
    unsure = SURE * noise * math.sqrt(2 * OVERLAP / max(patches, 1))
    return math.sqrt(max(squared - noise, unsure))


def noise_along_a_term(noise: float, patches: int) -> float:
    """Return how much of the squared noise of all patches a term may explain by chance."""
    return CLEAR * SMOOTH * noise / max(patches, 1)
