"""Films as scan input: each camera's frames in one file, read one at a time when asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from numpy.typing import NDArray

from rigs.recordings import FILM_SUFFIXES, Recording, is_film, open_recording
from rigs.recordings.write import TIFF_SUFFIXES


@dataclass(frozen=True)
class Film:
    """The frames of one camera in one file, and which of them are those of a scan.

    Attributes
    ----------
    path : Path
        A file or folder that `rigs.recordings.open_recording` takes.
    first : int
        The film's frame that is the scan's frame 0 of a camera that is not late.
    step : int
        Frames of the film from one frame of the scan to the next.
    offset : int
        Frames of the film by which the camera started late: frame ``n`` of the scan is frame
        ``first + n step - offset`` of the film.
    """

    path: Path
    first: int = 0
    step: int = 1
    offset: int = 0

    @cached_property
    def recording(self) -> Recording:
        """The file, opened once."""
        return open_recording(self.path)

    @property
    def n_frames(self) -> int:
        """Frames in the file."""
        return self.recording.n_frames

    @property
    def holds_integers(self) -> bool:
        """Whether the pixels are integers, which reading scales to 0..1."""
        return self.recording.bit_depth is not None

    def place_of(self, number: int) -> int | None:
        """Return the film's frame for a scan's frame number; None where it has none."""
        place = self.first + number * self.step - self.offset
        return place if 0 <= place < self.n_frames else None

    @property
    def numbers(self) -> range:
        """The scan's frame numbers from 0 on that the film has."""
        start = -(-max(self.offset - self.first, 0) // self.step)
        last = (self.n_frames - 1 - self.first + self.offset) // self.step
        return range(start, last + 1)


@dataclass(frozen=True)
class FilmFrame:
    """An image of a film, not yet read.

    Attributes
    ----------
    film : Film
    place : int
        The film's frame.
    """

    film: Film
    place: int

    def __str__(self) -> str:
        """Name the file and the frame."""
        return f"{self.film.path}: frame {self.place}"

    def read(self) -> NDArray:
        """Return the pixels as stored, see `rigs.recordings.Recording`."""
        return self.film.recording.read(self.place)


def films_in(folder: Path, cameras: tuple[str, ...]) -> dict[str, Film]:
    """Return the films ``<camera>.tif`` in a folder; empty unless every camera has one.

    A TIFF is a film where it has several pages of one size.
    """
    found = {}
    for camera in cameras:
        paths = [folder / f"{camera}{suffix}" for suffix in (*TIFF_SUFFIXES, *FILM_SUFFIXES)]
        paths = [path for path in paths if path.is_file() and is_film(path)]
        if len(paths) > 1:
            raise ValueError(
                f"{paths[1]}: camera {camera}: found two films, {paths[0].name} is the other, "
                "expected one"
            )
        if paths:
            found[camera] = Film(paths[0])
    return found if len(found) == len(cameras) else {}


def frames_of_films(films: Mapping[str, Film]) -> dict[str, dict[str, FilmFrame]]:
    """Return the images of every frame, by its number as text and by camera.

    A frame that only some films have lacks the other cameras; reading it names the first of them.

    Raises
    ------
    ValueError
        If a film cannot be read, or no frame is in all of them.
    """
    ranges = {camera: film.numbers for camera, film in films.items()}
    first = max(one.start for one in ranges.values())
    stop = min(one.stop for one in ranges.values())
    if first >= stop:
        each = ", ".join(f"{name} {one.start}:{one.stop}" for name, one in ranges.items())
        raise ValueError(
            f"{next(iter(films.values())).path.parent}: films: found frames {each}, expected one "
            "that is in all films: check first, step and offset"
        )
    stop = max(one.stop for one in ranges.values())
    return {
        str(number): {
            camera: FilmFrame(film, film.place_of(number))
            for camera, film in films.items()
            if number in ranges[camera]
        }
        for number in range(stop)
    }
