"""Times of films against each other: cameras that started late, or lost frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_SLACK = 0.5  # of the time between frames: closer, each frame has its nearest neighbour


@dataclass(frozen=True)
class OffBeat:
    """A film whose times disagree with those of the others.

    Attributes
    ----------
    camera : str
    frames : int
        Frames of its film by which its images are late, by the middle of all differences.
    where : int or None
        The first of the frames compared that is off by another number: frames were lost, or the
        clocks run at different speeds. None where all are off alike.
    """

    camera: str
    frames: int
    where: int | None = None


def off_beat(
    times: Mapping[str, NDArray[np.float64]], periods: Mapping[str, float]
) -> list[OffBeat]:
    """Return the films whose frames were not recorded when the others' were.

    Parameters
    ----------
    times : mapping
        Camera to the times of the frames that are to be of the same moments, seconds; the same
        number of them for all. Fewer than two films are not compared.
    periods : mapping
        Camera to the seconds from one frame of its film to the next.

    Notes
    -----
    A film is compared with the median of all films' times, frame by frame; with two films the
    first is taken to be right. A difference of less than half the film's period is none.

    Examples
    --------
    >>> import numpy as np
    >>> beat = np.arange(5) / 100
    >>> times = {"a": beat, "b": beat, "c": beat + 0.02}
    >>> off_beat(times, dict.fromkeys(times, 0.01))
    [OffBeat(camera='c', frames=2, where=None)]
    """
    each = np.array([times[name] for name in times])
    if len(each) < 2 or not each.size or not np.isfinite(each).all():
        return []
    common = np.median(each, axis=0) if len(each) > 2 else each[0]
    found = []
    for name, own in zip(times, each, strict=True):
        late = (own - common) / periods[name]
        middle = float(np.median(late))
        frames = round(middle) if abs(middle) > _SLACK else 0
        others = np.flatnonzero(np.abs(late - frames) > _SLACK)
        if frames or others.size:
            found.append(OffBeat(name, frames, int(others[0]) if others.size else None))
    return found
