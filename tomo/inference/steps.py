"""One step of every effect from the fits, and from the null: scenes seen by exact cameras."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import zoom

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.inference.fit import Fit
from tomo.inference.solve import Values, first_fits, next_fits, rises
from tomo.model.effect import Effect
from tomo.model.gauge import without_gauge
from tomo.model.observation import Observation
from tomo.operators import LinearSystem

FINER = 2
"""How much narrower than those of the fit the voxels of the null's volumes are."""

TURNS = ((), (0,), (2,), (0, 2), (1,), (0, 1))
"""Axes along which the found volume is turned over, one null each: scenes of the same kind that
meet voxels and cameras in other ways."""


class Exact(NamedTuple):
    """Images by exact cameras, the voxels that may be other than zero, and what they emit."""

    observation: Observation
    active: ActiveVoxels | None
    volume: NDArray[np.float32]  # (nx, ny, nz)


def exact_images(
    observation: Observation,
    volume: NDArray[np.float32],
    turn: int,
    active: ActiveVoxels | None = None,
    frame: int = 0,
) -> Exact:
    """Return what exact cameras see of a volume, turned over as `TURNS` says, with their noise.

    ``frame`` numbers the moments that are drawn with the same ``turn``.
    """
    grid = observation.grid
    fine = VoxelGrid.from_bounds([FINER * n for n in grid.shape], grid.lower, grid.upper)
    values = zoom(np.maximum(volume, 0), FINER, order=3, grid_mode=True, mode="nearest")
    values = np.flip(np.maximum(values, 0), TURNS[turn]).astype(np.float32)
    system = LinearSystem.from_rig(
        observation.rig, fine, masks=observation.masks, supersample=FINER, form="on-the-fly"
    )
    if observation.absorption:
        system = system.with_absorption(observation.absorption, values, supersample=FINER)
    seen = system.images(system.projector @ system.projector.active.compress(values))
    made = []
    for camera, image, noise in zip(observation.rig, seen, observation.noise, strict=True):
        seed = [turn, zlib.crc32(camera.name.encode())]
        random = np.random.default_rng(seed + [frame] * (frame > 0))
        spread = np.sqrt(noise.variance(image))
        made.append((image + random.normal(size=image.shape) * spread).astype(np.float32))
    if active is not None and not active.all:
        mask = np.flip(active.mask.reshape(grid.shape), TURNS[turn])
        active = ActiveVoxels.from_mask(grid, mask)
    turned = np.ascontiguousarray(np.flip(volume, TURNS[turn]))
    return Exact(replace(observation, images=tuple(made)), active, turned)


DRAWN = 3
"""Scenes of the null. Fewer: the spread of what all views share is not known; more take longer."""

DETAIL = 0.3
"""Relative error of what the null comes to: its volumes have less detail than the flame."""


class Steps:
    """One step of every effect from the fits of some frames, each found when it is asked for.

    There is a fit a frame; ``values`` are what was corrected already: priors hold for the sum.
    """

    def __init__(self, fits: Sequence[Fit], effects: Sequence[Effect], values: Values) -> None:
        self.fits, self.effects, self.values = tuple(fits), effects, values
        self._shared: dict[str, float] = {}

    @cached_property
    def _together(self) -> tuple[tuple[Fit, ...], Values]:
        own = [effect for effect in self.effects if not effect.shared]
        return next_fits(self.fits, own, values=self.values)

    @cached_property
    def own(self) -> Values:
        """Steps of what each view has for itself, all together, without the gauge."""
        return without_gauge(self._together[1], self.fits[0].observation, mean_volume(self.fits))

    @property
    def misfit(self) -> float:
        """Root mean square of the residual that these steps leave."""
        fits = self._together[0]
        squares = np.concatenate([one.residual**2 for one in fits])
        weights = np.concatenate([one.trust + 1e-12 for one in fits])
        return float(np.sqrt(np.average(squares, weights=weights)))

    def shared(self, effect: Effect) -> float:
        """Return the size of the step of an effect that all views share, let loose alone."""
        if effect.name not in self._shared:
            size = 0.0
            if effect.field_of is None or rises(self.fits, effect):
                _, found = next_fits(self.fits, (effect,), values=self.values)
                deviation = effect.deviation(self.fits[0].observation)
                size = float(sizes_of(effect, found[effect.name], deviation)[0, 0])
            self._shared[effect.name] = size
        return self._shared[effect.name]

    @cached_property
    def outside(self) -> float:
        """The fraction of all light that voxels around the grid explain."""
        fits, _ = next_fits([one.with_surroundings() for one in self.fits])
        return fraction_outside(fits)

    @property
    def hidden(self) -> NDArray[np.float64]:
        """The fraction of every view's pixels that lost their weight, ``(views,)``."""
        return distrust(self.fits)


