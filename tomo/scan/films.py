"""Films as scan input: each camera's frames in one file, read one at a time when asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.recordings import (
    CONTAINER_SUFFIXES,
    FILM_SUFFIXES,
    RawLayout,
    Recording,
    is_film,
    open_recording,
)
from rigs.recordings.recording import off_beat
from rigs.recordings.stills import TIFF_SUFFIXES, grouped_notes


@dataclass(frozen=True)
class Film:
    """The frames of one camera in one file, and which of them are those of a scan.

    Frame ``n`` of the scan is frame ``first + n step - offset`` of the film.
    """

    path: Path  # what `rigs.recordings.open_recording` takes, or an array in it
    first: int = 0
    step: int = 1
    offset: int = 0  # frames by which the camera started late
    raw: RawLayout | None = None  # how frames lie in a binary file that does not say so

    @cached_property
    def recording(self) -> Recording:
        """The file, opened once."""
        return open_recording(self.path, self.raw)

    @property
    def n_frames(self) -> int:
        """Frames in the file."""
        return self.recording.n_frames

    @property
    def holds_integers(self) -> bool:
        """Whether the pixels are integers, which reading scales to 0..1."""
        return self.recording.bit_depth is not None

    @property
    def numbers(self) -> range:
        """The scan's frame numbers from 0 on that the film has."""
        start = -(-max(self.offset - self.first, 0) // self.step)
        last = (self.n_frames - 1 - self.first + self.offset) // self.step
        return range(start, last + 1)


@dataclass(frozen=True)
class FilmFrame:
    """An image of a film, not yet read."""

    film: Film
    place: int

    def __str__(self) -> str:
        """Name the file and the frame."""
        return f"{self.film.path}: frame {self.place}"

    def read(self, channel: str | None = None) -> NDArray:
        """Return the pixels as stored, see `rigs.recordings.Recording.read_channel`."""
        if channel is None:
            return self.film.recording.read(self.place)
        return self.film.recording.read_channel(self.place, channel)


ImageSource = Path | NDArray | FilmFrame


@dataclass(frozen=True)
class Frame:
    """One moment: images by camera, in a file, in a film, or in memory ``(h, w)``."""

    name: str
    images: Mapping[str, ImageSource]


def films_in(folder: Path, cameras: tuple[str, ...]) -> dict[str, Film]:
    """Return the films named as the cameras in a folder; empty unless every camera has one."""
    found = {}
    for camera in cameras:
        suffixes = (*TIFF_SUFFIXES, *FILM_SUFFIXES, *CONTAINER_SUFFIXES, "")
        paths = [folder / f"{camera}{suffix}" for suffix in suffixes]
        paths = [path for path in paths if path.exists() and is_film(path)]
        if len(paths) > 1:
            raise ValueError(
                f"{paths[1]}: camera {camera}: found two films, {paths[0].name} is the other, "
                "expected one"
            )
        if paths:
            found[camera] = Film(paths[0])
    return found if len(found) == len(cameras) else {}


def frames_of_films(films: Mapping[str, Film]) -> tuple[Frame, ...]:
    """Return every frame, called by its number; one that only some films have lacks cameras."""
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
    return tuple(
        Frame(
            str(number),
            {
                camera: FilmFrame(film, film.first + number * film.step - film.offset)
                for camera, film in films.items()
                if number in ranges[camera]
            },
        )
        for number in range(stop)
    )


def notes_of_films(films: Mapping[str, Film]) -> tuple[str, ...]:
    """Return lines on what films say: of their pixels, their lengths, rates and times."""
    said = grouped_notes((camera, film.recording.notes) for camera, film in films.items())
    counts = {camera: film.n_frames for camera, film in films.items()}
    if len({(film.numbers.start, film.numbers.stop) for film in films.values()}) > 1:
        said.append(
            f"films: found {_each(counts)} frames: those that not all films have cannot be "
            "reconstructed"
        )
    rates = {camera: film.recording.frame_rate for camera, film in films.items()}
    rates = {camera: f"{rate:g}" for camera, rate in rates.items() if rate is not None}
    if len(set(rates.values())) > 1:
        said.append(f"films: found {_each(rates)} frames a second, expected one frame rate")
    return (*said, *_off_beat(films))


def frame_rate_of(films: Mapping[str, Film]) -> float | None:
    """Return the scan's frames a second, where all films say the same."""
    rates = {film.recording.frame_rate for film in films.values()}
    steps = {film.step for film in films.values()}
    rate = rates.pop() if len(rates) == len(steps) == 1 else None
    return None if rate is None else rate / steps.pop()


def _each(values: Mapping[str, object]) -> str:
    """Return values with the names of their cameras, those that are equal together."""
    groups: dict[object, list[str]] = {}
    for camera, value in values.items():
        groups.setdefault(value, []).append(camera)
    return ", ".join(
        f"{value} ({', '.join(names[:3])}{' ...' if len(names) > 3 else ''})"
        for value, names in groups.items()
    )


def _off_beat(films: Mapping[str, Film]) -> Iterator[str]:
    """Yield a line on each film whose times do not fit those of the others."""
    times = {camera: film.recording.timestamps for camera, film in films.items()}
    times = {camera: own for camera, own in times.items() if own is not None and len(own) > 1}
    periods = {camera: float(np.median(np.diff(own))) for camera, own in times.items()}
    used = {camera: films[camera] for camera, period in periods.items() if period > 0}
    if len(used) < 2:
        return
    ranges = [film.numbers for film in used.values()]
    numbers = np.arange(max(one.start for one in ranges), min(one.stop for one in ranges))
    compared = {
        camera: times[camera][film.first + numbers * film.step - film.offset]
        for camera, film in used.items()
    }
    for one in off_beat(compared, periods):
        said = f"camera {one.camera}: timestamps differ from those of the other films"
        film, many = films[one.camera], "" if abs(one.frames) == 1 else "s"
        if one.where is not None:
            yield (
                f"{said}, by another number of frames from frame {numbers[one.where]} on: frames "
                "were lost, or the frame rates differ"
            )
        else:
            way = "late" if one.frames > 0 else "early"
            yield (
                f"{said}: its images are {abs(one.frames)} frame{many} {way}. If the clocks "
                f"agree, offset: {film.offset + one.frames} in scan.yaml fits, in place of "
                f"{film.offset}"
            )
