"""A page that plays the film of a store's volumes."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.progress import Progress, progress_of
from tomo.draw.scene import Scene
from tomo.draw.stage import Shown, fitting
from tomo.draw.write_html import write_html
from tomo.grid import Volume
from tomo.series import SeriesStore
from tomo.series.frames import slices_of
from tomo.series.verdict import SeriesTable

MOST_FRAMES = 60
"""Frames of a film in a page; they share `tomo.draw.stage.MOST_VOXELS`."""


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
    title : str
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


def shown_places(complete: NDArray[np.bool_], most: int = MOST_FRAMES) -> list[int]:
    """Return the places of the complete frames that a page shows, spread evenly."""
    places = np.flatnonzero(complete)
    if len(places) <= most:
        return places.tolist()
    return places[np.linspace(0, len(places) - 1, most).round().astype(int)].tolist()


def film_of(moments: Iterable[tuple[str, float, Volume]], count: int) -> Shown:
    """Return the film that a page shows.

    Parameters
    ----------
    moments : iterable of (label, position, volume)
        Frames in their order; the position along the time axis is 0 to 1.
    count : int
        How many there are: the more, the coarser.

    Raises
    ------
    ValueError
        If there is no frame.
    """
    labels, frames, whole = [], [], None
    for label, position, volume in moments:
        whole = volume.grid
        labels.append((label, round(position, 5)))
        frames.append(fitting(volume, count))
    if not frames:
        raise ValueError("film: found no frame, expected one")
    return Shown(frames, labels, whole=whole)


def moments_of(
    table: SeriesTable, places: Sequence[int], progress: Progress | None = None
) -> Iterator[tuple[str, float, Volume]]:
    """Yield label, position along the time axis and volume of frames."""
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
