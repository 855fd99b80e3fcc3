"""Refine cameras until they agree about the volume, and keep that only if it predicts better.

The images are predicted from a quick volume of all the cameras, and what is left of them is
regressed on how each prediction changes with its camera's position, turn, focal length and
gain, the volume free to change along (`tomo.refine.joint`), and held back by the prior
(`tomo.refine.prior`). That is repeated while it helps. A fifth of all rays, in
tiles, takes no part: predicted from other views, before and after, they say which rig is the
better one and whether it is good enough to be believed.

Wieneke, "Volume self-calibration for 3D particle image velocimetry", Experiments in Fluids 45
(2008), refines cameras from disparities of particles; Golub and Pereyra, "The differentiation of
pseudo-inverses and nonlinear least squares problems whose variables separate", SIAM Journal on
Numerical Analysis 10 (1973), for why the volume has to take part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import RayTable, Rig
from tomo._coarser import coarsening, coarser_grid, shrunk_image
from tomo.grid import VoxelGrid
from tomo.linear_system import LinearSystem, VolumeNotSeenError
from tomo.live_voxels import LiveVoxels
from tomo.refine.first_volume import first_volume
from tomo.refine.held_out import Judgement, held_out_tiles, judge, tiles_of
from tomo.refine.joint import JointStep, weight_of
from tomo.refine.parameters import (
    COUNT,
    FOCAL,
    GAIN,
    PLACE,
    image_derivatives,
    moved_rig,
    volume_gradient,
    without_common_motion,
)
from tomo.refine.prior import GAIN_PRIOR, prior_lengths, units
from tomo.support import carve

Progress = Callable[[int, int, str], None]

CROSSINGS = 6_000_000
"""About the size of the finest system, before empty voxels are left out."""

ROUNDS = 6
"""Steps at most."""

SETTLED = 0.02
PATIENCE = 2
"""Smaller steps end the rounds, in pixels, RMS over the cameras, and so do so many rounds without
a better prediction of held-out rays."""

FEWEST = 3
"""Views: two agree about nearly everything whatever their cameras."""

COARSE_TILES = 8
"""Along an image's shorter side: pixels of a tile count as one where their residuals agree."""

DARK = 1e-3
"""Share of the brightest coefficient below which a voxel counts as dark and stays so."""


@dataclass(frozen=True, eq=False)
class Refinement:
    """What a refinement found of the cameras, and whether it is used.

    Attributes
    ----------
    given, found : Rig
        Before and after; see `rig` for which of them to use.
    cameras : tuple of str
        Those that were refined; the others are as given.
    parameters : (cameras of the rig, 8) float64
        See `tomo.refine.parameters`; zero for the others.
    prior_pixels : (cameras of the rig,) float64
        The prior's standard deviation in pixels of each part of a camera's parameters.
    moved_pixels : (cameras of the rig,) float64
        How far points of the volume move in each image, RMS.
    error_before, error_after : float
        Relative error of rays held out, predicted from other views.
    rounds : tuple of float
        That error after each judged round.
    accepted : bool
    reason : str
    """

    given: Rig
    found: Rig
    cameras: tuple[str, ...]
    parameters: NDArray[np.float64]
    prior_pixels: NDArray[np.float64]
    moved_pixels: NDArray[np.float64]
    error_before: float
    error_after: float
    rounds: tuple[float, ...]
    accepted: bool
    reason: str

    @property
    def rig(self) -> Rig:
        """The rig to use: that found if it was accepted, else that given."""
        return self.found if self.accepted else self.given

    def __repr__(self) -> str:
        """Name the outcome."""
        return (
            f"<Refinement: {len(self.cameras)} of {len(self.given)} cameras, held-out rays "
            f"{self.error_before:.4f} to {self.error_after:.4f}, accepted {self.accepted}>"
        )

    def report(self) -> dict[str, Any]:
        """Return what a report says of the refinement: plain numbers and words."""
        cameras = {}
        for index, camera in enumerate(self.given):
            if camera.name not in self.cameras:
                continue
            own = self.parameters[index]
            cameras[camera.name] = {
                "prior_pixels": float(self.prior_pixels[index]),
                "moved_pixels": float(self.moved_pixels[index]),
                "position_right_down_forward": own[:3].tolist(),
                "turn_degrees": np.degrees(own[3:6]).tolist(),
                "focal_length_ratio": math.exp(own[FOCAL]),
                "gain": math.exp(own[GAIN]),
            }
        return {
            "accepted": self.accepted,
            "reason": self.reason,
            "held_out_error_before": self.error_before,
            "held_out_error_after": self.error_after,
            "held_out_error_by_round": list(self.rounds),
            "cameras": cameras,
        }


