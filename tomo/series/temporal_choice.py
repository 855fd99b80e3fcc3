"""How much neighbouring frames say of a frame, by predicting a view left out of all of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.grid import ActiveVoxels
from tomo.grid.blur import Blur
from tomo.operators.operator import ProjectionOperator
from tomo.pipeline.build import WeightedSystem
from tomo.selection.folds import Fold, surely_lower
from tomo.series.temporal import REACH, SPLIT, TemporalFilter, growth, moved, neighbours

WINDOW = 2 * REACH + 3
"""Frames of a window: three of them have all their neighbours, and are predicted."""

STILL = TemporalFilter.velocity

PAYS = 0.02
"""Least relative gain in predicting left-out views. Filtering takes half as long again, and gains
below this did not carry over: on a real plume 0.3 to 0.7 % here were -0.05 dB in another view."""

ODD = 1.25
"""Growth of a frame's residual, over the largest in the windows, from which on the frame is unlike
its neighbours. Less leaves ordinary frames as they are, more lets light of neighbours in."""

_STEPS = 3
"""Steps of Gauss and Newton that find the velocity: more change it by less than a thousandth."""


@dataclass(frozen=True, eq=False)
class Window:
    """Frames one after the other, solved without a view that is left out of all of them.

    What is wrong with a camera in every frame would be predicted by the neighbours otherwise. Left
    out pixels of all views do not suffice: on a real plume means over frames predicted them
    better, and another view worse. Values are by place; solutions are ``(unknowns,)``.
    """

    fold: Fold
    solutions: Mapping[int, NDArray[np.float32]]
    left_out: Mapping[int, WeightedSystem]
    seen: Mapping[int, WeightedSystem]

    @property
    def active(self) -> ActiveVoxels:
        """The voxels of the unknowns."""
        return self.fold.left_out.active

    @property
    def predicted(self) -> list[int]:
        """Places of the frames with all neighbours; all where none has them."""
        places = sorted(self.solutions)
        return places[REACH:-REACH] or places

    def columns(self, velocity: ArrayLike) -> NDArray[np.float64]:
        """Return what each weight of a filter, the coarse first, adds to the predicted pixels.

        ``(predicted frames, pixels, 2 (REACH + 1))``, times the roots of weights, as `targets`
        are.
        """
        project, blur = self.fold.left_out, Blur(self.active, SPLIT)
        found = []
        for place in self.predicted:
            own = neighbours(self.active, self.solutions, place, REACH, velocity)
            coarse = [blur(one) for one in own]
            fine = [one - low for one, low in zip(own, coarse, strict=True)]
            pixels = np.stack([project @ one for one in (*coarse, *fine)], axis=1)
            found.append(self._root(place)[:, None] * pixels)
        return np.array(found, np.float64)

    @property
    def targets(self) -> NDArray[np.float64]:
        """The pixels to predict, ``(predicted frames, pixels)``."""
        pixels = {place: self.left_out[place].measured for place in self.predicted}
        return np.array([self._root(place) * one for place, one in pixels.items()])

    def growths(self, by: TemporalFilter) -> list[float]:
        """Return how many times a filter lets the residual of each predicted frame grow."""
        return [
            growth(
                self.seen[place],
                self.solutions[place],
                by.apply(self.active, self.solutions, place),
            )
            for place in self.predicted
        ]

    def _root(self, place: int) -> NDArray[np.float32]:
        one = self.left_out[place]
        return np.ones_like(one.measured) if one.weights is None else one.weights**0.5

    def errors(self, misfit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the squared errors of the left-out blocks of every predicted frame."""
        blocks = self.fold.blocks
        return np.concatenate([np.bincount(blocks, one**2) for one in misfit])


@dataclass(frozen=True)
class TemporalChoice:
    """Whether and how frames are filtered in time, and why."""

    filter: TemporalFilter | None
    reason: str
    held_out_residual: float = math.nan  # relative, of left-out pixels, by the filter
    alone: float = math.nan  # by frames for themselves; NaN: not compared

    def report(self) -> dict[str, object]:
        """Return it as plain numbers and words."""
        return {
            "filter": self.filter and self.filter.report(),
            "held_out_residual": self.held_out_residual,
            "held_out_residual_alone": self.alone,
            "reason": self.reason,
        }


def leave_out(
    view: int, projector: ProjectionOperator, blocks: NDArray[np.int64]
) -> tuple[Fold, NDArray[np.bool_]]:
    """Return a fold of a view, its pixels zero, and which pixels it leaves out."""
    held = np.zeros(projector.shape[0], bool)
    held[projector.view_ptr[view] : projector.view_ptr[view + 1]] = True
    held &= projector.row_sums > 0
    dark = np.zeros(projector.shape[0], np.float32)
    return Fold.leaving_out(held, projector, dark, None, blocks), held


