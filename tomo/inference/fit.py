"""The fit of one frame: voxels, what they leave of the images, and the trust in each pixel.

Its arrays are NumPy's, wherever products are computed: it is of a coarse copy, whose images are
filtered and judged between solves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.model.effect import Prediction
from tomo.model.observation import Observation
from tomo.operators import LinearSystem

MODEL_ERROR = 0.01
"""Standard deviation of what voxels cannot show, as a fraction of a pixel's light."""

DARKEST = 1e-3
"""Standard deviation of a dark pixel, as a fraction of the brightest: stray light is as much."""

TRUSTED = 3.0
"""Smoothed residuals, in their own scale, from which a pixel has half its weight."""

COARSE = 0.1
"""Standard deviation of what voxels cannot show of a thin bright flame, as a fraction of a pixel's
light. Lower, its core loses its weight, and with it its voxels; higher, haze keeps its own."""

SMOOTH = 1.0
"""Standard deviation in pixels of the blur of those residuals: light that no volume explains is
wider than noise."""

INDEPENDENT = round(4 * math.pi * SMOOTH**2, 1)
"""Pixels that a smoothed residual is the mean of: 4 pi squared standard deviations."""


CELLS = 6
"""Voxels around the grid along a length of each of its edges. More: light of noise; fewer: steps
between them show in the images."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Coarse voxels in a box twice as wide as the grid, without the grid itself."""

    grid: VoxelGrid
    active: ActiveVoxels

    @classmethod
    def of(cls, grid: VoxelGrid) -> Surroundings:
        """Return the surroundings of a grid."""
        size = 2 * CELLS
        middle, half = (grid.lower + grid.upper) / 2, np.asarray(grid.extent)
        box = VoxelGrid.from_bounds((size,) * 3, middle - half, middle + half)
        around = np.ones(box.shape, bool)
        inner = slice(CELLS // 2, CELLS // 2 + CELLS)
        around[inner, inner, inner] = False
        return cls(box, ActiveVoxels.from_mask(box, around))

    def equations(self, system: LinearSystem) -> LinearSystem:
        """Return the equations of the same pixels as a system's, of the voxels around."""
        seen = system.images(np.ones(system.projector.shape[0], np.float32))
        masks = [image > 0 for image in seen]
        return LinearSystem.from_rig(
            system.rig, self.grid, masks=masks, active=self.active, skip=False, form="stored"
        )


@dataclass(frozen=True, eq=False)
class Fit:
    """A volume, its residual, and the trust in pixels.

    Attributes
    ----------
    unknowns : (unknowns,) float64
    measured, residual : (pixels,) float64
    trust : (pixels,) float64
        Weights from 0 to 1: less for pixels that no effect explains.
    usable : (pixels,) bool
        False for pixels that were left out.
    inflation : float
        Mean squared residual in units of the expected variance.
    around : LinearSystem, optional
        The equations of voxels around the grid, where these were let loose.
    outside : (cells,) float64
        Their emission.
    """

    observation: Observation
    system: LinearSystem
    unknowns: NDArray[np.float64]
    measured: NDArray[np.float64]
    residual: NDArray[np.float64]
    trust: NDArray[np.float64]
    usable: NDArray[np.bool_]
    inflation: float = 1.0
    around: LinearSystem | None = None
    outside: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    @property
    def light_outside(self) -> float:
        """The light that voxels around the grid explain, the sum of all pixels."""
        if self.around is None:
            return 0.0
        light = self.around.projector @ self.outside.astype(np.float32)
        return float(light.sum(dtype=np.float64))

    @property
    def means(self) -> NDArray[np.float32]:
        """The mean emission in every voxel, ``(nx, ny, nz)``."""
        projector = self.system.projector
        volume = projector.active.expand(self.unknowns.astype(np.float32))
        return projector.voxel_means(volume.reshape(projector.grid.shape))

    @property
    def prediction(self) -> Prediction:
        """The images that the volume shows, to which effects give columns."""
        return Prediction(self.observation, self.system, self.unknowns.astype(np.float32))

    def view_sums(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sums over the pixels of each view, ``(..., views)`` of ``(..., pixels)``."""
        before = np.zeros((*pixels.shape[:-1], 1))
        running = np.concatenate([before, np.cumsum(pixels, axis=-1)], axis=-1)
        return np.diff(running[..., self.system.projector.view_ptr])

    @property
    def smoothed(self) -> NDArray[np.float64]:
        """The residual blurred along its image, ``(pixels,)``."""
        images = self.system.images((self.residual * self.usable).astype(np.float32))
        return self.system.flatten([gaussian_filter(image, SMOOTH) for image in images]).astype(
            np.float64
        )

    @property
    def scale(self) -> float:
        """The scale of smoothed residuals where there is light."""
        return self._scale_of(self.smoothed)

    def _scale_of(self, smooth: NDArray[np.float64]) -> float:
        brightest = self.observation.brightest
        lit = self.measured - self.residual > 0.05 * brightest
        spread = 1.4826 * float(np.median(np.abs(smooth[lit]))) if lit.any() else 0.0
        return max(spread, 0.01 * brightest, 1e-30)

    def with_trust(self) -> Fit:
        """Return the fit with less weight for pixels whose smoothed residual stands out."""
        smooth = self.smoothed
        light = np.maximum(self.measured - self.residual, 0)
        scale = np.hypot(self._scale_of(smooth), COARSE * light)
        trust = 1 / (1 + (smooth / (TRUSTED * scale)) ** 4)
        return replace(self, trust=np.where(self.usable, trust, 0))

    def trusting(self, views: NDArray[np.bool_]) -> Fit:
        """Return the fit with all usable pixels of some views trusted again."""
        return replace(self, trust=np.where(self.of_views(views).usable, 1.0, self.trust))

    def of_views(self, views: NDArray[np.bool_]) -> Fit:
        """Return the fit of the pixels of some views alone."""
        of_view = np.repeat(views, np.diff(self.system.projector.view_ptr))
        return replace(self, usable=self.usable & of_view)

    def disagreement(self, scale: float) -> float:
        """Return the bounded sum of squared smoothed residuals, in independent pixels."""
        squares = np.square(self.smoothed / scale)
        bounded = np.where(self.usable, squares / (1 + squares / TRUSTED**2), TRUSTED**2)
        return float(bounded.sum()) / INDEPENDENT

    def with_surroundings(self) -> Fit:
        """Return the fit with voxels around the grid."""
        if self.around is not None:
            return self
        around = Surroundings.of(self.observation.grid).equations(self.system)
        around = self.observation.placed(around)
        return replace(self, around=around, outside=np.zeros(around.projector.shape[1]))


def equations_of(
    observations: Sequence[Observation],
    active: ActiveVoxels | None,
    means: Sequence[NDArray] | None = None,
) -> list[LinearSystem]:
    """Return the equations of every frame's usable pixels, in the linear basis, through the gas.

    Frames have the same cameras, usable pixels and gas, and share their equations where the gas
    does not absorb by its emission, whose ``means`` are given, one a frame.
    """
    one = observations[0]
    system = LinearSystem.from_rig(
        one.rig,
        one.grid,
        masks=one.masks,
        active=active,
        skip=False,  # the same pixels wherever cameras look
        supersample=one.supersample,
        form="stored",
    ).with_linear_basis(one.supersample, one.blur)
    system = one.placed(system)
    several = {"supersample": one.supersample}
    if one.absorption.emission:
        volumes = [None] * len(observations) if means is None else means
        return [system.with_absorption(one.absorption, own, **several) for own in volumes]
    if one.absorption:
        system = system.with_absorption(one.absorption, None, **several)
    return [system] * len(observations)


def continued(
    found: Sequence[Fit], observations: Sequence[Observation], active: ActiveVoxels | None
) -> tuple[Fit, ...]:
    """Return the fits of observations that were corrected further."""
    before, now = found[0].observation, observations[0]
    same = tuple(now.rig) == tuple(before.rig) and now.blur == before.blur
    systems = [one.system for one in found]
    if not same or now.absorption != before.absorption:
        systems = equations_of(observations, active, [one.means for one in found])
    around = found[0].around
    if around is not None and not same:
        around = now.placed(Surroundings.of(now.grid).equations(systems[0]))
    fits = []
    for one, observation, system in zip(found, observations, systems, strict=True):
        measured = system.flatten(list(observation.images)).astype(np.float64)
        fits.append(
            replace(one, observation=observation, system=system, measured=measured,
                    residual=measured, around=around)
        )  # fmt: skip
    return tuple(fits)


def variance_of(
    system: LinearSystem, observation: Observation, predicted: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the expected squared residual of every pixel, ``(pixels,)``."""
    ptr, light = system.projector.view_ptr, np.maximum(predicted, 0)
    noise = [
        model.variance(light[start:stop])
        for model, start, stop in zip(observation.noise, ptr[:-1], ptr[1:], strict=True)
    ]
    darkest = (DARKEST * observation.brightest) ** 2
    return np.concatenate(noise) + (MODEL_ERROR * light) ** 2 + darkest
