"""The pictures of a video: maximum projections with axes, a colour bar and the time."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tomo.draw.figures import INK, MUTED, new_figure, plain
from tomo.draw.film.panels import COLOURS, Panel, coloured, palette, panels
from tomo.grid import VoxelGrid

HEIGHT, WIDEST = 4.5, 12.0
"""Inches of the picture, at 160 pixels each: 720 lines, and at most 1920 columns."""

DPI = 160
SHOWN = 2
"""Projections: from the front and from the side. The third, from above, is seldom wanted."""


class FilmPicture:
    """Draws the pictures of a film; axes, labels and colour bar are drawn once.

    Parameters
    ----------
    grid : VoxelGrid
    highest : float
        The value at the end of the colour scale.
    length_unit, value_unit : str
    title : str
    """

    def __init__(
        self,
        grid: VoxelGrid,
        highest: float,
        length_unit: str = "mm",
        value_unit: str = "",
        title: str = "",
    ) -> None:
        self.grid, self.highest = grid, highest
        self.length_unit, self.value_unit, self.title = length_unit, value_unit, title

    def __repr__(self) -> str:
        return f"FilmPicture({self.grid!r}, {self.highest!r})"

    def draw(self, volume: NDArray, label: str) -> NDArray[np.uint8]:
        """Return the picture of a volume with a label, ``(height, width, 3)``, even numbers."""
        import cv2
        from PIL import Image, ImageDraw, ImageFont

        empty, boxes = self._empty
        picture, colours = empty.copy(), palette()
        for panel, (top, bottom, left, right) in zip(self._panels(volume), boxes, strict=True):
            large = cv2.resize(
                np.ascontiguousarray(panel.values, np.float32),
                (right - left, bottom - top),
                interpolation=cv2.INTER_LINEAR,
            )
            picture[top:bottom, left:right] = colours[coloured(large, self.highest)]
        image = Image.fromarray(picture)
        ImageDraw.Draw(image).text(
            (picture.shape[1] - 20, 14), label, INK, ImageFont.load_default(22), anchor="ra"
        )
        return np.asarray(image)

    def _panels(self, volume: NDArray) -> list[Panel]:
        return panels(volume, self.grid, ("maximum",))[:SHOWN]

    @cached_property
    def _empty(self) -> tuple[NDArray[np.uint8], list[tuple[int, int, int, int]]]:
        """The picture without values, and where they belong: top, bottom, left, right."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        shown = self._panels(np.zeros(self.grid.shape, np.float32))
        room = HEIGHT - 1.15
        scale = min(room / max(panel.size[1] for panel in shown),
                    (WIDEST - 3.2) / sum(panel.size[0] for panel in shown))  # fmt: skip
        widths = [max(panel.size[0] * scale, 0.15) for panel in shown]
        width = sum(widths) + 0.85 * len(shown) + 1.3
        figure = new_figure(max(width, 5.0), HEIGHT, DPI)
        width = figure.get_size_inches()[0]
        if self.title:
            figure.text(0.12 / width, 1 - 0.22 / HEIGHT, self.title, fontsize=11, weight="bold",
                        color=INK, va="center", parse_math=False)  # fmt: skip
        left, axes = 0.75, None
        places = []
        for panel, wide in zip(shown, widths, strict=True):
            high = max(panel.size[1] * scale, 0.15)
            bottom = 0.6 + (room - high) / 2
            axes = figure.add_axes((left / width, bottom / HEIGHT, wide / width, high / HEIGHT))
            self._label(axes, panel)
            places.append(axes)
            left += wide + 0.85
        self._bar(figure, left - 0.45, room, width)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        picture = np.asarray(canvas.buffer_rgba())[..., :3].copy()
        lines = picture.shape[0]
        boxes = []
        for axes in places:
            (x0, y0), (x1, y1) = axes.get_window_extent().get_points()
            boxes.append((round(lines - y1), round(lines - y0), round(x0), round(x1)))
        even = picture[: lines // 2 * 2, : picture.shape[1] // 2 * 2]
        return np.ascontiguousarray(even), boxes

    def _label(self, axes, panel: Panel) -> None:
        """Give a picture its axes."""
        names = "xyz"
        for name, set_limits, set_label in (
            (panel.level, axes.set_xlim, axes.set_xlabel),
            (panel.upright, axes.set_ylim, axes.set_ylabel),
        ):
            axis = names.index(name)
            set_limits(self.grid.lower[axis], self.grid.upper[axis])
            set_label(plain(f"{name} ({self.length_unit})"), fontsize=9, color=INK, labelpad=2)
        axes.locator_params(nbins=4)
        axes.tick_params(labelsize=8, colors=MUTED)
        axes.set_title(panel.name, fontsize=9, color=INK, pad=5)

    def _bar(self, figure, left: float, room: float, width: float) -> None:
        """Draw the colour bar."""
        axes = figure.add_axes((left / width, 0.6 / HEIGHT, 0.14 / width, room / HEIGHT))
        scale = np.linspace(0, 1, 256)[:, None]
        axes.imshow(scale, cmap=COLOURS, origin="lower", aspect="auto",
                    extent=(0, 1, 0, self.highest))  # fmt: skip
        axes.set_xticks([])
        axes.yaxis.tick_right()
        axes.locator_params(axis="y", nbins=5)
        axes.tick_params(labelsize=8, colors=MUTED)
        axes.yaxis.set_label_position("right")
        axes.set_ylabel(plain(self.value_unit or "emission"), fontsize=9, color=INK, labelpad=4)
