"""A target that moves smoothly through films: where it was between two pictures.

The target's pose at any moment follows from cubic splines through its poses, run by run of
pictures without a gap. A camera that is out of step by some pictures sees the target there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, image_rows

_LEAST_RUN = 5  # pictures; fewer say little of a curve's ends
_GAP = 1.5  # pictures from one pose to the next; across a longer gap a cubic errs by pixels
_LONGEST_GAP = 4.5  # pictures; a longer gap ends a run
_JUMP_KNOTS = 3.0  # pictures from knot to knot of the spline that poses may jump from
_JUMP = 10.0  # times the usual distance from it; hand-held targets had 6 at most
_FEW = 0.2  # of a run's poses; more that seem to jump are a way that the spline cannot follow
_REWEIGHTED = 8  # times, of which the last changes little
_SMOOTH = 0.4  # error of a cubic prediction over a step; stills held in any pose have 2 and more
_LEAST_STEP = 0.2  # pixels from picture to picture; less shows no moment
_KNOTS = (1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)  # pictures from knot to knot that are tried
LEAST_PICTURES = 8  # that agree with a film's motion; fewer do by chance


def frame_times(frames: Sequence[str]) -> dict[str, float] | None:
    """Return the number at the end of each frame's name, None where names are not numbered alike.

    Examples
    --------
    >>> frame_times(["shot_08", "shot_09", "shot_10"])
    {'shot_08': 8.0, 'shot_09': 9.0, 'shot_10': 10.0}
    """
    matches = (re.fullmatch(r"(.*?)(\d{1,15})", name) for name in frames)
    parts = [match for match in matches if match is not None]
    if not parts or len(parts) < len(frames) or len({part[1] for part in parts}) > 1:
        return None
    times = {name: float(part[2]) for name, part in zip(frames, parts, strict=True)}
    return times if len(set(times.values())) == len(times) else None


@dataclass(frozen=True, eq=False)
class Film:
    """The moments of frames, counted in pictures."""

    times: NDArray[np.float64]  # (frames,); NaN where a frame is no picture of the films
    spacing: float  # from one picture used to the next

    @classmethod
    def of(cls, times: NDArray[np.float64], observations: ObservationArrays) -> Film | None:
        """Return the film, None where the target does not move smoothly from frame to frame.

        Each point's pixel is predicted by a cubic through its two neighbours before and after.
        """
        seen = np.unique(observations.frame)
        known = np.unique(times[seen][np.isfinite(times[seen])])
        if len(known) < _LEAST_RUN:
            return None
        film = cls(times, float(np.median(np.diff(known))))
        off, step = film._unevenness(observations)
        if len(step) < LEAST_PICTURES:
            return None
        moved = float(np.median(step))
        is_smooth = float(np.median(off)) < _SMOOTH * moved
        return film if is_smooth and moved > _LEAST_STEP * film.spacing else None

    def _unevenness(self, observations: ObservationArrays) -> tuple[NDArray, NDArray]:
        """Return each picture's median error of prediction and its median step, pixels."""
        images: dict[int, dict[float, dict[bytes, NDArray]]] = {}
        for camera, frame, rows in image_rows(observations):
            if np.isfinite(self.times[frame]):
                keys = (point.tobytes() for point in observations.points[rows])
                shown = dict(zip(keys, observations.uv[rows], strict=True))
                images.setdefault(camera, {})[self.times[frame]] = shown
        off, step = [], []
        for own in images.values():
            for time in own:
                near = (own.get(time + k * self.spacing) for k in range(-2, 3))
                five = [one for one in near if one is not None]
                if len(five) < 5:
                    continue
                shared = set.intersection(*(set(one) for one in five))
                if shared:
                    a, b, c, d, e = (np.array([one[key] for key in shared]) for one in five)
                    predicted = (4 * (b + d) - a - e) / 6
                    off.append(np.median(np.linalg.norm(c - predicted, axis=1)))
                    step.append(np.median(np.linalg.norm(d - b, axis=1)) / 2)
        return np.array(off), np.array(step)

    def partners(self, delay: float) -> NDArray[np.int64]:
        """Return for each frame the one taken ``delay`` pictures before it, -1 without.

        A frame that is no picture of the films is its own.
        """
        order = np.argsort(self.times)  # NaN last
        sorted_times = self.times[order]
        at = np.searchsorted(sorted_times, self.times - delay - 0.5 * self.spacing)
        at = np.minimum(at, len(order) - 1)
        near = np.abs(sorted_times[at] - (self.times - delay)) <= 0.5 * self.spacing
        own = np.where(np.isnan(self.times), np.arange(len(order)), -1)
        return np.where(near, order[at], own)

    def filed(
        self, observations: ObservationArrays, delay: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], ObservationArrays]:
        """Return the observations under the frames whose moments they show, and their rows.

        Each camera is late by ``delay`` ``(cameras,)`` pictures; rows of no moment are left out.
        """
        frame = observations.frame.copy()
        for camera in np.flatnonzero(delay):
            own = observations.camera == camera
            frame[own] = self.partners(-float(delay[camera]))[frame[own]]
        rows = np.lexsort((frame, observations.camera))
        rows = rows[frame[rows] >= 0]
        return rows, replace(observations.where(rows), frame=frame[rows])

    def moved(
        self, scene: Scene, observations: ObservationArrays, offset: NDArray[np.float64]
    ) -> ObservationArrays:
        """Return the observations of points that moved until their camera took the picture.

        With the target's way R(s), t(s) the point x of a frame taken at f has moved by ``R(f).T
        (R(s) x + t(s) - R(f) x - t(f))``, with ``s = f + offset`` in pictures. The way is a spline
        of least squares: the noise of single poses would draw moments towards frames. Velocities
        are a picture's; points are NaN where the way is not known.
        """
        poses = np.concatenate([scene.target_R, scene.target_t[:, :, None]], axis=2)  # (F, 3, 4)
        late = offset[observations.camera]
        frames = observations.frame
        times = self.times[frames] + late
        with_one = np.c_[observations.points, np.ones(len(late))]  # (N, 4)
        shift, speed = np.full((2, len(late), 3), np.nan)
        for run in self._runs(scene):
            way, known, gap = _way(self.times[run], poses[run], self.spacing)
            inside = np.isin(frames, run)
            at = np.searchsorted(known, times)
            inside &= (at > 0) & (at < len(known)) | np.isin(times, known)
            at = np.clip(at, 1, len(known) - 1)
            inside &= (known[at] - known[at - 1] <= gap) | np.isin(times, known)
            change = way(times[inside]) - way(self.times[frames[inside]])
            for into, pose in ((shift, change), (speed, way(times[inside], 1))):
                into[inside] = np.einsum("nij,nj->ni", pose, with_one[inside])
        back = scene.target_R[frames].transpose(0, 2, 1)
        shift, velocity = ((back @ each[:, :, None])[:, :, 0] for each in (shift, speed))
        velocity = np.where(np.isfinite(velocity), velocity, 0.0)
        is_still = (late == 0) | np.isnan(times)
        points = observations.points + np.where(is_still[:, None], 0.0, shift)
        return replace(observations, points=points, velocity=velocity)

    def _runs(self, scene: Scene) -> list[NDArray[np.int64]]:
        """Return the frames of each run, in order of time, that has enough poses."""
        posed = np.flatnonzero(np.isfinite(scene.target_t[:, 0]) & np.isfinite(self.times))
        posed = posed[np.argsort(self.times[posed])]
        breaks = np.flatnonzero(np.diff(self.times[posed]) > _LONGEST_GAP * self.spacing) + 1
        return [run for run in np.split(posed, breaks) if len(run) >= _LEAST_RUN]


