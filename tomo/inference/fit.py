"""One fit: voxels, pixel weights and, where they are let loose, effects of one observation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tomo.grid import ActiveVoxels
from tomo.inference.joint import Joint, Unknowns
from tomo.model.effect import Effect, Prediction
from tomo.model.observation import Observation
from tomo.model.outside import Surroundings
from tomo.operators import LinearSystem
from tomo.priors import RelativeCurvature
from tomo.solvers.initial_volume import mlos_start
from tomo.solvers.mlem import mlem

Values = Mapping[str, NDArray[np.float64]]

ROUGH = 0.3
"""Standard deviation of the emission's curvature, as a fraction of its peak. Lower, thin flames
look like faults of cameras; higher, voxels imitate these faults."""

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

OUTSIDE = 0.3
"""Standard deviation of the emission around the grid, as a fraction of the peak in it."""

FIRST, THEN = 8, 16
"""Iterations of MLEM at the start, and of conjugate gradients of every solve."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A volume, its residual, the trust in pixels, and what effects were found beside it.

    Attributes
    ----------
    observation : Observation
    system : LinearSystem
    unknowns : (unknowns,) float64
    measured, residual : (pixels,) float64
    trust : (pixels,) float64
        Weights from 0 to 1: less for pixels that no effect explains.
    usable : (pixels,) bool
        False for pixels that were left out.
    inflation : float
        Mean squared residual in units of the expected variance.
    values : mapping of str to (views, parameters)
        What one step of the effects comes to, by their names.
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
    values: Values = field(default_factory=dict)
    around: LinearSystem | None = None
    outside: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    @property
    def light_outside(self) -> float:
        """The fraction of all light that voxels around the grid explain."""
        if self.around is None:
            return 0.0
        light = self.around.projector @ self.outside.astype(np.float32)
        return float(light.sum(dtype=np.float64) / max(self.measured.sum(), 1e-300))

    @property
    def means(self) -> NDArray[np.float32]:
        """The mean emission in every voxel, ``(nx, ny, nz)``."""
        projector = self.system.projector
        volume = projector.active.expand(self.unknowns.astype(np.float32))
        return projector.voxel_means(volume.reshape(projector.grid.shape))


def equations_of(
    observation: Observation, active: ActiveVoxels | None, means: NDArray | None = None
) -> LinearSystem:
    """Return the equations of all usable pixels, in the linear basis, through the known gas."""
    system = LinearSystem.from_rig(
        observation.rig,
        observation.grid,
        masks=observation.masks,
        active=active,
        skip=False,  # the same pixels wherever cameras look
        supersample=observation.supersample,
        form="stored",
    ).with_linear_basis(observation.supersample, observation.blur)
    if not observation.absorption:
        return system
    several = {"supersample": observation.supersample}
    return system.with_absorption(observation.absorption, means, **several)


def first_fit(
    observation: Observation,
    active: ActiveVoxels | None = None,
    volume: NDArray | None = None,
    rounds: int = 2,
    system: LinearSystem | None = None,
) -> Fit:
    """Return a fit of voxels alone, with robust weights, from a few MLEM updates or a volume.

    ``system`` are the equations where they are known.
    """
    system = system or equations_of(observation, active, volume)
    projector = system.projector
    measured = system.flatten(list(observation.images))
    if volume is None:
        light = np.maximum(measured, 0).astype(np.float32)
        start = mlem(projector, light, iterations=FIRST, start=mlos_start(projector, light)).volume
        volume = start
    unknowns = projector.active.compress(np.asarray(volume, np.float32)).astype(np.float64)
    measured = measured.astype(np.float64)
    one = np.ones(len(measured))
    found = Fit(observation, system, unknowns, measured, measured, one, one > 0)
    for _ in range(rounds):
        found = next_fit(found)
        found = with_trust(found)
    return found


def continued(found: Fit, observation: Observation, active: ActiveVoxels | None) -> Fit:
    """Return the fit of an observation that was corrected further."""
    same = tuple(observation.rig) == tuple(found.observation.rig)
    same = same and observation.blur == found.observation.blur
    system = found.system
    if not same or observation.absorption != found.observation.absorption:
        system = equations_of(observation, active, found.means)
    measured = system.flatten(list(observation.images)).astype(np.float64)
    around = found.around
    if around is not None and not same:
        around = Surroundings.of(observation.grid).equations(system)
    return Fit(
        observation, system, found.unknowns, measured, measured, found.trust, found.usable,
        found.inflation, around=around, outside=found.outside,
    )  # fmt: skip


def with_surroundings(found: Fit) -> Fit:
    """Return the fit with voxels around the grid."""
    if found.around is not None:
        return found
    around = Surroundings.of(found.observation.grid).equations(found.system)
    return replace(found, around=around, outside=np.zeros(around.projector.shape[1]))


