"""Matplotlib figures without global state, and the files that pictures are written to."""

from __future__ import annotations

import io
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from rigs.files import atomic_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, MUTED = "#1b2733", "#5b6672"
LIGHT_INK, LIGHT_MUTED = "#c9d1d9", "#9aa5b1"
"""Colours of titles and of secondary text, on white and on black."""

PRINT_DPI = 200
"""Pixels an inch of figures for papers."""

FIGURE_SUFFIXES = (".png", ".pdf", ".svg")
"""The suffixes of flat pictures; text and lines of the last two can be enlarged."""

PICTURE_SUFFIXES = (*FIGURE_SUFFIXES, ".html", ".glb")

TURNING = ".gif"
"""The suffix of a volume that turns; rigs are not drawn so."""


def new_figure(width: float, height: float, dpi: int = 160) -> Figure:
    """Return an empty white figure of ``width`` x ``height`` inches that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def thin_lines(axes: Axes) -> None:
    """Give a plot thin grey lines."""
    axes.grid(True, which="major", color="#e3e7eb", linewidth=0.7)
    axes.tick_params(which="both", labelsize=7.5, colors=MUTED)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color("#9aa5b1")


def plain(text: str) -> str:
    """Return ``text`` escaped, so that matplotlib reads none of it as mathematics."""
    return text.replace("$", r"\$")


def raised(unit: str) -> str:
    """Return a unit as a physicist writes it, with raised powers.

    >>> raised("photons/s/m^3/sr")
    'photons/s/m³/sr'
    """
    digits = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
    return re.sub(r"\^(-?\d+)", lambda found: found[1].translate(digits), unit)


def with_unit(quantity: str, unit: str) -> str:
    """Return the words of an axis or a colour bar: the quantity, and its unit if it is known.

    >>> with_unit("emission", "W/m^3/sr")
    'emission (W/m³/sr)'
    """
    return f"{quantity} ({raised(unit)})" if unit else quantity


def short_numbers(bar: Axes) -> None:
    """Write large and small numbers along a colour bar as multiples of a power of ten above it."""
    bar.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4))
    bar.yaxis.get_offset_text().set(size=6.5, color=MUTED, x=0.0)


def png_bytes(figure: Figure) -> bytes:
    """Return the figure as PNG; the same figure always gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def save_figure(figure: Figure, path: str | os.PathLike) -> None:
    """Write the figure as a .png, .pdf or .svg file, whole or not at all.

    The same figure always gives the same bytes: the files have no date, and an SVG's names follow
    from what they name.
    """
    import matplotlib as mpl

    kind = Path(path).suffix.lower().removeprefix(".")
    without = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
    with atomic_path(path) as temporary, mpl.rc_context({"svg.hashsalt": "flametomo"}):
        figure.savefig(temporary, format=kind, metadata=without[kind])


def suffix_of(path: str | os.PathLike, *more: str) -> str:
    """Return the suffix of a picture's file in small letters.

    Raises
    ------
    ValueError
        If it is none of `PICTURE_SUFFIXES` and of ``more``.
    """
    suffix, known = Path(path).suffix, (*PICTURE_SUFFIXES, *more)
    if suffix.lower() not in known:
        expected = ", ".join(known)
        raise ValueError(f"{path}: suffix: found {suffix!r}, expected one of {expected}")
    return suffix.lower()