def refine_cameras(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    grid: VoxelGrid,
    *,
    cameras: Sequence[str] | None = None,
    masks: Sequence[NDArray[np.bool_]] | None = None,
    prior_pixels: float | None = None,
    skip: bool = True,
    progress: Progress | None = None,
) -> Refinement:
    """Refine position, turn, focal length and gain of some cameras.

    Parameters
    ----------
    rig : Rig
    images : sequence of (height, width)
        One a camera: only those that the reconstruction may use.
    grid : VoxelGrid
    cameras : sequence of str, optional
        The names of those to refine; all when None. The others stay as they are.
    masks : sequence of (height, width) bool, optional
        True where a pixel is usable.
    prior_pixels : float, optional
        The prior's standard deviation in pixels for every camera; when None that of
        `prior_lengths`: from the rig's calibration.
    skip : bool
        Whether to leave out voxels that dark pixels prove empty.
    progress : callable, optional
        ``progress(done, total, where)``.

    Raises
    ------
    ValueError
        If a name is unknown or that of a table of rays, there are fewer than three views, images
        do not fit the cameras, or the prior is not positive.
    """
    chosen = _chosen(rig, cameras)
    _check(rig, images, masks, prior_pixels)
    masks = [np.isfinite(image) for image in images] if masks is None else list(masks)
    pixels = prior_lengths(rig, grid) if prior_pixels is None else np.full(len(rig), prior_pixels)
    brightest = max(
        float(np.max(i, initial=0, where=m)) for i, m in zip(images, masks, strict=True)
    )
    task = _Task(rig, tuple(images), tuple(masks), grid, chosen, pixels, skip)
    if brightest <= 0:
        return task.refused("the images are dark")
    factor = coarsening(rig, grid, CROSSINGS)
    parameters = best = np.zeros((len(rig), COUNT))
    courses, best_round = [], -1
    try:
        level = task.level(factor)
        before = after = level.judged(parameters)
        for number in range(ROUNDS):
            if progress:
                progress(number, ROUNDS, "refining cameras")
            step = level.step(parameters)
            parameters = parameters + step
            if len(chosen) == len(rig):
                parameters = without_common_motion(rig, grid, parameters, task.lengths)
            found = level.judged(parameters)
            courses.append(found.relative_error)
            if found.squared_errors.sum() < after.squared_errors.sum():
                best, after, best_round = parameters, found, number
            if task.size(step) < SETTLED * factor or number - best_round >= PATIENCE:
                break
    except VolumeNotSeenError:
        return task.refused("the cameras do not see the volume")
    if progress:
        progress(ROUNDS, ROUNDS, "")
    return task.judged(best, before, after, courses)


@dataclass(frozen=True, eq=False)
class _Task:
    """What was asked for."""

    rig: Rig
    images: tuple[NDArray[np.float32], ...]
    masks: tuple[NDArray[np.bool_], ...]
    grid: VoxelGrid
    chosen: tuple[int, ...]
    prior_pixels: NDArray[np.float64]
    skip: bool

    @property
    def lengths(self) -> NDArray[np.float64]:
        """The prior's standard deviations of all parameters, ``(cameras, 8)``."""
        rows = []
        for camera, pixels in zip(self.rig, self.prior_pixels, strict=True):
            sizes = np.r_[np.full(PLACE, pixels), GAIN_PRIOR]
            rows.append(sizes * units(camera, self.grid))
        return np.array(rows)

    def level(self, factor: int) -> _Level:
        """Return images and grid ``factor`` times as coarse."""
        pairs = [shrunk_image(i, m, factor) for i, m in zip(self.images, self.masks, strict=True)]
        rig = replace(self.rig, cameras=tuple(camera.shrunk(factor) for camera in self.rig))
        grid = coarser_grid(self.grid, factor)
        images, masks = [image for image, _ in pairs], [mask for _, mask in pairs]
        held = held_out_tiles([image.shape for image in images])
        trains = [mask & ~own for mask, own in zip(masks, held, strict=True)]
        live = LiveVoxels(grid)
        if self.skip:
            live = carve(tuple(rig), images, trains, grid).live
        return _Level(rig, images, masks, trains, grid, live, self.chosen, self.lengths)

    def size(self, step: NDArray[np.float64]) -> float:
        """Return how far a step moves the volume's image, in pixels, RMS over the cameras."""
        moves = _moves(self.rig, moved_rig(self.rig, step), self.grid)[list(self.chosen)]
        return float(np.sqrt(np.mean(np.square(moves))))

    def judged(
        self,
        parameters: NDArray[np.float64],
        before: Judgement,
        after: Judgement,
        courses: Sequence[float],
    ) -> Refinement:
        errors = before.relative_error, after.relative_error
        accepted = bool(parameters.any()) and before.is_improved_by(after)
        reason = (
            f"held-out rays are predicted from other views to {errors[1]:.4f} instead of "
            f"{errors[0]:.4f}"
            if accepted
            else f"no refined cameras predict held-out rays clearly better than to {errors[0]:.4f}"
        )
        found = moved_rig(self.rig, parameters)
        moves = _moves(self.rig, found, self.grid)
        return self._refinement(found, parameters, moves, *errors, courses, accepted, reason)

    def refused(self, reason: str) -> Refinement:
        still = np.zeros((len(self.rig), COUNT))
        zero = np.zeros(len(self.rig))
        return self._refinement(
            self.rig, still, zero, math.nan, math.nan, (), accepted=False, reason=reason
        )

    def _refinement(
        self, found, parameters, moves, before, after, courses, accepted, reason
    ) -> Refinement:
        return Refinement(
            self.rig,
            found,
            tuple(self.rig.names[view] for view in self.chosen),
            parameters,
            self.prior_pixels,
            moves,
            before,
            after,
            tuple(courses),
            accepted,
            reason,
        )


