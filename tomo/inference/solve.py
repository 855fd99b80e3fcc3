"""Fits of several frames: their voxels, and one step of the effects that are common to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator

from tomo._compute.arrays import host
from tomo.grid import ActiveVoxels
from tomo.inference.columns import Unknowns
from tomo.inference.fit import Fit, equations_of, variance_of
from tomo.inference.joint import FrameProblem, Joint
from tomo.model.effect import Effect, Prediction
from tomo.model.observation import Observation
from tomo.operators import LinearSystem
from tomo.priors import RelativeCurvature
from tomo.solvers.initial_volume import mlos_start
from tomo.solvers.mlem import mlem

Values = Mapping[str, NDArray[np.float64]]
"""By effect, ``(views, parameters)``."""

ROUGH = 0.3
"""Standard deviation of the emission's curvature, as a fraction of its peak. Lower, thin flames
look like faults of cameras; higher, voxels imitate these faults."""

OUTSIDE = 0.3
"""Standard deviation of the emission around the grid, as a fraction of the peak in it."""

PROBES = 4
"""Draws of noise that tell how far it pushes a field. Fewer, the limit is known to some per cent;
more take longer."""

SOLVES = 4
"""Solves from an even volume. Fewer leave more of what is left out to the solve than to faults;
more take longer."""

FIRST, THEN = 8, 16
"""Iterations of MLEM at the start, and of conjugate gradients of every solve."""


def first_fits(
    observations: Sequence[Observation],
    active: ActiveVoxels | None = None,
    volumes: Sequence[NDArray] | None = None,
    rounds: int = 2,
    systems: Sequence[LinearSystem] | None = None,
) -> tuple[Fit, ...]:
    """Return fits of voxels alone, one a frame, see `first_fit`."""
    systems = systems or equations_of(observations, active, volumes)
    starts = [None] * len(observations) if volumes is None else volumes
    each = zip(observations, systems, starts, strict=True)
    return tuple(_first_fit(one, system, volume, rounds) for one, system, volume in each)


def first_fit(observation: Observation, active: ActiveVoxels | None = None) -> Fit:
    """Return a fit of voxels alone, with robust weights, from a few MLEM updates."""
    return first_fits([observation], active)[0]


def _first_fit(
    observation: Observation, system: LinearSystem, volume: NDArray | None, rounds: int
) -> Fit:
    projector = system.projector
    measured = system.flatten(list(observation.images))
    if volume is None:
        light = np.maximum(measured, 0).astype(np.float32)
        start = mlos_start(projector, light)
        volume = mlem(projector, light, iterations=FIRST, start=start).volume
    unknowns = projector.active.compress(np.asarray(volume, np.float32)).astype(np.float64)
    measured = measured.astype(np.float64)
    one = np.ones(len(measured))
    found = Fit(observation, system, unknowns, measured, measured, one, one > 0)
    for _ in range(rounds):
        found = next_fit(found).with_trust()
    return found


def next_fit(found: Fit) -> Fit:
    """Return the fit after a solve of the voxels alone."""
    return next_fits([found])[0][0]


def fitted_from_even(fit: Fit) -> Fit:
    """Return the fit of voxels alone to all usable pixels, from an even volume.

    A volume that was found from pixels that are not used now remembers them.
    """
    even = np.full_like(fit.unknowns, fit.unknowns.mean())
    fit = replace(fit, unknowns=even, trust=fit.usable.astype(np.float64))
    for _ in range(SOLVES):
        fit = next_fit(fit)
    return fit


def next_fits(
    found: Sequence[Fit],
    effects: Sequence[Effect] = (),
    *,
    free: Mapping[str, NDArray[np.bool_]] | None = None,
    values: Values | None = None,
) -> tuple[tuple[Fit, ...], Values]:
    """Return the fits after one joint solve of all voxels, and a linear step of the effects.

    Parameters
    ----------
    found : sequence of Fit
        One a frame: each has voxels of its own, and the effects are common to all.
    free : mapping of str to (views, parameters) bool, optional
        Which parameters may change; all when None.
    values : mapping, optional
        What was corrected already: priors hold for the sum.

    Returns
    -------
    fits : tuple of Fit
    step : mapping of str to (views, parameters)
    """
    if not effects and len(found) > 1:  # nothing joins them
        return tuple(next_fit(one) for one in found), {}
    parameters = _Parameters.of(effects, found[0].observation, free, values)
    problems, variances = [], []
    there = found[0].system.projector.array
    for one in found:
        projector = one.system.projector
        prediction = one.prediction
        variances.append(variance_of(one.system, one.observation, prediction.pixels))
        lit = one.unknowns[one.unknowns > 0]
        peak = float(np.percentile(lit, 99)) if len(lit) else 1.0
        problems.append(
            FrameProblem(
                projector,
                there(one.trust / (variances[-1] * one.inflation)),
                RelativeCurvature(projector.active, there(one.unknowns.astype(np.float32))),
                1 / (ROUGH * peak) ** 2,
                *parameters.columns(prediction),
                None if one.around is None else one.around.projector,
                1 / (OUTSIDE * peak) ** 2,
                parameters.field.columns(prediction) if parameters.field else None,
            )
        )
    operators = [one.field for one in problems if one.field is not None]
    own, shared = map(np.zeros_like, parameters.departure)
    start = Unknowns(
        there(np.stack([one.unknowns for one in found])),
        there(np.stack([one.outside for one in found])),
        own,
        shared,
        parameters.nodes,
    )
    measured = np.stack([one.measured for one in found])
    if operators:  # a field is solved for itself, not for its change
        measured = measured + [one @ parameters.nodes for one in operators]
    pull = _pull(operators, [host(one.weights) for one in problems])
    problem = Joint(problems, parameters.departure, pull)
    with found[0].system.projector.computing():
        z, residual = problem.solve(there(measured), start, THEN)
    fits = []
    for one, voxels, outside, left, variance in zip(
        found, host(z.voxels), host(z.outside), host(residual), variances, strict=True
    ):
        inflation = one.inflation
        if not effects:
            squares = np.square(left) / variance
            inflation = max(float(np.average(squares, weights=one.trust + 1e-9)), 1e-6)
        fits.append(
            replace(one, unknowns=voxels, outside=outside, residual=left, inflation=inflation)
        )
    return tuple(fits), parameters.values(z)


def rises(found: Sequence[Fit], effect: Effect) -> bool:
    """Return whether a field that is zero explains more anywhere than noise may.

    Else it stays exactly zero in `next_fits`.
    """
    operators, weights, steep = [], [], []
    for one in found:
        prediction = one.prediction
        variance = variance_of(one.system, one.observation, prediction.pixels)
        operators.append(effect.columns(prediction))
        weights.append(one.trust / (variance * one.inflation))
        steep.append(operators[-1].T @ (weights[-1] * one.residual))
    return bool((np.sum(steep, axis=0) > _pull(operators, weights)).any())


def _pull(
    operators: Sequence[LinearOperator], weights: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return how strongly each node of a field is pulled to zero, ``(nodes,)``.

    As strongly as noise pushes the most pushed of so many nodes, and more where the images are
    more sensitive than on average: it is there that detail finer than voxels looks like gas.
    """
    if not operators:
        return np.zeros(0)
    random, nodes = np.random.default_rng(0), operators[0].shape[1]
    pushed, seen = np.zeros((PROBES, nodes)), np.zeros(nodes)
    for operator, weight in zip(operators, weights, strict=True):
        for one in pushed:
            one += operator.T @ (np.sqrt(weight) * random.choice((-1.0, 1.0), len(weight)))
        seen += operator.T @ (weight * (operator @ np.ones(nodes)))
    relative = np.sqrt(np.maximum(seen / max(seen.mean(), 1e-300), 1.0))
    return np.sqrt(2 * np.log(nodes)) * np.sqrt(np.mean(np.square(pushed))) * relative