def _way(
    times: NDArray[np.float64], poses: NDArray[np.float64], spacing: float
) -> tuple[Callable[..., NDArray[np.float64]], NDArray[np.float64], float]:
    """Return the cubic spline through a run's poses ``(n, 3, 4)``, their moments, its longest gap.

    Its knots are as far apart as generalised cross-validation likes best (Craven and Wahba 1979);
    where that is the closest distance it goes through every pose. Poses that jump are left out.
    """
    from scipy.interpolate import CubicSpline

    kept = ~_jumps(times, poses, spacing)
    times, poses = times[kept], poses[kept]
    best, least, gap = None, np.inf, _GAP * spacing
    for distance in _KNOTS:
        way, unknowns = _least_squares(times, poses, distance * spacing)
        spare = len(times) - unknowns
        if way is None or spare < 1:
            continue
        score = float(((way(times) - poses) ** 2).sum()) / spare**2
        if score < least:
            best, least = (None if distance == _KNOTS[0] else way), score
            gap = max(_GAP, distance - 1) * spacing
    return (CubicSpline(times, poses) if best is None else best), times, gap


def _jumps(
    times: NDArray[np.float64], poses: NDArray[np.float64], spacing: float
) -> NDArray[np.bool_]:
    """Return which poses are far from a spline of least absolute deviations, a few at most."""
    weights = np.ones(len(times))
    for _ in range(_REWEIGHTED):
        way, _ = _least_squares(times, poses, _JUMP_KNOTS * spacing, weights)
        if way is None:
            return np.zeros(len(times), bool)
        off = np.sqrt(((way(times) - poses) ** 2).sum(axis=(1, 2)))
        usual = max(float(np.median(off)), 1e-12)
        weights = 1 / np.sqrt(np.maximum(off, usual))
    jumps = off > _JUMP * usual
    return jumps if jumps.mean() <= _FEW else np.zeros(len(times), bool)


def _least_squares(
    times: NDArray[np.float64],
    poses: NDArray[np.float64],
    distance: float,
    weights: NDArray[np.float64] | None = None,
) -> tuple[Callable[..., NDArray[np.float64]] | None, int]:
    """Return a spline with knots so far apart, and its number of coefficients; None if too few."""
    from scipy.interpolate import make_lsq_spline

    pieces = max(int((times[-1] - times[0]) / distance), 1)
    inner = np.linspace(times[0], times[-1], pieces + 1)[1:-1]
    knots = np.r_[[times[0]] * 4, inner, [times[-1]] * 4]
    unknowns = len(knots) - 4
    # Each coefficient needs a pose between its knots (Schoenberg and Whitney)
    at = np.searchsorted(times, knots[:-4], side="right")
    if unknowns > len(times) or (times[np.minimum(at, len(times) - 1)] >= knots[4:])[1:-1].any():
        return None, unknowns
    try:
        return make_lsq_spline(times, poses, knots, k=3, w=weights), unknowns
    except (ValueError, np.linalg.LinAlgError):
        return None, unknowns
