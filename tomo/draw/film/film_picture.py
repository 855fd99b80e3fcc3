"""The pictures of a video: the light of a volume with axes, a colour bar and the time."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tomo.draw.emission import COLOURS, emission_image, eye_of
from tomo.draw.figures import LIGHT_INK, new_figure
from tomo.draw.frame import Up
from tomo.draw.scene import ColourScale, Scene
from tomo.draw.still import panel, show_light
from tomo.draw.viewpoint import Viewpoint
from tomo.grid import VoxelGrid

HEIGHT, WIDEST = 4.5, 12.0
"""Inches of the picture, at 160 pixels each: 720 lines, and at most 1920 columns."""

DPI = 160


class FilmPicture:
    """Draws the pictures of a film; axes, labels and colour bar are drawn once.

    Parameters
    ----------
    grid : VoxelGrid
    full : float
        The line integral at the end of the colour scale.
    length_unit, value_unit : str
    title : str
    """

    def __init__(
        self,
        grid: VoxelGrid,
        full: float,
        length_unit: str = "mm",
        value_unit: str = "",
        title: str = "",
    ) -> None:
        self.grid, self.full = grid, full
        self.length_unit, self.value_unit, self.title = length_unit, value_unit, title

    def __repr__(self) -> str:
        return f"FilmPicture({self.grid!r}, {self.full!r})"

    def draw(self, volume: NDArray, label: str) -> NDArray[np.uint8]:
        """Return the picture of a volume with a label, ``(height, width, 3)``, even numbers."""
        from PIL import Image, ImageDraw, ImageFont

        empty, viewpoint = self._empty
        light = ColourScale("", 0.0, self.full, COLOURS)(
            emission_image(volume, self.grid, viewpoint)
        )
        image = Image.fromarray(np.clip(np.round(255 * light) + empty, 0, 255).astype(np.uint8))
        ImageDraw.Draw(image).text(
            (image.width - 20, 14), label, LIGHT_INK, ImageFont.load_default(22), anchor="ra"
        )
        return np.asarray(image)

    @cached_property
    def _empty(self) -> tuple[NDArray[np.uint8], Viewpoint]:
        """The picture without values, and the eye that sees it."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        across = np.hypot(*self.grid.extent[[0, 2]]) / self.grid.extent[1]
        width = np.clip(0.85 * HEIGHT * across + 2.2, 5.0, WIDEST)
        figure = new_figure(round(width * DPI / 2) * 2 / DPI, HEIGHT, DPI)
        figure.set_facecolor("black")
        axes, size = panel(figure, (0, 0, 1, 1))
        viewpoint = eye_of(self.grid, size, margins=(0.2, 0.05, 0.1, 0.1))
        dark, scene = np.zeros(self.grid.shape, np.float32), Scene(length_unit=self.length_unit)
        bounds = np.stack([self.grid.lower, self.grid.upper])
        show_light(
            axes, dark, self.grid, scene, viewpoint, bounds, up=Up(), full=self.full,
            value_unit=self.value_unit,
        )  # fmt: skip
        figure.text(0.5, 1 - 0.2 / HEIGHT, self.title, fontsize=10, color=LIGHT_INK, ha="center",
                    va="center", parse_math=False)  # fmt: skip
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy(), viewpoint