@dataclass(frozen=True, eq=False)
class _Parameters:
    """The parameters of effects that may change, and how far each is from its prior's mean.

    Those of single views come first, ``(parameters, views)``, then those that views share. A field
    has the values of its nodes instead.
    """

    effects: Sequence[Effect]
    deviations: Values
    departure: tuple[NDArray[np.float64], NDArray[np.float64]]
    field: Effect | None
    nodes: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        effects: Sequence[Effect],
        observation: Observation,
        free: Mapping[str, NDArray[np.bool_]] | None,
        values: Values | None,
    ) -> _Parameters:
        deviations, own, shared, field, nodes = {}, [], [], None, np.zeros(0)
        for effect in effects:
            full = effect.deviation(observation)
            may = None if free is None else free[effect.name]
            deviations[effect.name] = full if may is None else np.where(may, full, 0.0)
            gone = np.zeros_like(full) if values is None else values[effect.name] / full
            if effect.field_of is not None:
                if deviations[effect.name].any():
                    field, nodes = effect, gone[0] * full[0]
            elif effect.shared:
                shared += list(gone[0])
            else:
                own += list(gone.T)
        departure = np.array(own).reshape(-1, len(observation.rig)), np.array(shared)
        return cls(effects, deviations, departure, field, nodes)

    def columns(self, at: Prediction) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the columns of one frame, in units of the priors' standard deviations."""
        projector = at.system.projector
        of_view = np.repeat(np.arange(projector.n_views), np.diff(projector.view_ptr))
        own: list[NDArray[np.float64]] = []
        shared: list[NDArray[np.float64]] = []
        for effect in self.effects:
            deviation = self.deviations[effect.name]
            if effect.field_of is not None:
                continue
            if deviation.any():
                columns = effect.columns(at)
            else:
                columns = np.zeros((len(effect.parameters), projector.shape[0]))
            if effect.shared:
                shared += list(columns * deviation[0][:, None])
            else:
                own += list(columns * deviation.T[:, of_view])
        pixels = projector.shape[0]
        return np.array(own).reshape(-1, pixels), np.array(shared).reshape(-1, pixels)

    def values(self, z: Unknowns) -> Values:
        """Return the parameters by effect, ``(views, parameters)`` each."""
        found, own, shared = {}, 0, 0
        for effect in self.effects:
            deviation, count = self.deviations[effect.name], len(effect.parameters)
            if effect.field_of is not None:
                change = z.nodes - self.nodes if effect is self.field else 0.0
                found[effect.name] = np.broadcast_to(change, deviation.shape)
            elif effect.shared:
                part = z.shared[shared : shared + count]
                found[effect.name] = np.broadcast_to(part, deviation.shape) * deviation
                shared += count
            else:
                found[effect.name] = z.own[own : own + count].T * deviation
                own += count
        return found
