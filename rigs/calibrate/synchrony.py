"""Are cameras in step: the moment of each one's images, from a target that moves in films."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import information, scaled_eigen
from rigs.calibrate.adjust.culling import (
    Culled,
    adjust_and_cull,
    adjust_robustly,
    noise,
    supported,
)
from rigs.calibrate.adjust.film import Film
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, predicted
from rigs.calibrate.quality.covariance import SINGULAR
from rigs.calibrate.quality.quality import image_figures

_CLEAR = 5.0  # standard errors by which an offset exceeds zero before it is applied
_LEAST_OFFSET = 0.02  # pictures; less is not worth a word, and interpolation errs by as much
_FALL = 0.9  # of a camera's noise; where an offset leaves less the residuals showed it
_RISE = 1.05  # of a camera's noise; an offset that leaves more is not believed
_WORTH_SAYING = 0.05  # of a frame, that is left after images are paired anew
_DETERMINED = 0.25  # frames; a larger standard error tells nothing of a camera out of step
_AGREE = 3.0  # standard errors within which two cameras are in step
_SETTLED = 2e-4  # pictures by which offsets change at most once the target's way is settled
_SETTLED_WAY = 0.01  # pixels by which the settled way changes predictions, in all but a few
_ROUGH_WAY = 0.05  # the same to find offsets; a hundredth of a frame is more in films worth it
_MOST = 0.995  # of the observations; at the ends of a run the way of one camera alone is loose
_ITERATIONS = 25  # of finding the way anew; it settles after three to fifteen


@dataclass(frozen=True, eq=False)
class Synchrony:
    """When each camera took its images, by the target's motion.

    Parameters
    ----------
    reference : int
        The camera that offsets count from: the first one that most others are in step with.
    offset : (cameras,) float64
        How many frames later than the reference camera's those of the same number were taken.
    error : (cameras,) float64
        Standard error of ``offset``; 0 for the reference, infinite where it is not determined.
    is_out : (cameras,) bool
        Whether a camera is out of step beyond doubt. Only these offsets are applied.
    whole : (cameras,) float64
        Whole steps of the film by which images were filed under later frames.
    before, after : (cameras,) float64
        Pixel noise of each camera a coordinate with all images taken at once, and with offsets.
    """

    reference: int
    offset: NDArray[np.float64]
    error: NDArray[np.float64]
    is_out: NDArray[np.bool_]
    whole: NDArray[np.float64]
    before: NDArray[np.float64]
    after: NDArray[np.float64]

    @property
    def fraction(self) -> NDArray[np.float64]:
        """How many frames after the frames they are filed under images were taken."""
        applied = np.where(self.is_out, self.offset, 0.0)
        return applied + self.whole[self.reference] - self.whole

    def findings(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return a line on each camera that is out of step: by how much, and what to do."""
        lines = []
        for camera in np.flatnonzero(self.is_out):
            offset, error = float(self.offset[camera]), float(self.error[camera])
            whole = round(offset)
            when = "after" if offset > 0 else "before"
            known = f"± {error:.2g}" if np.isfinite(error) else "the fraction is not determined"
            todo = "trigger the cameras together"
            if whole:
                todo += f", or pair its image n{-whole:+d} with image n of the others in scan.yaml"
                left = abs(offset - whole)
                todo += f"; {left:.2g} of a frame is left then" if left > _WORTH_SAYING else ""
            before, after = self.before[camera], self.after[camera]
            fall = (
                f", and the noise of its residuals falls from {before:.2g} to {after:.2g} px: its "
                "lens is not at fault"
                if after < _FALL * before
                else ""
            )
            lines.append(
                f"camera {names[camera]}: out of step: its images were taken {abs(offset):.4g} "
                f"frames ({known}) {when} those of the same number of {names[self.reference]}. "
                f"This is allowed for here{fall}. For the experiment, {todo}"
            )
        return tuple(lines)

    def in_words(self) -> tuple[str, ...] | None:
        """Return each camera's offset and its error; None where one is not determined."""
        if not (self.error < _DETERMINED).all():
            return None
        return tuple(
            f"out of step by {offset:+.3g} ± {error:.1g} frames, which is allowed for"
            if is_out
            else f"in step, within {offset:+.2f} ± {error:.1g} frames"
            for offset, error, is_out in zip(self.offset, self.error, self.is_out, strict=True)
        )

    def with_fraction(self, fraction: NDArray[np.float64]) -> Synchrony:
        """Return it after offsets were adjusted anew."""
        offset = fraction + self.whole - self.whole[self.reference]
        return replace(self, offset=np.where(self.is_out, offset, self.offset))


