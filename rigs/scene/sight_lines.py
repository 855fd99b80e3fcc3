"""Compiled: the direction in which a point is seen through known faces, with its derivatives.

A path is followed together with the derivatives of its position and direction ("ray
differentials": Igehy, "Tracing ray differentials", SIGGRAPH 1999). Newton's method then finds the
path that passes the point, and the implicit function theorem the derivatives of its start. The
slow twin is `rigs.scene.projection`, by differences of traced paths.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rigs.compiled import compiled
from rigs.ray_table.interpolation import STEPS
from rigs.scene.surfaces import BLOCKS, CYLINDER, PLANE, REFLECTS

_CLOSE = 1e-9  # radians: the step after which the next one is rounding, as steps square
_LONGEST = 0.3  # radians of one step; longer ones leave the faces

START = 2  # columns of derivatives by the start's direction; three by its position follow
WINDOW_NUMBERS = ("tilt_1", "tilt_2", "distance", "thickness")
"""Names of a window's numbers: tilts of its normal towards two directions along it, in radians."""

WINDOW = len(WINDOW_NUMBERS)  # columns by a window


def endless(faces: NDArray) -> NDArray:
    """Return faces without borders: a path that leaves one while it is adjusted stays smooth."""
    faces = faces.copy()
    plane = faces["kind"] == PLANE
    faces["radius"][plane], faces["hole"] = np.inf, 0.0
    faces["half"] = np.inf
    return faces


@compiled
def sight_lines(
    center, points, faces, routes, windows, depths, directions, by_center, by_point, by_window
) -> None:
    """Write the unit ``directions`` in which points are seen from ``center``, and derivatives.

    ``faces`` are `endless` ones; ``routes`` (N, R) are those between start and point, in order,
    then -1. ``windows`` (F,) number the variable window of each face, -1 for none; ``depths`` (F,)
    are behind that window's first face. Directions are NaN where no path along the route passes.
    ``by_center, by_point`` (N, 3, 3), ``by_window`` (N, 3, 4 W): by tilts of the normal towards
    `FACE`'s ``across`` and towards ``normal x across`` (radians), a shift along the normal, and
    the thickness. With no rows in ``by_point`` no derivative is written.
    """
    count = START + 3 + by_window.shape[2]
    at, way, last = np.zeros(3), np.zeros(3), np.zeros(3)
    shift, turn = np.zeros((count, 3)), np.zeros((count, 3))
    miss, step = np.zeros(3), np.zeros(2)
    for i in range(len(points)):
        for a in range(3):
            way[a] = points[i, a] - center[a]
        _normalise(way)
        found = False
        for _ in range(STEPS):
            _start(center, way, at, last, shift[:START], turn[:START])
            if not _follow(
                at, last, shift[:START], turn[:START], faces, routes[i], windows, depths
            ):
                break
            _to_point(points[i], at, last, shift[:START], turn[:START], miss)
            _solve(shift, miss, step)
            size = math.sqrt(step[0] ** 2 + step[1] ** 2)
            if not size < math.inf:
                break
            shorten = _LONGEST / size if size > _LONGEST else 1.0
            _across(way, last, miss)
            for a in range(3):
                way[a] += shorten * (step[0] * last[a] + step[1] * miss[a])
            _normalise(way)
            if size < _CLOSE:
                found = True
                break
        for a in range(3):
            directions[i, a] = way[a] if found else math.nan
        if found and len(by_point):
            _start(center, way, at, last, shift, turn)
            _follow(at, last, shift, turn, faces, routes[i], windows, depths)
            _to_point(points[i], at, last, shift, turn, miss)
            _implicit(way, last, shift, by_center[i], by_point[i], by_window[i])


@compiled
def _start(center, way, at, last, shift, turn) -> None:
    """Begin a path: its first columns turn it, the next three move its start."""
    shift[:], turn[:] = 0.0, 0.0
    _across(way, turn[0], turn[1])
    for a in range(3):
        at[a], last[a] = center[a], way[a]
        if len(shift) > START:
            shift[START + a, a] = 1.0


@compiled
def _normalise(vector) -> None:
    """Make a vector one of unit length."""
    length = math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    for a in range(3):
        vector[a] /= length


@compiled
def _across(way, first, second) -> None:
    """Write two unit vectors across ``way`` and each other."""
    least = 0
    for a in range(1, 3):
        if abs(way[a]) < abs(way[least]):
            least = a
    for a in range(3):
        first[a] = (1.0 if a == least else 0.0) - way[least] * way[a]
    _normalise(first)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        second[a] = way[b] * first[c] - way[c] * first[b]


@compiled
def _follow(at, way, shift, turn, faces, route, windows, depths) -> bool:
    """Take a path through all faces of a route, in place; return whether it gets there."""
    normal, bend = np.zeros(3), np.zeros((len(shift), 3))
    before = -1
    for f in route:
        if f < 0:
            break
        face = faces[f]
        length = _ahead(at, way, face, before == f, normal)
        before = f
        if not length < math.inf or face.action == BLOCKS:
            return False
        for a in range(3):
            at[a] += length * way[a]
        if face.kind != PLANE:
            _from_middle(at, face, normal)
            _normalise(normal)
        _meet(at, way, shift, turn, face, normal, length, bend, windows[f], depths[f])
        if not _turn(way, turn, face, normal, bend):
            return False
    return True


