"""Matplotlib figures without global state: made, filled, written, gone."""

from __future__ import annotations

import io
import os
from typing import TYPE_CHECKING

from tomo.io.atomic import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(width: float, height: float, dpi: int = 160) -> Figure:
    """Return an empty white figure of ``width`` x ``height`` inches that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def plain(text: str) -> str:
    """Return ``text`` such that matplotlib takes none of it as mathematics."""
    return text.replace("$", r"\$")


def png_bytes(figure: Figure) -> bytes:
    """Return the figure as PNG; the same figure always gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def save_figure(figure: Figure, path: str | os.PathLike) -> None:
    """Write the figure as a PNG file, whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(png_bytes(figure))
