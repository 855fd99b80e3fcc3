"""A refractive index in a box: what any field of it says, and rays through it, slow and exact."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.scene.gas.spline_steps import CHORD


@dataclass(frozen=True, eq=False)
class Crossing:
    """The ways of rays through a box of gas; ray ``r`` owns the pieces ``ptr[r]:ptr[r + 1]``.

    Attributes
    ----------
    origins, directions, lengths : (P, 3), (P, 3), (P,) float64
        Where each piece begins, from the entry into the box or the start inside, its unit vector.
    ptr : (rays + 1,) int64
        A ray that misses the box has no piece.
    exit_origins, exit_directions : (rays, 3) float64
        Where a ray leaves the box, and along what; as it came where it misses the box.
    trapped : (rays,) bool
        Whether a ray was given up inside, after more steps than any way through takes.
    """

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]
    lengths: NDArray[np.float64]
    ptr: NDArray[np.int64]
    exit_origins: NDArray[np.float64]
    exit_directions: NDArray[np.float64]
    trapped: NDArray[np.bool_]

    def __len__(self) -> int:
        """Return the number of pieces."""
        return len(self.lengths)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<Crossing: {len(self.ptr) - 1} rays, {len(self)} pieces>"


def pairs_of_vectors(
    origins: ArrayLike, directions: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return origins and unit directions of rays, ``(rays, 3)`` each, finite and none zero."""
    origins, directions = (
        np.ascontiguousarray(np.atleast_2d(np.asarray(one, np.float64)))
        for one in (origins, directions)
    )
    if origins.shape != directions.shape or origins.shape[1:] != (3,):
        raise ValueError(
            f"rays: found origins {origins.shape} and directions {directions.shape}, expected "
            "(rays, 3) twice"
        )
    norms = np.linalg.norm(directions, axis=1, keepdims=True)
    if not (np.isfinite(origins).all() and np.isfinite(norms).all() and (norms > 0).all()):
        raise ValueError("rays: found NaN, infinity or a zero direction, expected finite rays")
    return origins, directions / norms


def chords(
    nodes: NDArray[np.float64], tangents: NDArray[np.float64], tolerance: float
) -> NDArray[np.int64]:
    """Return the numbers of the nodes at which pieces of a path end, both ends included.

    ``nodes, tangents`` ``(N, 3)``: points along the path and its unit vectors there; the path is
    within ``tolerance`` of its pieces. A path of length ``S`` whose direction turns by ``a``
    altogether is nowhere farther than ``S a / 4`` from the chord of its ends.
    """
    ends, length, turn = [0], 0.0, 0.0
    steps = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    turns = np.linalg.norm(np.diff(tangents, axis=0), axis=1)
    for node, (step, angle) in enumerate(zip(steps, turns, strict=True)):
        if length > 0 and CHORD * (length + step) * (turn + angle) > tolerance:
            ends.append(node)
            length = turn = 0.0
        length, turn = length + step, turn + angle
    return np.array([*ends, len(steps)])


RELATIVE, ABSOLUTE = 1e-12, 1e-14
"""Tolerances of a step: relative, and in sides of the box: a hundred steps stay below 1e-10."""

STEPS = 20
"""Steps at least along the box's shortest side: longer ones step over what they should see."""

TOUCH = 1e-12
"""Sides of the box that a ray has to run through it: one that has just left is on its face only to
rounding."""

NODES = 16
"""Points of a path for each step of the solver: chords end at some of them."""


