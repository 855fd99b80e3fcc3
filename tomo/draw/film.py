"""Films of a store's volumes: a page that plays them, and the pictures of a video."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from rigs.progress import Progress, progress_of
from tomo.draw.emission import COLOURS, emission_image, eye_of
from tomo.draw.figures import LIGHT_INK, new_figure
from tomo.draw.frame import UP, Viewpoint
from tomo.draw.scene import ColourScale, Scene
from tomo.draw.stage import Shown, fitting
from tomo.draw.still import panel, show_light
from tomo.draw.writers import write_html
from tomo.grid import Volume
from tomo.series import SeriesStore
from tomo.series.frames import slices_of
from tomo.series.verdict import SeriesTable

if TYPE_CHECKING:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

MOST_FRAMES = 60
"""Frames of a film in a page; they share `tomo.draw.stage.MOST_VOXELS`."""

HEIGHT, WIDEST = 4.5, 12.0
"""Inches of the picture, at 160 pixels each: 720 lines, and at most 1920 columns."""


def visualize_film(
    path: str | os.PathLike,
    store: SeriesStore | str | os.PathLike,
    frames: str = ":",
    *,
    title: str = "",
    progress: Progress | bool | None = None,
) -> list[int]:
    """Write a page that plays a film of volumes, as ``flametomo visualize-volume out.zarr``.

    Parameters
    ----------
    path : path-like
        The .html file to write.
    store : SeriesStore or path-like
    frames : str
        Slices of the store's frames, counted from 0, like ``0:100:2``.
    progress : bool or callable, optional
        True shows a bar.

    Returns
    -------
    numbers : list of int
        Those of the frames shown, in their scan: at most `MOST_FRAMES`, spread evenly.

    Raises
    ------
    ValueError
        If the suffix is another, or none of the frames is complete.
    """
    if Path(path).suffix.lower() != ".html":
        raise ValueError(
            f"{path}: suffix: found {Path(path).suffix!r} with a store, expected .html; flametomo "
            "export STORE --to npz --frames A:B writes single frames to draw, --to mp4 a film"
        )
    store = store if isinstance(store, SeriesStore) else SeriesStore(store)
    table = SeriesTable.of(store)
    wanted = np.zeros(store.n_frames, bool)
    wanted[list(slices_of(frames, store.n_frames))] = True
    store.check_present(np.flatnonzero(wanted))
    wanted &= store.complete
    shown = shown_places(wanted)
    if not shown:
        raise ValueError(f"{store.path}: frames: found none that is complete, expected one")
    about = store.attributes
    with progress_of(progress, "film") as tell:
        film = film_of(moments_of(table, shown, tell), len(shown))
    words = words_of(shown, int(wanted.sum()))
    scene = Scene(length_unit=about["length_unit"])
    write_html(path, scene, title=title or store.path.stem, shown=film, note=words)
    return table.frames[shown].tolist()


def shown_places(complete: NDArray[np.bool_]) -> list[int]:
    """Return the places of the complete frames that a page shows, spread evenly."""
    places = np.flatnonzero(complete)
    count = min(len(places), MOST_FRAMES)
    return places[np.linspace(0, len(places) - 1, count).round().astype(int)].tolist()


def film_of(moments: Iterable[tuple[str, float, Volume]], count: int) -> Shown:
    """Return the film that a page shows of ``count`` moments: the more, the coarser."""
    labels, frames, whole = [], [], None
    for label, position, volume in moments:
        whole = volume.grid
        labels.append((label, round(position, 5)))
        frames.append(fitting(volume, count))
    return Shown(frames, labels, whole=whole)


def moments_of(
    table: SeriesTable, places: Sequence[int], progress: Progress | None = None
) -> Iterator[tuple[str, float, Volume]]:
    """Yield label, position along the time axis, 0 to 1, and volume of frames."""
    for done, place in enumerate(places):
        if progress:
            progress(done, len(places), table.label(place))
        volume = table.store.volume(place)
        yield table.label(place), (place + 0.5) / table.store.n_frames, volume
    if progress:
        progress(len(places), len(places), "")


def words_of(shown: Sequence[int], count: int) -> str:
    """Return the line that says which frames a film shows."""
    if len(shown) < count:
        return (
            f"{len(shown)} of {count} frames, spread evenly; the store has them all, and "
            "flametomo export --to mp4 makes a film of them."
        )
    return f"All {count} frames." if count > 1 else "The one frame."


@dataclass(frozen=True, eq=False)
class FilmPicture:
    """Draws the pictures of a film; axes, labels and colour bar are drawn once.

    ``example`` is a volume on the film's grid with its units, ``full`` the line integral at the
    end of the colour scale.
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
        grid = self.example.grid
        across = np.hypot(*grid.extent[[0, 2]]) / grid.extent[1]
        width = np.clip(0.85 * HEIGHT * across + 2.2, 5.0, WIDEST)
        figure = new_figure(width, HEIGHT)
        figure.set(figwidth=round(width * figure.dpi / 2) * 2 / figure.dpi, facecolor="black")
        axes, size = panel(figure, (0, 0, 1, 1))
        viewpoint = eye_of(grid, size, margins=(0.2, 0.05, 0.1, 0.1))
        dark = self.example.like(np.zeros(grid.shape, np.float32))
        scene, bounds = Scene(length_unit=dark.length_unit), np.stack([grid.lower, grid.upper])
        show_light(axes, dark, scene, viewpoint, bounds, up=UP, full=self.full)
        figure.text(0.5, 1 - 0.2 / HEIGHT, self.title, fontsize=10, color=LIGHT_INK, ha="center",
                    va="center", parse_math=False)  # fmt: skip
        canvas = cast("FigureCanvasAgg", figure.canvas)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy(), viewpoint