def choose_filter(windows: Sequence[Window]) -> TemporalChoice:
    """Choose the weights of neighbouring frames by least squares on the left-out views.

    Weights are linear in the predicted pixels: ``min_c Σ w (b - Σ_j c_j (A F_j))²`` over all
    windows, with the mean motion (`velocity_of`) unless left-out views are surely predicted better
    without it. Each window is predicted by the weights of the others. Frames are filtered where
    that is better, by more than chance (`surely_lower`) and by `PAYS`, than the frame as it is and
    than the best weights of the frame alone: neighbours have to pay, not the sharpening that one
    frame's weights can do too.
    """
    targets = [one.targets for one in windows]
    light = sum(float(np.sum(each**2)) for each in targets)
    if not light > 0:
        return TemporalChoice(None, "the frames are dark")
    still = [one.columns(STILL) for one in windows]
    own = [each[..., [0, REACH + 1]] for each in still]
    alone = _errors(windows, [t - each.sum(axis=-1) for t, each in zip(targets, own, strict=True)])
    weighted = _predicted(windows, targets, own)
    velocity, columns, errors = STILL, still, _predicted(windows, targets, still)
    motion = velocity_of(windows)
    if max(map(abs, motion)) * REACH > 0.1:
        carried = [one.columns(motion) for one in windows]
        moving = _predicted(windows, targets, carried)
        if not surely_lower(errors, moving):  # noisy pixels tell motion less well than volumes do
            velocity, columns, errors = motion, carried, moving
    figures = {
        "held_out_residual": math.sqrt(float(errors.sum()) / light),
        "alone": math.sqrt(float(alone.sum()) / light),
    }
    words = f"relative residual {figures['held_out_residual']:.4f}, {figures['alone']:.4f} alone"
    sure = surely_lower(errors, alone) and surely_lower(errors, weighted)
    if not sure or figures["held_out_residual"] > (1 - PAYS) * figures["alone"]:
        reason = f"neighbours predict left-out views no better ({words})"
        return TemporalChoice(None, reason, **figures)
    weights = _fitted(targets, columns).tolist()
    found = TemporalFilter(tuple(weights[: REACH + 1]), tuple(weights[REACH + 1 :]), velocity)
    most = ODD * max(one for window in windows for one in window.growths(found))
    found = replace(found, most=most)
    return TemporalChoice(found, f"neighbours predict left-out views ({words})", **figures)


def velocity_of(windows: Sequence[Window]) -> tuple[float, float, float]:
    """Return the mean motion of the structures from one frame to the next, in voxels.

    The ``v`` of least ``Σ (x_(t+1) - x_t(. - v))²`` over all voxels and frames, by Gauss and
    Newton's method from 0, on volumes blurred by `SPLIT` (Lucas and Kanade, "An iterative image
    registration technique with an application to stereo vision", IJCAI 1981).
    """
    velocity, grid = np.zeros(3), windows[0].active.grid
    if min(grid.shape) < 2:
        return STILL
    for _ in range(_STEPS):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        for window in windows:
            active, places = window.active, sorted(window.solutions)
            blur = Blur(active, SPLIT)
            smooth = [blur(window.solutions[place]) for place in places]
            for (at, one), (after, other) in itertools.pairwise(zip(places, smooth, strict=True)):
                if after != at + 1:
                    continue
                carried = moved(active, one, velocity)
                middle = active.expand((carried + other) / 2).reshape(grid.shape)
                slopes = np.array(np.gradient(middle), np.float64).reshape(3, -1)
                normal += slopes @ slopes.T
                right += slopes @ active.expand(carried - other).astype(np.float64)
        if not np.trace(normal) > 0:
            return STILL
        velocity += np.linalg.lstsq(normal, right, rcond=None)[0]
    x, y, z = velocity.tolist()
    return x, y, z


def _fitted(
    targets: Sequence[NDArray[np.float64]], columns: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return the weights of least squares over some windows, falling with distance, >= 0.

    Coarse and fine ones are a mixture of means over the frame and its ``j`` neighbours on either
    side, ``a_k = Σ_(j >= k) e_j`` with ``e >= 0``: free weights would fit the noise of few pixels.
    Their sum is free: with less noise less has to be smoothed.
    """
    from scipy.optimize import nnls  # slow to import

    count = columns[0].shape[-1] // 2
    matrix = np.concatenate([one.reshape(-1, 2, count) for one in columns])
    sums = np.cumsum(matrix, axis=-1).reshape(len(matrix), -1)
    both = np.column_stack([sums, np.concatenate(targets, axis=None)])
    root = np.asarray(np.linalg.qr(both, mode="r"))  # numpy's stubs take it for a pair
    found = nnls(root[:, :-1], root[:, -1])[0].reshape(2, count)
    return np.cumsum(found[:, ::-1], axis=1)[:, ::-1].ravel()


def _predicted(
    windows: Sequence[Window],
    targets: Sequence[NDArray[np.float64]],
    columns: Sequence[NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Return the errors of each window by the weights of the others; its own if it is alone."""
    misfits = []
    for number in range(len(windows)):
        others = [k for k in range(len(windows)) if k != number] or [number]
        weights = _fitted([targets[k] for k in others], [columns[k] for k in others])
        misfits.append(targets[number] - columns[number] @ weights)
    return _errors(windows, misfits)


def _errors(
    windows: Sequence[Window], misfits: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]:
    both = zip(windows, misfits, strict=True)
    return np.concatenate([window.errors(misfit) for window, misfit in both])