class IndexField(ABC):
    """A refractive index in a box; that of the medium at the box's faces and beyond.

    Light passes the faces without being bent, since the index is continuous there.

    Attributes
    ----------
    lower, upper : (3,) float64
        The box's corners.
    """

    if TYPE_CHECKING:  # attributes or properties: a field says which

        @property
        def lower(self) -> NDArray[np.float64]:
            """The box's lower corner, ``(3,)``."""

        @property
        def upper(self) -> NDArray[np.float64]:
            """The box's upper corner, ``(3,)``."""

    @abstractmethod
    def index(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the refractive index at points ``(N, 3)``, ``(N,)``."""

    @abstractmethod
    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the gradient of the index at points ``(N, 3)``, ``(N, 3)``, in 1 / length."""

    def warnings(self) -> tuple[str, ...]:
        """Return lines on what makes the field doubtful."""
        return ()

    def cross(
        self, origins: ArrayLike, directions: ArrayLike, tolerance: float | None = None
    ) -> Crossing:
        """Return the ways of rays ``(rays, 3)`` through the box.

        A ray that starts outside goes straight to the box; one that leaves it where it starts, or
        misses it, has no piece. Paths are within ``tolerance`` of their pieces, by default a
        thousandth of the box's shortest side. ``x'' = n grad n`` with ``dt = ds / n`` by DOP853,
        an adaptive Runge-Kutta method of order 8 with an embedded error estimate (Hairer, Norsett
        and Wanner, Solving Ordinary Differential Equations I), one ray after another: milliseconds
        a ray.
        """
        origins, directions = pairs_of_vectors(origins, directions)
        tolerance = (self.upper - self.lower).min() / 1000 if tolerance is None else tolerance
        exits, pieces = [], []
        for origin, direction in zip(origins, directions, strict=True):
            nodes, tangents = _path(self, origin, direction)
            exits.append((nodes[-1], tangents[-1]))
            ends = nodes[chords(nodes, tangents, tolerance)] if len(nodes) > 1 else nodes
            pieces.append(ends)
        ptr = np.cumsum([0] + [len(ends) - 1 for ends in pieces])
        steps = np.concatenate([np.zeros((0, 3)), *(np.diff(ends, axis=0) for ends in pieces)])
        lengths = np.linalg.norm(steps, axis=1)
        starts = np.concatenate([np.zeros((0, 3)), *(ends[:-1] for ends in pieces)])
        last, along = (np.array(one).reshape(-1, 3) for one in zip(*exits, strict=True))
        return Crossing(
            starts, steps / lengths[:, None], lengths, ptr.astype(np.int64), last, along,
            np.zeros(len(last), np.bool_),
        )  # fmt: skip

    def ahead(self, origins: ArrayLike, directions: ArrayLike) -> NDArray[np.float64]:
        """Return how far ahead the box is for rays ``(rays, 3)``; infinity if they miss it.

        Zero for rays that start inside; infinity for those that leave where they start.
        """
        start, stop = straight_through(self, *pairs_of_vectors(origins, directions))
        return np.where(stop - start > TOUCH * (self.upper - self.lower).max(), start, np.inf)

    def transformed(self, R: NDArray[np.float64], t: NDArray[np.float64]) -> Self:
        """Return the field after the rigid motion ``x_new = R @ x_old + t``, if it says how."""
        raise self._unable("moves", "transformed")

    def with_lengths_scaled(self, factor: float) -> Self:
        """Return the field of a world ``factor`` times as large, if it says how."""
        raise self._unable("scales", "with_lengths_scaled")

    def _unable(self, what: str, method: str) -> ValueError:
        return ValueError(
            f"gas: index: found {type(self).__name__}, which does not say how it {what}, expected "
            f"voxels: sample it in an IndexVolume, or give it the method {method}"
        )


def straight_through(
    field: IndexField, origins: NDArray[np.float64], directions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far ahead straight rays enter and leave the box; 0 twice if never."""
    still = directions == 0
    speed = np.where(still, 1.0, directions)
    ends = np.stack([(field.lower - origins) / speed, (field.upper - origins) / speed])
    inside = (origins >= field.lower) & (origins <= field.upper)
    near = np.where(still, np.where(inside, -np.inf, np.inf), ends.min(axis=0)).max(axis=1)
    far = np.where(still, np.where(inside, np.inf, -np.inf), ends.max(axis=0)).min(axis=1)
    start = np.maximum(near, 0.0)
    meets = far > start
    return np.where(meets, start, 0.0), np.where(meets, far, 0.0)


@dataclass(frozen=True)
class _Leaves:
    """The event that ends a solver's path: the distance to the nearest face falls below 0."""

    field: IndexField
    terminal = True
    direction = -1

    def __call__(self, _: float, state: NDArray) -> float:
        point = state[:3]
        return min((point - self.field.lower).min(), (self.field.upper - point).min())


def _path(
    field: IndexField, origin: NDArray[np.float64], direction: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points ``(N, 3)`` along a ray's path through the box, and unit vectors there.

    The last ones are those of the exit; a single point where the ray misses the box.
    """
    from scipy.integrate import solve_ivp

    (start,), (stop,) = straight_through(field, origin[None], direction[None])
    if not stop > start:
        return origin[None], direction[None]
    size = float((field.upper - field.lower).max())
    origin = origin + start * direction

    def motion(_: float, state: NDArray) -> NDArray:
        point = state[:3][None]
        return np.concatenate([state[3:], field.index(point)[0] * field.gradient(point)[0]])

    index = float(field.index(origin[None])[0])
    begin = np.concatenate([origin, index * direction])
    step = float((field.upper - field.lower).min()) / STEPS
    how = {"method": "DOP853", "rtol": RELATIVE, "atol": ABSOLUTE * size, "max_step": step}
    first = min((stop - start) / index / 2, step)  # one beyond the box would be none into it
    found = solve_ivp(
        motion, (0.0, 1e6 * size), begin, events=_Leaves(field), dense_output=True,
        first_step=first, **how,
    )  # fmt: skip
    times = found.t
    spans = [np.linspace(a, b, NODES, endpoint=False) for a, b in pairwise(times)]
    states = found.sol(np.concatenate(spans)).T
    # the polynomial between two steps is less exact than the steps: the last one is made anew
    last = solve_ivp(motion, times[-2:], found.sol(times[-2]), **how).y[:, -1]
    states = np.concatenate([states, last[None]])
    return states[:, :3], states[:, 3:] / np.linalg.norm(states[:, 3:], axis=1, keepdims=True)
