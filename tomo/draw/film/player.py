"""A film in a page: pictures of a bounded number of frames, a slider, and a button that plays."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.files import atomic_path
from tomo.draw.film.panels import coloured, palette, panels, png_of, shrunk
from tomo.draw.page import embedded, render, script_safe
from tomo.grid import VoxelGrid

MOST_FRAMES = 60
"""Frames of a film in a page: they take at most 10 MB, see `tomo.draw.film.panels.LARGEST`."""

TALLEST, WIDEST = 225.0, 330.0
"""Pixels of a picture on the page, at the most: one fits on a telephone."""


def film_of(
    moments: Iterable[tuple[str, float, NDArray]],
    grid: VoxelGrid,
    length_unit: str,
    value_unit: str = "",
) -> dict[str, Any]:
    """Return what the template of a film needs.

    Parameters
    ----------
    moments : iterable of (label, position, volume)
        Frames in their order; the position along the time axis is 0 to 1.
    grid : VoxelGrid
    length_unit, value_unit : str
    """
    labels, positions, pictures, first = [], [], [], None
    for label, position, volume in moments:
        found = panels(volume, grid)
        first = first or found
        labels.append(label)
        positions.append(round(position, 5))
        pictures.append([shrunk(panel.values).astype(np.float32) for panel in found])
    if first is None:
        raise ValueError("film: found no frame, expected one")
    highest = max(float(values.max()) for moment in pictures for values in moment)
    highest = highest if highest > 0 else 1.0
    frames = [
        {
            "label": label,
            "at": position,
            "images": [embedded(png_of(coloured(values, highest))) for values in moment],
        }
        for label, position, moment in zip(labels, positions, pictures, strict=True)
    ]
    scale = min(
        TALLEST / max(panel.size[1] for panel in first),
        WIDEST / max(panel.size[0] for panel in first),
    )
    steps = [f"rgb({r},{g},{b})" for r, g, b in palette()[:: 255 // 5]]
    shown = [
        {
            "name": panel.name,
            "axes": f"{panel.level} across, {panel.upright} up ({length_unit})",
            "number": number,
            "width": max(round(panel.size[0] * scale), 24),
            "height": max(round(panel.size[1] * scale), 24),
        }
        for number, panel in enumerate(first)
    ]
    return {
        "groups": [shown[: len(shown) // 2], shown[len(shown) // 2 :]],
        "highest": f"{highest:.3g} {value_unit}".strip(),
        "first": frames[0],
        "last": len(frames) - 1,
        "gradient": ", ".join(steps),
        "data": script_safe(json.dumps(frames)),
    }


def write_film_page(
    path: str | os.PathLike, film: Mapping[str, Any], *, title: str, words: str
) -> None:
    """Write a page that plays a film and loads nothing.

    Parameters
    ----------
    path : path-like
    film : mapping
        What `film_of` gave.
    title : str
    words : str
        A line below the title: which frames, of how many.
    """
    text = render("film.html", title=title, words=words, film=film)
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