@dataclass(frozen=True, eq=False)
class _Level:
    """The task with pixels and voxels of one size."""

    rig: Rig
    images: Sequence[NDArray[np.float32]]
    masks: Sequence[NDArray[np.bool_]]
    trains: Sequence[NDArray[np.bool_]]
    grid: VoxelGrid
    live: LiveVoxels
    chosen: tuple[int, ...]
    lengths: NDArray[np.float64]

    def judged(self, parameters: NDArray[np.float64]) -> Judgement:
        rig = moved_rig(self.rig, parameters)
        return judge(rig, self.images, self.masks, self.grid, self.live)

    def step(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the change of the parameters, ``(cameras, 8)``; zero for those not chosen."""
        rig = moved_rig(self.rig, parameters)
        system = LinearSystem.from_rig(rig, self.grid, masks=self.trains, live=self.live)
        projector = system.projector
        counts = np.diff(projector.view_ptr)
        gain = np.repeat(np.exp(parameters[:, GAIN]), counts)
        measured = (system.flatten(self.images) / gain).astype(np.float32)
        volume = first_volume(projector, measured)
        values = volume.values
        predicted = np.asarray(projector @ values, np.float64)
        residual = measured - predicted
        gradient = volume_gradient(self.live.expand(values), self.grid)
        centers = self.grid.centers().reshape(-1, 3)[self.live.mask.ravel()]
        gradient = gradient[self.live.mask.ravel()]
        derivatives, weights, departures = [], [], []
        for view in self.chosen:
            block = projector.view(view)
            span = slice(*projector.view_ptr[view : view + 2])
            place = image_derivatives(lambda f, A=block: A @ f, rig[view], gradient, centers)
            own = np.vstack([place, predicted[span]]) * self.lengths[view][:, None]
            tiles = tiles_of(self.images[view].shape, COARSE_TILES).ravel()[system.pixels[view]]
            derivatives.append(own)
            weights.append(weight_of(own, residual[span], tiles))
            departures.append(parameters[view] / self.lengths[view])
        found = JointStep(
            volume.basis,
            volume.coefficients > DARK * volume.coefficients.max(initial=0.0),
            self.chosen,
            derivatives,
            np.array(weights),
            np.stack(departures),
        ).solve(residual)
        step = np.zeros_like(parameters)
        step[list(self.chosen)] = found * self.lengths[list(self.chosen)]
        return step


def _moves(rig: Rig, other: Rig, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return how far points of the volume move in the images of each camera, RMS: (cameras,)."""
    axes = [np.linspace(-0.5, 0.5, 5)] * 3
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points = np.asarray(grid.center) + places * (np.asarray(grid.shape) * grid.spacing)
    moves = []
    for camera, changed in zip(rig, other, strict=True):
        (here, _, valid), (there, _, still) = camera.project(points), changed.project(points)
        apart = np.sum(np.square(there - here), axis=1)[valid & still]
        moves.append(float(np.sqrt(np.mean(apart))) if len(apart) else math.nan)
    return np.array(moves)


def _chosen(rig: Rig, cameras: Sequence[str] | None) -> tuple[int, ...]:
    """Return the places of the cameras to refine, in the rig's order."""
    if len(rig) < FEWEST:
        raise ValueError(
            f"refine_cameras: found {len(rig)} views to refine with, expected at least {FEWEST}"
        )
    cameras = rig.names if cameras is None else cameras
    for name in cameras:
        if name not in rig.names:
            raise ValueError(
                f"refine_cameras: found camera {name!r}, expected one of {', '.join(rig.names)}"
            )
        if isinstance(rig[name], RayTable):
            raise ValueError(
                f"refine_cameras: camera {name}: found a table of rays, expected a lens model"
            )
    if not cameras:
        raise ValueError("refine_cameras: found no camera, expected at least one")
    return tuple(view for view, name in enumerate(rig.names) if name in cameras)


def _check(
    rig: Rig,
    images: Sequence[NDArray],
    masks: Sequence[NDArray] | None,
    prior_pixels: float | None,
) -> None:
    for what, found in (("images", images), ("masks", masks)):
        if found is not None and len(found) != len(rig):
            raise ValueError(f"{what}: found {len(found)}, expected one for each of {len(rig)}")
    if prior_pixels is not None and not (math.isfinite(prior_pixels) and prior_pixels > 0):
        raise ValueError(f"prior_pixels: found {prior_pixels}, expected pixels above 0")
