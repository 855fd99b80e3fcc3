"""A known answer: the volume, moved, seen by the cameras with new noise, and solved again.

How large errors are by what a volume looks like, learned where the right answer is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import norm
from tomo.uncertainty.bootstrap_calibration import FLOOR
from tomo.uncertainty.part import Part
from tomo.uncertainty.residual_noise import fine_structure, generator

TURN = 0.35
"""Angle of the motion, in radians. A smaller one brings the volume back to where the views have
left out what they cannot see; a larger one moves light out of the voxels that may emit."""

AXIS = (0.26, 0.86, -0.43)
"""Axis of the motion: none of the grid's, and none that a rig is symmetric about."""


@dataclass(frozen=True, eq=False)
class Moved:
    """Two solves of one moved volume, with noise of either sign.

    ``truth`` is the moved volume, which the images of both are made of; ``found`` are the
    reconstructions, ``images`` those that the first is of. ``remains`` is the fraction of the
    noise that the residual of the first still has.
    """

    truth: NDArray[np.float32]
    found: tuple[NDArray[np.float32], NDArray[np.float32]]
    images: NDArray[np.float32]
    remains: float

    @property
    def structure(self) -> NDArray[np.float64]:
        """The error that both have, ``(nx, ny, nz)``: detail lost, bounds, what is unexplained."""
        return np.mean(self.found, axis=0, dtype=np.float64) - self.truth

    @property
    def noise(self) -> NDArray[np.float64]:
        """The error that changes its sign with the noise, ``(nx, ny, nz)``."""
        one, other = self.found
        return np.subtract(one, other, dtype=np.float64) / 2


def solve_moved(
    part: Part,
    volume: NDArray[np.float32],
    kept: NDArray[np.float32],
    noise: NDArray[np.float64],
    seed: int = 0,
) -> Moved:
    """Move a volume, project it, and solve it with noise of either sign.

    ``kept`` (pixels,) is light to add to the part's images, what no volume explains; ``noise``
    (pixels,) the standard deviation of its pixels. The equivariant bootstrap (Tachella and
    Pereyra, "Equivariant bootstrapping for uncertainty quantification in imaging inverse
    problems", AISTATS 2024). What views cannot see, and what smoothing removes, is missing in the
    volume already: projected and solved again where it is, it comes back as it was. Moved, its
    detail lies where views miss it.
    """
    projector = part.system.projector
    active = projector.active
    unknowns = active.compress(turned(volume)).astype(np.float32)
    clean = (projector @ unknowns).astype(np.float32) + kept
    drawn = (noise * generator(seed, 0).standard_normal(len(noise))).astype(np.float32)
    one, other = (part.solve(clean + sign * drawn) for sign in (1, -1))
    again = (projector @ one).astype(np.float32)
    left = norm(fine_structure(part.system, clean + drawn, again, again))
    size = norm(noise)
    truth, *found = (active.expand(v).reshape(volume.shape) for v in (unknowns, one, other))
    return Moved(truth, (found[0], found[1]), clean + drawn, left / size if size > 0 else 1.0)


def turned(volume: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return a volume turned by `TURN` about `AXIS` through its centre of light, in voxels."""
    from scipy.ndimage import affine_transform, center_of_mass
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_rotvec(TURN * np.array(AXIS) / np.linalg.norm(AXIS)).as_matrix()
    center = np.array(center_of_mass(np.maximum(volume, 0.0)))
    found = affine_transform(
        volume.astype(np.float64), rotation, center - rotation @ center, mode="constant"
    )
    return np.maximum(found, 0.0)


WIDTHS = (1.0, 2.5)
"""Standard deviations, in voxels, of the blurs that describe a voxel's surroundings."""

Volume = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class ErrorPattern:
    """The size of errors as a product of powers of what describes a voxel.

    ``coefficients`` (features + 1,) are the exponents, and the logarithm of the factor;
    ``bounds`` (2, features) the least and the largest logarithms that it was learned from, for
    which others are taken; ``size`` is the emission's root mean square.
    """

    coefficients: NDArray[np.float64]
    bounds: NDArray[np.float64]
    size: float

    def of(self, volume: Volume) -> NDArray[np.float64]:
        """Return the size of the errors of a volume ``(nx, ny, nz)``."""
        found = np.full(volume.shape, self.coefficients[-1])
        features = _features(volume, self.size)
        for feature, power, (low, high) in zip(
            features, self.coefficients, self.bounds.T, strict=False
        ):
            found += power * np.clip(feature, low, high)
        return np.exp(found)


def learned(
    volumes: Sequence[Volume],
    errors: Sequence[Volume],
    where: NDArray[np.bool_],
    size: float,
    level: float | None,
) -> ErrorPattern:
    """Return the pattern of errors of some volumes, (nx, ny, nz) each, in the voxels ``where``.

    The logarithm of an error is linear in those of the voxel, of its surroundings' means and of
    their roughness; least squares. A factor then brings the fraction ``level`` of the errors below
    the pattern, or, where that is None, makes it their mean square. ``size`` is the emission's
    root mean square.
    """
    rows = np.concatenate([np.stack([f[where] for f in _features(v, size)]) for v in volumes], 1)
    off = np.concatenate([np.abs(error[where]) for error in errors])
    least = FLOOR * max(float(np.sqrt(np.mean(off**2))), FLOOR * size)
    terms = np.vstack([rows, np.ones(len(off))])
    # einsum adds in one order whatever the number of threads, a matrix product may not
    normal = np.einsum("iv,jv->ij", terms, terms)
    target = np.einsum("iv,v->i", terms, np.log(off + least))
    found = np.linalg.lstsq(normal, target, rcond=1e-9)[0]
    shape = np.exp(np.einsum("i,iv->v", found, terms))
    ratio = off / shape
    factor = np.sqrt(np.mean(ratio**2)) if level is None else np.quantile(ratio, level)
    found[-1] += np.log(max(float(factor), FLOOR**2))
    return ErrorPattern(found, np.stack([rows.min(axis=1), rows.max(axis=1)]), size)


def _features(volume: Volume, size: float) -> list[NDArray[np.float64]]:
    """Return the logarithms of what describes every voxel, ``(nx, ny, nz)`` each."""
    from scipy.ndimage import gaussian_filter

    volume = np.asarray(volume, np.float64)
    near, far = (gaussian_filter(volume, width, mode="constant") for width in WIDTHS)
    rough = np.sqrt(gaussian_filter((volume - near) ** 2, WIDTHS[0], mode="constant"))
    return [np.log(np.maximum(one, FLOOR * size)) for one in (volume, near, far, rough)]
