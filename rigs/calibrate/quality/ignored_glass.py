"""Whether residuals look like a pane of glass that nobody mentioned: a test on held-out frames."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import information, normal_equations, reduced
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.joint_terms import fall_of_squares
from rigs.calibrate.adjust.observation_arrays import (
    ObservationArrays,
    Scene,
    camera_rows,
    jacobian,
    predicted,
    runs,
    world_points,
)

_INDEX = 1.5  # of the pane that is assumed: residuals show its thickness times a factor of it
_ANGLES, _TURNS = np.radians(np.arange(5, 65, 5)), np.radians(np.arange(0, 360, 15))
_FALSE_ALARMS = 1e-3  # calibrations in which chance alone names a pane
_ALIKE = 3.5  # variances that squares rise within one standard deviation of three numbers
_NUMBERS = 3  # of a pane: two of its direction, and its thickness
_LEAST_FRAMES = 6  # of a camera: three in each half determine its pose


@dataclass(frozen=True)
class IgnoredGlass:
    """A pane in front of one camera that its residuals show.

    Parameters
    ----------
    camera : int
    thickness : (float, float)
        Least and most of panes of index 1.5 that explain them about equally, in the unit of the
        unknowns.
    angle : (float, float)
        Between their normals and the camera's axis, degrees.
    deviations : float
        By how many standard deviations it is confirmed on the frames that it was not found on.
    """

    camera: int
    thickness: tuple[float, float]
    angle: tuple[float, float]
    deviations: float

    def in_words(self, name: str, length_unit: str) -> str:
        """Return a line on it."""
        thickness, angle = _range(self.thickness, ".2g"), _range(self.angle, ".0f")
        return (
            f"camera {name}: its residuals look like {thickness} {length_unit} of glass at {angle} "
            f"degrees between it and the target ({self.deviations:.2g} standard deviations, on "
            "frames held out): if there is a window, give it by --scene"
        )


@dataclass(frozen=True)
class _Panes:
    """One camera's candidate panes in the normal equations, all other unknowns eliminated."""

    slope: NDArray[np.float64]  # (panes,) gradient of half the squares by thickness
    curve: NDArray[np.float64]  # (panes,)


def ignored_glass(
    scene: Scene, observations: ObservationArrays, freedom: Freedom
) -> tuple[IgnoredGlass, ...]:
    """Return panes of glass that explain residuals, on frames that they were not found on.

    Parameters
    ----------
    scene : Scene
        Adjusted, without a scene to look through.
    observations : ObservationArrays
        Without outliers, in order of camera, then frame.
    freedom : Freedom

    Notes
    -----
    A plate of thickness T and index n moves the apparent point along its normal by
    ``T (1 - cos a / sqrt(n² - sin² a))``, a the angle of the light to the normal. Poses and lens
    absorb most of it; what is left depends on T linearly. For each direction of a grid the score
    by T is computed with all other unknowns eliminated (Rao's test). The direction that one half
    of the frames favours is tested on the other half, where its score is normal with variance 1 if
    there is no pane. A pane is named where both halves together exceed the bound of one false
    alarm in a thousand calibrations, and it lowers the squares by more than all terms of the
    richest lens, each counted by Akaike's criterion: else the lens is the likelier cause.
    """
    from scipy.stats import norm

    residuals = observations.uv - predicted(scene, observations)
    unknowns = freedom.size + 6 * len(np.unique(observations.frame))
    spare = residuals.size - unknowns
    if spare <= 0:
        return ()
    variance = float((residuals**2).sum()) / spare
    frames = np.unique(observations.frame)
    halves = [observations.where(np.isin(observations.frame, frames[k::2])) for k in range(2)]
    normals = _directions()
    bound, found = norm.isf(_FALSE_ALARMS / len(scene.lenses)), []
    for camera in range(len(scene.lenses)):
        own = [np.unique(half.frame[half.camera == camera]) for half in halves]
        if min(map(len, own)) < _LEAST_FRAMES // 2:
            continue
        try:
            first, second = (_panes(scene, half, freedom, camera, normals) for half in halves)
            both = _panes(scene, observations, freedom, camera, normals)
        except np.linalg.LinAlgError:  # a half may not determine what the whole does
            continue
        tests = [_confirmed(a, b, variance) for a, b in ((first, second), (second, first))]
        deviations = sum(tests) / np.sqrt(2)
        best = int(_gain(both).argmax())
        thickness = both.slope[best] / both.curve[best]
        if deviations < bound or not thickness > 0:
            continue
        gain = _gain(both)[best] - 2 * _NUMBERS * variance
        if gain > _gain_of_lens(scene, observations, freedom, camera, variance):
            alike = _gain(both) > _gain(both)[best] - _ALIKE * variance
            thick = both.slope[alike] / both.curve[alike]
            angle = np.degrees(np.arccos(normals[alike, 2]))
            ranges = ((float(x.min()), float(x.max())) for x in (thick, angle))
            found.append(IgnoredGlass(camera, *ranges, float(deviations)))
    return tuple(found)