def next_fit(
    found: Fit,
    effects: Sequence[Effect] = (),
    *,
    free: Mapping[str, NDArray[np.bool_]] | None = None,
    values: Values | None = None,
    iterations: int = THEN,
) -> Fit:
    """Return the fit after one joint solve of voxels and a linear step of the effects.

    Parameters
    ----------
    found : Fit
    effects : sequence of Effect
    free : mapping of str to (views, parameters) bool, optional
        Which parameters may change; all when None.
    values : mapping, optional
        What was corrected already: priors hold for the sum.
    iterations : int
    """
    system, observation = found.system, found.observation
    projector = system.projector
    prediction = Prediction(observation, system, found.unknowns.astype(np.float32))
    variance = variance_of(system, observation, prediction.pixels)
    weights = found.trust / (variance * found.inflation)
    lit = found.unknowns[found.unknowns > 0]
    peak = float(np.percentile(lit, 99)) if len(lit) else 1.0
    prior = RelativeCurvature(projector.active, found.unknowns.astype(np.float32))
    columns = _columns(effects, prediction, free, values)
    around = found.around
    joint = Joint(
        projector, weights, prior, 1 / (ROUGH * peak) ** 2, columns.own, columns.shared,
        columns.departure, None if around is None else around.projector,
        1 / (OUTSIDE * peak) ** 2,
    )  # fmt: skip
    start = Unknowns(
        found.unknowns,
        found.outside,
        np.zeros((len(columns.own), projector.n_views)),
        np.zeros(len(columns.shared)),
    )
    z, residual = joint.solve(found.measured, start, iterations)
    inflation = found.inflation
    if not effects:
        squares = residual**2 / variance
        inflation = max(float(np.average(squares, weights=found.trust + 1e-9)), 1e-6)
    return replace(
        found,
        unknowns=z.voxels,
        residual=residual,
        inflation=inflation,
        values=columns.values(z),
        outside=z.outside,
    )


@dataclass(frozen=True, eq=False)
class _Columns:
    """The columns of effects, of single views and shared, and how far each is from its prior."""

    own: NDArray[np.float64]
    shared: NDArray[np.float64]
    departure: tuple[NDArray[np.float64], NDArray[np.float64]]
    effects: Sequence[Effect]
    deviations: Mapping[str, NDArray[np.float64]]

    def values(self, z: Unknowns) -> Values:
        """Return the parameters by effect, ``(views, parameters)`` each."""
        found, own, shared = {}, 0, 0
        for effect in self.effects:
            deviation, count = self.deviations[effect.name], len(effect.parameters)
            if effect.shared:
                part = z.shared[shared : shared + count]
                found[effect.name] = np.broadcast_to(part, deviation.shape) * deviation
                shared += count
            else:
                found[effect.name] = z.own[own : own + count].T * deviation
                own += count
        return found


def _columns(
    effects: Sequence[Effect],
    prediction: Prediction,
    free: Mapping[str, NDArray[np.bool_]] | None,
    values: Values | None,
) -> _Columns:
    """Return the columns of effects, in units of their priors' standard deviations."""
    projector, observation = prediction.system.projector, prediction.observation
    of_view = np.repeat(np.arange(projector.n_views), np.diff(projector.view_ptr))
    own, shared, own_departure, shared_departure = [], [], [], []
    deviations = {}
    for effect in effects:
        full = effect.deviation(observation)
        deviation = full if free is None else np.where(free[effect.name], full, 0.0)
        deviations[effect.name] = deviation
        gone = np.zeros_like(full) if values is None else values[effect.name] / full
        if deviation.any():
            columns = effect.columns(prediction)
        else:
            columns = np.zeros((len(effect.parameters), projector.shape[0]))
        if effect.shared:
            shared += list(columns * deviation[0][:, None])
            shared_departure += list(gone[0])
        else:
            own += list(columns * deviation.T[:, of_view])
            own_departure += list(gone.T)
    pixels, views = projector.shape[0], projector.n_views
    return _Columns(
        np.array(own).reshape(-1, pixels),
        np.array(shared).reshape(-1, pixels),
        (np.array(own_departure).reshape(-1, views), np.array(shared_departure)),
        effects,
        deviations,
    )


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


def with_trust(found: Fit) -> Fit:
    """Return the fit with less weight for pixels whose smoothed residual stands out."""
    smooth = smoothed(found)
    light = np.maximum(found.measured - found.residual, 0)
    scale = np.hypot(scale_of(found, smooth), COARSE * light)
    trust = 1 / (1 + (smooth / (TRUSTED * scale)) ** 4)
    return replace(found, trust=np.where(found.usable, trust, 0))


def scale_of(found: Fit, smooth: NDArray[np.float64]) -> float:
    """Return the scale of smoothed residuals where there is light."""
    brightest = found.observation.brightest
    lit = found.measured - found.residual > 0.05 * brightest
    spread = 1.4826 * float(np.median(np.abs(smooth[lit]))) if lit.any() else 0.0
    return max(spread, 0.01 * brightest, 1e-30)


def smoothed(found: Fit) -> NDArray[np.float64]:
    """Return the residual blurred along its image, ``(pixels,)``."""
    images = found.system.images((found.residual * found.usable).astype(np.float32))
    return found.system.flatten([gaussian_filter(image, SMOOTH) for image in images]).astype(
        np.float64
    )