def in_step(
    film: Film,
    scene: Scene,
    arrays: ObservationArrays,
    filed: ObservationArrays,
    freedom: Freedom,
    whole: NDArray[np.float64],
) -> Synchrony:
    """Return the offsets in time of all cameras; their errors are infinite where undetermined.

    The moment of each camera's images is one more unknown, the first camera's held; the target's
    way is found anew until offsets settle. ``arrays`` are under the frames of their numbers,
    ``filed`` under those they show if cameras are late by ``whole`` ``(cameras,)``.
    """
    cameras = len(scene.lenses)
    together = adjust_robustly(scene, _known(scene, arrays), freedom, tolerance=1e-3).scene
    before = _noise(together, arrays, cameras)
    timed = replace(freedom, time=np.arange(cameras) > 0)
    start = scene if whole.any() else together
    scene, moved, offset = _settled(film, start, filed, timed, np.zeros(cameras), _ROUGH_WAY)
    kept = adjust_and_cull(scene, moved, timed, cull=True)
    scene, offset = kept.solution.scene, offset + kept.solution.scene.delays
    scene = replace(scene, offset=None)
    moved = film.moved(scene, filed, offset)
    covariance = _covariance(scene, moved, kept.used & np.isfinite(moved.points[:, 0]), timed)
    after = _noise(scene, moved, cameras)
    offset = offset + whole - whole[0]
    if covariance is None:
        infinite = np.where(np.arange(cameras) > 0, np.inf, 0.0)
        return Synchrony(0, offset, infinite, whole != whole[0], whole, before, after)
    variance = np.diag(covariance)
    apart = np.sqrt(variance[:, None] + variance[None] - 2 * covariance)  # (cameras, cameras)
    agree = np.abs(offset[:, None] - offset[None]) <= _AGREE * apart + _LEAST_OFFSET
    reference = int(np.argmax((agree & (apart < film.spacing)).sum(axis=1)))
    offset, error = offset - offset[reference], apart[reference]
    is_out = np.abs(offset) > np.maximum(_CLEAR * error, _LEAST_OFFSET)
    is_out &= after < _RISE * before
    is_out |= np.abs(whole - whole[reference]) > 1.5 * film.spacing
    return Synchrony(reference, offset, error, is_out, whole, before, after)


def adjust_in_step(
    film: Film,
    scene: Scene,
    arrays: ObservationArrays,
    freedom: Freedom,
    cull: bool,
    offset: NDArray[np.float64],
) -> tuple[Culled, ObservationArrays, NDArray[np.float64]]:
    """Return the adjustment with the offsets ``(cameras,)`` that ``freedom`` frees, and these.

    The points in between are where each camera saw them, moved by its offset.
    """
    scene, moved, offset = _settled(film, scene, arrays, freedom, offset, _SETTLED_WAY)
    kept = adjust_and_cull(scene, moved, freedom, cull)
    scene = kept.solution.scene
    settled = replace(scene, offset=np.zeros(len(offset)))
    kept = replace(kept, solution=replace(kept.solution, scene=settled))
    return kept, moved.after(scene.delays), offset + scene.delays


def _settled(
    film: Film,
    scene: Scene,
    arrays: ObservationArrays,
    freedom: Freedom,
    offset: NDArray[np.float64],
    way: float,
) -> tuple[Scene, ObservationArrays, NDArray[np.float64]]:
    """Return scene, moved points and offsets after the target's way and offsets have settled."""
    moved = film.moved(scene, arrays, offset)
    for _ in range(_ITERATIONS):
        scene = replace(scene, offset=np.zeros(len(offset)))
        scene = adjust_robustly(scene, _known(scene, moved), freedom, tolerance=1e-5).scene
        before = predicted(scene, moved)
        # Farther than a frame the way is extrapolated
        step = np.clip(scene.delays, -film.spacing, film.spacing)
        offset = offset + step
        scene = replace(scene, offset=np.zeros(len(offset)))
        moved = film.moved(scene, arrays, offset)
        lengths = np.linalg.norm(predicted(scene, moved) - before, axis=1)
        apart = float(np.nanquantile(lengths, _MOST))
        if np.abs(step).max() < _SETTLED * film.spacing and apart < way:
            break
    return scene, moved, offset


def _known(scene: Scene, arrays: ObservationArrays) -> ObservationArrays:
    """Return the observations that the scene predicts, of frames with enough of them."""
    known = np.asarray(np.isfinite(predicted(scene, arrays)).all(axis=1))
    return arrays.where(supported(arrays, known))


def _noise(scene: Scene, arrays: ObservationArrays, cameras: int) -> NDArray[np.float64]:
    """Return each camera's pixel noise a coordinate."""
    residuals = arrays.uv - predicted(scene, arrays)
    known = np.isfinite(residuals).all(axis=1)
    return noise(residuals[known], arrays.camera[known], cameras)


def _covariance(
    scene: Scene, arrays: ObservationArrays, used: NDArray[np.bool_], freedom: Freedom
) -> NDArray[np.float64] | None:
    """Return the covariance of all cameras' offsets, zero for the first; None if singular."""
    matrix, _ = information(scene, arrays.where(used), freedom)
    residuals = (arrays.uv - predicted(scene, arrays))[used]
    unknowns = len(matrix) + 6 * len(np.unique(arrays.frame[used]))
    scale, values, vectors = scaled_eigen(matrix)
    if residuals.size <= unknowns or values[0] < SINGULAR * values[-1]:
        return None
    variance = float((residuals**2).sum()) / (residuals.size - unknowns)
    variance *= image_figures(scene, arrays, used, freedom)[3]
    inverse = variance * (vectors / values) @ vectors.T * np.outer(scale, scale)
    covariance = np.zeros((len(scene.lenses),) * 2)
    places = [int(place[-1]) for place in freedom.places[1:]]
    covariance[1:, 1:] = inverse[np.ix_(places, places)]
    return covariance