class Null:
    """Steps on scenes like those found, seen by exact cameras through the known gas.

    ``steps`` are those of the scene itself. Errors there are larger than here by a ``factor``: by
    the root of the ratio of the residuals, since a part of the scene's is detail that no voxel
    shows, and a part the faults that are looked for.
    """

    def __init__(self, steps: Steps, active: ActiveVoxels | None) -> None:
        fits, effects = steps.fits, steps.effects
        one = fits[0].observation
        none = {e.name: np.zeros((len(one.rig), len(e.parameters))) for e in effects}
        self._drawn = []
        for turn in range(DRAWN):
            made = [
                exact_images(fit.observation, fit.means, turn, active, frame)
                for frame, fit in enumerate(fits)
            ]
            turned = made[0].active
            same = turned is active and not one.absorption.emission
            systems = [fit.system for fit in fits] if same else None
            observations, volumes = [m.observation for m in made], [m.volume for m in made]
            drawn = first_fits(observations, turned, volumes, rounds=1, systems=systems)
            self._drawn.append(Steps(drawn, effects, none))
        misfit = float(np.mean([one.misfit for one in self._drawn]))
        self.factor = (1 + DETAIL) * max(1.0, steps.misfit / max(misfit, 1e-300)) ** 0.5

    @property
    def fits(self) -> tuple[Fit, ...]:
        """Those of the scene that is not turned over."""
        return self._drawn[0].fits

    def spread(self, name: str) -> NDArray[np.float64]:
        """Return the spread of what each view has for itself, ``(parameters,)``."""
        squares = [np.square(one.own[name]).mean(axis=0) for one in self._drawn]
        return self.factor * np.sqrt(np.mean(squares, axis=0))

    def hidden(self) -> float:
        """Return the spread of the fraction of pixels that lost their weight."""
        return float(np.sqrt(np.mean([np.square(one.hidden) for one in self._drawn])))

    def of(self, what: Callable[[Steps], float]) -> tuple[float, float]:
        """Return mean and spread of what all views share."""
        drawn = [what(one) for one in self._drawn]
        mean = float(np.mean(drawn))
        return mean, float(np.hypot(np.std(drawn, ddof=1), DETAIL * mean))


def sizes_of(
    effect: Effect, values: NDArray[np.float64], deviation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the sizes that scores compare, ``(views, parameters)``: the parameters themselves.

    The nodes of a field have one for all of them: their mean, in standard deviations.
    """
    if effect.field_of is None:
        return values
    return np.full_like(values, np.mean(values / deviation))


def mean_volume(fits: Sequence[Fit]) -> NDArray[np.float32]:
    """Return the mean of the frames' emission in every voxel, ``(nx, ny, nz)``."""
    return np.mean([one.means for one in fits], axis=0)


def fraction_outside(fits: Sequence[Fit]) -> float:
    """Return the fraction of all light that voxels around the grid explain."""
    light = sum(float(one.measured.sum()) for one in fits)
    return sum(one.light_outside for one in fits) / max(light, 1e-300)


def distrust(fits: Sequence[Fit], lit: float = -np.inf) -> NDArray[np.float64]:
    """Return the fraction of every view's usable pixels that lost their weight, ``(views,)``.

    Those count that are as bright as ``lit``, measured or predicted; the mean of the frames.
    """
    return np.mean([_distrust(one, lit) for one in fits], axis=0)


def _distrust(fit: Fit, lit: float) -> NDArray[np.float64]:
    bright = np.maximum(fit.measured, fit.measured - fit.residual) >= lit
    counted = (fit.usable & bright).astype(np.float64)
    return fit.view_sums(counted * (1 - fit.trust)) / np.maximum(fit.view_sums(counted), 1)