@compiled
def _ahead(at, way, face, leaves, away):
    """Return the distance to an endless face ahead, infinity without; ``away`` is its normal.

    The normal is that of a plane only. A path that leaves a round face meets its other side.
    """
    if face.kind == PLANE:
        height = 0.0
        for a in range(3):
            away[a] = face.axis[a]
            height += (face.point[a] - at[a]) * away[a]
        length = height / _dot(way, away)
        return length if length > 0 else math.inf
    slope = _dot(way, face.axis) if face.kind == CYLINDER else 0.0
    _from_middle(at, face, away)
    square = 1 - slope * slope
    middle = -_dot(away, way) / square
    nearest = 0.0  # to the axis or the centre, squared
    for a in range(3):
        nearest += (away[a] + middle * (way[a] - slope * face.axis[a])) ** 2
    depth = face.radius * face.radius - nearest
    if not depth > 0:
        return math.inf
    half = math.sqrt(depth / square)
    if leaves:
        return 2 * half if middle > 0 else math.inf
    length = middle - half if middle - half > 0 else middle + half
    return length if length > 0 else math.inf


@compiled
def _from_middle(at, face, away) -> None:
    """Write the way to a point from the axis of a cylinder, or from the centre of a sphere."""
    for a in range(3):
        away[a] = at[a] - face.point[a]
    if face.kind == CYLINDER:
        along = _dot(away, face.axis)
        for a in range(3):
            away[a] -= along * face.axis[a]


@compiled
def _meet(at, way, shift, turn, face, normal, length, bend, window, depth) -> None:
    """Carry derivatives to a face: those of the position q on it, and of its normal n there.

    The length changes so that q stays on the face: ``n . (dq - dp) + dn . (q - p) = 0`` for a
    plane through p that moves.
    """
    toward = _dot(way, normal)
    own = START + 3 + WINDOW * window
    for k in range(len(shift)):
        height = 0.0
        for a in range(3):
            shift[k, a] += length * turn[k, a]
            height -= normal[a] * shift[k, a]
            bend[k, a] = 0.0
        if window >= 0 and own <= k < own + WINDOW:
            number = k - own
            if number < 2:
                for a in range(3):
                    b, c = (a + 1) % 3, (a + 2) % 3
                    second = face.axis[b] * face.across[c] - face.axis[c] * face.across[b]
                    bend[k, a] = face.across[a] if number == 0 else second
                    height += bend[k, a] * (face.point[a] - at[a])
            elif number == 2:
                height += 1.0
            elif depth > 0:
                height -= 1.0
        for a in range(3):
            shift[k, a] += height / toward * way[a]
        if face.kind != PLANE:
            axial = 0.0
            if face.kind == CYLINDER:
                axial = _dot(shift[k], face.axis)
            for a in range(3):
                bend[k, a] = (shift[k, a] - axial * face.axis[a]) / face.radius


@compiled
def _turn(way, turn, face, normal, bend) -> bool:
    """Refract or reflect a path with its derivatives; return False for total reflection.

    With u = d . n, e the ratio of indices and r = sqrt(1 - e² (1 - u²)), Snell's law is
    ``d' = e d + m n`` with ``m = sign(u) r - e u``, so that ``dm = (e² |u| / r - e) du``. A mirror
    is e = 1, m = -2 u.
    """
    u = _dot(way, normal)
    front = 0 if u < 0 else 1
    ratio, m, slope = 1.0, -2 * u, -2.0
    if face.action != REFLECTS:
        ratio = face.index[front] / face.index[1 - front]
        square = 1 - ratio * ratio * (1 - u * u)
        if square <= 0:
            return False
        root = math.sqrt(square)
        m = (root if u > 0 else -root) - ratio * u
        slope = ratio * ratio * abs(u) / root - ratio
    for k in range(len(turn)):
        change = slope * (_dot(bend[k], way) + _dot(normal, turn[k]))
        for a in range(3):
            turn[k, a] = ratio * turn[k, a] + change * normal[a] + m * bend[k, a]
    for a in range(3):
        way[a] = ratio * way[a] + m * normal[a]
    _normalise(way)
    return True


@compiled
def _dot(one, other):
    """Return the product of two vectors."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


@compiled
def _to_point(point, at, way, shift, turn, miss) -> None:
    """Carry derivatives to where the path is nearest to a point, and by what it misses it."""
    length = 0.0
    for a in range(3):
        length += (point[a] - at[a]) * way[a]
    for a in range(3):
        miss[a] = point[a] - at[a] - length * way[a]
    for k in range(len(shift)):
        along = 0.0
        for a in range(3):
            shift[k, a] += length * turn[k, a]
            along += shift[k, a] * way[a]
        for a in range(3):
            shift[k, a] -= along * way[a]


@compiled
def _solve(shift, miss, step) -> None:
    """Write the turns of the start, by its two columns, that move the path by ``miss``."""
    aa, ab, bb = _dot(shift[0], shift[0]), _dot(shift[0], shift[1]), _dot(shift[1], shift[1])
    a, b = _dot(shift[0], miss), _dot(shift[1], miss)
    size = aa * bb - ab * ab
    step[0], step[1] = (bb * a - ab * b) / size, (aa * b - ab * a) / size


@compiled
def _implicit(way, last, shift, by_center, by_point, by_window) -> None:
    """Write the derivatives of the start's direction: the path goes on passing the point."""
    first, second, miss, step = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2)
    _across(way, first, second)
    for k in range(3 + len(shift) - START):
        for a in range(3):
            if k < 3:  # the point moves: what is across the path counts
                miss[a] = (1.0 if a == k else 0.0) - last[k] * last[a]
            else:
                miss[a] = -shift[START + k - 3, a]
        _solve(shift, miss, step)
        for a in range(3):
            change = step[0] * first[a] + step[1] * second[a]
            if k < 3:
                by_point[a, k] = change
            elif k < 6:
                by_center[a, k - 3] = change
            else:
                by_window[a, k - 6] = change
