"""Small HTML for notebooks: a framed box with a table, and a rig's cameras as a drawing.

The HTML has its own styles, loads nothing and takes the colours of the page, light or dark.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from rigs.camera_protocol import CameraLike
from rigs.geometry.points import nearest_point

WIDTH, HEIGHT, MARGIN = 300, 220, 26
"""Pixels of a drawing: two beside each other fit into a notebook's cell."""

MOST_NAMES = 12
"""Cameras whose names stand beside them, from above; of more they lie over each other."""

SYMBOL = 0.13  # length of a camera's symbol, in distances to the middle
_VOLUME = "#e2582f"
_LINE = "rgba(128,128,128,.35)"


def framed(title: str, *parts: str) -> str:
    """Return a box with a title; ``parts`` are HTML, the title is escaped."""
    return (
        f'<div style="border:1px solid {_LINE};border-radius:6px;padding:10px 14px;'
        'display:inline-block;max-width:100%;box-sizing:border-box;overflow-x:auto">'
        f'<div style="font-weight:600;margin-bottom:6px">{escape(title)}</div>'
        f"{''.join(parts)}</div>"
    )


def facts(rows: Iterable[tuple[str, object]]) -> str:
    """Return a table of two columns; both are escaped."""
    lines = (
        f'<tr style="background:none"><th style="text-align:left;font-weight:400;opacity:.75;'
        f'padding:2px 14px 2px 0;vertical-align:top;white-space:nowrap">{escape(name)}</th>'
        f'<td style="text-align:left;padding:2px 0">{escape(str(value))}</td></tr>'
        for name, value in rows
    )
    return f'<table style="border-collapse:collapse;margin:4px 0">{"".join(lines)}</table>'


def times(values: Iterable[float]) -> str:
    """Return counts or lengths as ``3 × 4 × 5``."""
    return " × ".join(f"{value:.6g}" for value in values)


def drawing(cameras: Sequence[CameraLike], corners: NDArray | None) -> str:
    """Return cameras and volume as SVG, from above and from the side, at one scale.

    ``corners`` ``(N, 3)`` are those of the volume that they look at.
    """
    if not cameras:
        return ""
    positions = np.array([camera.position for camera in cameras])
    axes = np.array([camera.R[2] for camera in cameras])
    middle = nearest_point(positions, axes)[0] if corners is None else corners.mean(axis=0)
    distance = float(np.median(np.linalg.norm(positions - middle, axis=1))) or 1.0
    points = [positions, positions + 2 * SYMBOL * distance * axes, middle[None]]
    points += [] if corners is None else [corners]
    up, sign = upward(cameras)
    first, second = (up + 1) % 3, (up + 2) % 3
    flip = np.where(np.arange(3) == up, sign, 1.0)  # of what points up on the page
    views = (
        ("from above", first, second, np.array([1.0, float(sign)])),
        ("from the side", first, up, np.array([1.0, flip[up]])),
    )
    cloud = np.concatenate(points)
    parts = []
    for words, across, upright, signs in views:
        place = _placed(cloud[:, [across, upright]] * signs)
        sides = (0, 1) if upright != up else (2, 3)
        symbols = _symbols(cameras, sides, SYMBOL * distance)
        drawn = [] if corners is None else [_volume(place(corners[:, [across, upright]] * signs))]
        for camera, symbol in zip(cameras, symbols, strict=True):
            is_named = upright != up and len(cameras) <= MOST_NAMES
            at = place(symbol[:, [across, upright]] * signs)
            drawn.append(_camera(camera.name, at, is_named))
        upwards = f"{'-' if signs[1] < 0 else ''}{'xyz'[upright]}"
        label = f"{words}: {'xyz'[across]} to the right, {upwards} up"
        parts.append(
            f'<figure style="display:inline-block;margin:0 12px 0 0"><svg width="{WIDTH}" '
            f'height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}" '
            f'style="color:inherit">{"".join(drawn)}</svg><figcaption style="font-size:.8em;'
            f'opacity:.75">{label}</figcaption></figure>'
        )
    return "".join(parts)


def upward(cameras: Sequence[CameraLike]) -> tuple[int, int]:
    """Return the world axis that most cameras' images show upward, 0 to 2, and its sign."""
    found = -np.sum([camera.R[1] for camera in cameras], axis=0)
    axis = int(np.abs(found).argmax())
    return axis, -1 if found[axis] < -1e-9 else 1


def _placed(cloud: NDArray):
    """Return a function from points of a view ``(N, 2)`` to pixels of its drawing."""
    low, high = np.nanmin(cloud, axis=0), np.nanmax(cloud, axis=0)
    room = np.array([WIDTH, HEIGHT]) - 2 * MARGIN
    scale = float(np.min(room / np.maximum(high - low, 1e-9 * np.ptp(cloud) + 1e-300)))
    middle = (low + high) / 2

    def place(points: NDArray) -> NDArray:
        at = (points - middle) * scale
        return np.stack([WIDTH / 2 + at[:, 0], HEIGHT / 2 - at[:, 1]], axis=-1)

    return place


def _symbols(
    cameras: Sequence[CameraLike], sides: tuple[int, int], length: float
) -> list[NDArray[np.float64]]:
    """Return each camera's position and the ends of two rays at its image's sides, ``(3, 3)``."""
    symbols = []
    for camera in cameras:
        width, height = camera.image_size
        ends = np.array(
            [[0, height / 2], [width, height / 2], [width / 2, 0], [width / 2, height]]
        )
        _, directions = camera.rays(ends[list(sides)] - 0.5)
        directions = np.where(np.isfinite(directions), directions, camera.R[2])
        symbols.append(np.vstack([camera.position, camera.position + length * directions]))
    return symbols


def _camera(name: str, at: NDArray, named: bool) -> str:
    """Return a camera as a wedge that opens to where it looks; its name shows when pointed at."""
    corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in at)
    x, y = at[0]
    beside = y - 6 if at[1:, 1].mean() >= y else y + 12  # where the symbol does not open
    text = (
        f'<text x="{min(max(x, MARGIN), WIDTH - MARGIN):.1f}" y="{beside:.1f}" font-size="9" '
        f'text-anchor="middle" fill="currentColor" opacity=".8">{escape(name)}</text>'
    )
    return (
        f'<g><title>{escape(name)}</title><polygon points="{corners}" fill="currentColor" '
        f'fill-opacity=".15" stroke="currentColor" stroke-width="1" stroke-linejoin="round"/>'
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2" fill="currentColor"/>{text if named else ""}</g>'
    )


def _volume(corners: NDArray) -> str:
    """Return the volume as a rectangle, at least so large that it is seen."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    grow = np.maximum(3 - (high - low), 0) / 2
    (x, y), (width, height) = low - grow, high - low + 2 * grow
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" '
        f'fill="{_VOLUME}" fill-opacity=".35" stroke="{_VOLUME}"><title>volume</title></rect>'
    )
