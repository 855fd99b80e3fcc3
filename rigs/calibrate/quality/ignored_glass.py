"""Whether residuals look like a pane of glass that nobody mentioned: a test on held-out frames."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import normal_equations, reduced
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.initial import LEAST_VIEWS
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
_KNOWN = 1e-9  # relative eigenvalue below which unknowns are not determined: a target's own pose


@dataclass(frozen=True)
class IgnoredGlass:
    """A pane in front of one camera that its residuals show.

    Panes of index 1.5 between both thicknesses (in the unknowns' unit) and both angles of the
    normal to the axis (degrees) fit about equally, confirmed by ``deviations`` standard deviations
    on other frames. It ``moves`` points by pixels RMS where lens and poses do not follow.
    """

    camera: int
    thickness: tuple[float, float]
    angle: tuple[float, float]
    deviations: float
    moves: float

    def in_words(self, name: str, length_unit: str) -> str:
        """Return a line on it."""
        thickness, angle = _range(self.thickness, ".2g"), _range(self.angle, ".0f")
        pane = f"{thickness} {length_unit} of glass at {angle} degrees"
        how = f"{self.moves:.2g} px, {self.deviations:.2g} standard deviations on held-out frames"
        return (
            f"camera {name}: its residuals look like {pane} between it and the target ({how}): "
            "if there is a window, give it by --scene"
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

    A plate of thickness T and index n moves the apparent point along its normal by ``T (1 - cos a
    / sqrt(n² - sin² a))``, a the angle of the light to the normal. Poses and lens absorb most of
    it; what is left depends on T linearly. For each direction of a grid the score by T is computed
    with all other unknowns eliminated (Rao's test). Every term of the richest lens is among them,
    and so is every point's place on the target: what they explain is not said to be glass. The
    direction that one half of the frames favours is tested on the other half, where its score is
    normal with variance 1 if there is no pane. A pane is named where the mean of both halves
    exceeds the bound of one false alarm in a thousand calibrations.
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
        if min(map(len, own)) < LEAST_VIEWS:
            continue
        rich, free = _with_richest_lens(scene, freedom, camera)
        try:
            first, second = (_panes(rich, half, free, camera, normals) for half in halves)
        except np.linalg.LinAlgError:  # a half may not determine what the whole does
            continue
        tests = [_confirmed(a, b, variance) for a, b in ((first, second), (second, first))]
        deviations = sum(tests) / 2  # of variance 1 at most, however the halves depend
        if deviations < bound:
            continue
        both = _panes(rich, observations, free, camera, normals)
        gain = _gain(both)
        alike = gain > max(gain.max() - _ALIKE * variance, 0)
        thick = both.slope[alike] / both.curve[alike]
        angle = np.degrees(np.arccos(normals[alike, 2]))
        moves = float(np.sqrt(gain.max() / (2 * (observations.camera == camera).sum())))
        if alike.any():
            thickness, tilt = ((float(x.min()), float(x.max())) for x in (thick, angle))
            found.append(IgnoredGlass(camera, thickness, tilt, float(deviations), moves))
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
    shape, place = np.unique(observations.points, axis=0, return_inverse=True)
    first = 3 * len(shape)  # columns of the target's points
    count = first + len(normals)
    crossed, slope = np.zeros((count, freedom.size)), np.zeros(count)
    gram, curve = np.zeros((first, count)), np.zeros(count)
    mixed = np.zeros((len(targets), 6, count))
    for one, rows in camera_rows(observations):
        uv, by_camera, by_target = jacobian(scene, observations, one, rows)
        places, by_camera = freedom.gathered(one, by_camera)
        columns = np.zeros((len(uv), 2, count if one == camera else first))
        turn = scene.target_R[observations.frame[rows]]
        at = 3 * place.ravel()[rows, None, None] + np.arange(3)
        own_point = by_target[:, :, 3:] @ turn  # (n, 2, 3) by the point on the target
        np.put_along_axis(columns, np.broadcast_to(at, own_point.shape), own_point, axis=2)
        if one == camera:
            columns[:, :, first:] = _by_panes(
                scene, observations, one, rows, by_target[:, :, 3:], normals
            )
        flat = columns.reshape(2 * len(uv), -1)
        own = slice(0, flat.shape[1])
        crossed[own, places] += flat.T @ by_camera.reshape(len(flat), -1)
        slope[own] += flat.T @ (observations.uv[rows] - uv).reshape(-1)
        gram[:, own] += flat[:, :first].T @ flat
        curve[own] += (flat**2).sum(axis=0)
        for frame, part in runs(observations.frame[rows]):
            index = int(np.searchsorted(normal.frames, frame))
            both = slice(2 * part.start, 2 * part.stop)
            mixed[index][:, own] += by_target[part].reshape(-1, 6).T @ flat[both]
    raw = curve.copy()
    solved = np.linalg.solve(targets, mixed)  # (frames, 6, columns)
    crossed -= np.einsum("fic,fpi->cp", solved, normal.mixed)
    slope -= np.einsum("fic,fi->c", solved, normal.target_gradient)
    gram -= solved[:, :, :first].reshape(-1, first).T @ mixed.reshape(-1, count)
    curve -= (solved * mixed).sum(axis=(0, 1))
    known = np.block([[matrix, crossed[:first].T], [crossed[:first], gram[:, :first]]])
    side = np.concatenate([crossed[first:].T, gram[:, first:]])  # (known, panes)
    right = np.concatenate([gradient, slope[:first]])
    scale = 1 / np.sqrt(np.maximum(np.diag(known), 1e-300))
    values, vectors = np.linalg.eigh(known * np.outer(scale, scale))
    determined = values > _KNOWN * values[-1]
    root = vectors[:, determined] / np.sqrt(values[determined])
    side, right = root.T @ (side * scale[:, None]), root.T @ (right * scale)
    slope = slope[first:] - side.T @ right
    curve = curve[first:] - (side**2).sum(axis=0)
    return _Panes(slope, np.maximum(curve, 1e-9 * raw[first:]))


def _by_panes(
    scene: Scene,
    observations: ObservationArrays,
    camera: int,
    rows: slice,
    by_world: NDArray[np.float64],
    normals: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the derivatives of pixels by the thickness of panes, ``(n, 2, panes)``."""
    sight = world_points(scene, observations)[rows] - scene.centers()[camera]
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    turned = normals @ scene.camera_R[camera]  # in the world, away from the camera
    cosine = sight @ turned.T  # (n, panes)
    shift = 1 - cosine / np.sqrt(_INDEX**2 - 1 + cosine**2)
    return -np.einsum("nij,kj->nik", by_world, turned) * shift[:, None, :]


def _with_richest_lens(scene: Scene, freedom: Freedom, camera: int) -> tuple[Scene, Freedom]:
    """Return unknowns in which one camera's lens has every term, and all of them are free."""
    lenses, free = list(scene.lenses), list(freedom.lens)
    if lenses[camera].model != "fisheye":
        lenses[camera] = lenses[camera].with_model("tilted")
    free[camera] = np.r_[free[camera][:4], np.ones(lenses[camera].size - 4, bool)]
    return (replace(scene, lenses=tuple(lenses)), replace(freedom, lens=tuple(free), common=None))