def _range(ends: tuple[float, float], how: str) -> str:
    """Return a range of numbers, one number where both ends are written alike."""
    low, high = (format(end, how) for end in ends)
    return low if low == high else f"{low} to {high}"


def _directions() -> NDArray[np.float64]:
    """Return normals in a camera's axes, ``(panes, 3)``: along its axis and round it."""
    angle, turn = (grid.ravel() for grid in np.meshgrid(_ANGLES, _TURNS))
    across = np.sin(angle)
    tilted = np.stack([across * np.cos(turn), across * np.sin(turn), np.cos(angle)], axis=1)
    return np.concatenate([[[0.0, 0.0, 1.0]], tilted])


def _gain(panes: _Panes) -> NDArray[np.float64]:
    """Return the fall of the sum of squares by each pane; 0 where its thickness is negative."""
    curve = np.maximum(panes.curve, 1e-300)
    return np.where(panes.slope > 0, panes.slope**2 / curve, 0.0)


def _confirmed(one: _Panes, other: _Panes, variance: float) -> float:
    """Return the score, in standard deviations, that one half's best pane has on the other."""
    best = int(_gain(one).argmax())
    return float(other.slope[best] / np.sqrt(max(variance * other.curve[best], 1e-300)))


def _panes(
    scene: Scene,
    observations: ObservationArrays,
    freedom: Freedom,
    camera: int,
    normals: NDArray[np.float64],
) -> _Panes:
    """Return the panes in front of one camera, in the normal equations of some frames."""
    normal = normal_equations(scene, observations, freedom)
    matrix, gradient, targets = reduced(normal, 0.0)
    rows = dict(camera_rows(observations))[camera]
    uv, by_camera, by_target = jacobian(scene, observations, camera, rows)
    places, by_camera = freedom.gathered(camera, by_camera)
    residual = (observations.uv[rows] - uv).reshape(-1)
    sight = world_points(scene, observations)[rows] - scene.centers()[camera]
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    turned = normals @ scene.camera_R[camera]  # in the world, away from the camera
    cosine = sight @ turned.T  # (n, panes)
    shift = 1 - cosine / np.sqrt(_INDEX**2 - 1 + cosine**2)
    columns = -np.einsum("nij,kj->nik", by_target[:, :, 3:], turned) * shift[:, None, :]
    columns = columns.reshape(len(residual), -1)  # (2 n, panes)
    flat = by_camera.reshape(len(residual), -1)
    crossed = np.zeros((len(normals), freedom.size))
    crossed[:, places] = columns.T @ flat
    slope, curve = columns.T @ residual, (columns**2).sum(axis=0)
    for frame, part in runs(observations.frame[rows]):
        index = int(np.searchsorted(normal.frames, frame))
        own = slice(2 * part.start, 2 * part.stop)
        mixed = columns[own].T @ by_target[part].reshape(-1, 6)  # (panes, 6)
        solved = np.linalg.solve(targets[index], mixed.T).T
        crossed -= solved @ normal.mixed[index].T
        slope -= solved @ normal.target_gradient[index]
        curve -= (solved * mixed).sum(axis=1)
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = (crossed * scale).T
    solved = np.linalg.solve(matrix * np.outer(scale, scale), np.c_[scaled, gradient * scale])
    slope = slope - scaled.T @ solved[:, -1]
    curve = curve - (scaled * solved[:, :-1]).sum(axis=0)
    return _Panes(slope, np.maximum(curve, 1e-9 * (columns**2).sum(axis=0)))


def _gain_of_lens(
    scene: Scene,
    observations: ObservationArrays,
    freedom: Freedom,
    camera: int,
    variance: float,
) -> float:
    """Return the fall of the squares, less Akaike's charge, by all terms of the richest lens."""
    lenses, free = list(scene.lenses), list(freedom.lens)
    if lenses[camera].model == "fisheye":
        wide = np.ones(lenses[camera].size, bool)
    else:
        lenses[camera] = lenses[camera].with_model("tilted")
        wide = np.r_[free[camera], np.ones(lenses[camera].size - len(free[camera]), bool)]
        wide[4:] = True
    free[camera] = wide
    every = replace(freedom, lens=tuple(free), common=None)
    matrix, gradient = information(replace(scene, lenses=tuple(lenses)), observations, every)
    before = every.freed_in(freedom)
    added = int((~before).sum())
    if not added:
        return 0.0
    whole = np.ones(every.size, bool)
    gain = fall_of_squares(matrix, gradient, whole) - fall_of_squares(matrix, gradient, before)
    return gain - 2 * added * variance
