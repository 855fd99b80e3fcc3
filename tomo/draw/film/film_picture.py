"""The pictures of a video: the light of a volume with axes, a colour bar and the time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tomo.draw.emission import COLOURS, emission_image, eye_of
from tomo.draw.figures import LIGHT_INK, new_figure
from tomo.draw.frame import UP
from tomo.draw.scene import ColourScale, Scene
from tomo.draw.still import panel, show_light
from tomo.draw.viewpoint import Viewpoint
from tomo.grid import Volume

HEIGHT, WIDEST = 4.5, 12.0
"""Inches of the picture, at 160 pixels each: 720 lines, and at most 1920 columns."""

DPI = 160


@dataclass(frozen=True, eq=False)
class FilmPicture:
    """Draws the pictures of a film; axes, labels and colour bar are drawn once.

    Attributes
    ----------
    example : Volume
        One on the film's grid, with its units.
    full : float
        The line integral at the end of the colour scale.
    title : str
    """

    example: Volume
    full: float
    title: str = ""

    def draw(self, volume: Volume, label: str) -> NDArray[np.uint8]:
        """Return the picture of a volume with a label, ``(height, width, 3)``, even numbers."""
        from PIL import Image, ImageDraw, ImageFont

        empty, viewpoint = self._empty
        light = ColourScale("", 0.0, self.full, COLOURS)(emission_image(volume, viewpoint))
        image = Image.fromarray(np.clip(np.round(255 * light) + empty, 0, 255).astype(np.uint8))
        ImageDraw.Draw(image).text(
            (image.width - 20, 14), label, LIGHT_INK, ImageFont.load_default(22), anchor="ra"
        )
        return np.asarray(image)

    @cached_property
    def _empty(self) -> tuple[NDArray[np.uint8], Viewpoint]:
        """The picture without values, and the eye that sees it."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        grid = self.example.grid
        across = np.hypot(*grid.extent[[0, 2]]) / grid.extent[1]
        width = np.clip(0.85 * HEIGHT * across + 2.2, 5.0, WIDEST)
        figure = new_figure(round(width * DPI / 2) * 2 / DPI, HEIGHT, DPI)
        figure.set_facecolor("black")
        axes, size = panel(figure, (0, 0, 1, 1))
        viewpoint = eye_of(grid, size, margins=(0.2, 0.05, 0.1, 0.1))
        dark = self.example.like(np.zeros(grid.shape, np.float32))
        scene, bounds = Scene(length_unit=dark.length_unit), np.stack([grid.lower, grid.upper])
        show_light(axes, dark, scene, viewpoint, bounds, up=UP, full=self.full)
        figure.text(0.5, 1 - 0.2 / HEIGHT, self.title, fontsize=10, color=LIGHT_INK, ha="center",
                    va="center", parse_math=False)  # fmt: skip
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy(), viewpoint
