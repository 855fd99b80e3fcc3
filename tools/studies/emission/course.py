"""A run that is judged by the truth as it goes, and the best of several: how peers are tuned."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.common.timing import Stopwatch
from studies.emission.scenes import Seen
from tomo import metrics

PATIENCE = 6  # judgements without a new best after which a run is over
Volume = NDArray[np.float32]


class Course:
    """What a run came to; its watches stand still while it is judged.

    It has ``points`` of CPU seconds since the images were in memory and NRMSE, and the ``volume``
    nearest to the truth with its error and seconds.
    """

    def __init__(self, truth: Volume) -> None:
        self._truth, self._watches = truth, (Stopwatch(time.process_time), Stopwatch())
        self.points: list[tuple[float, float]] = []
        self.volume, self.nrmse = np.zeros_like(truth), np.inf
        self.cpu_seconds = self.wall_seconds = 0.0
        self._last = 0

    def judge(self, volume: NDArray) -> bool:
        """Judge a volume of any shape with as many values; return whether to stop."""
        with self._watches[0].paused() as cpu, self._watches[1].paused() as wall:
            found = np.array(volume, np.float32).reshape(self._truth.shape)
            error = metrics.nrmse(found, self._truth)
            self.points.append((cpu, error))
            if error < self.nrmse:
                self.volume, self.nrmse, self._last = found, error, len(self.points)
                self.cpu_seconds, self.wall_seconds = cpu, wall
            return len(self.points) - self._last >= PATIENCE


@dataclass(frozen=True, eq=False)
class Found:
    """A volume ``(nx, ny, nz)``, how it was found, and what it took.

    Seconds are of the run that found it, until it did; those of tuning are CPU of all runs. The
    curve has CPU seconds and the least NRMSE of any run by then.
    """

    volume: Volume
    settings: Mapping[str, Any]
    cpu_seconds: float
    wall_seconds: float
    tuning_seconds: float | None = None
    curve: Sequence[tuple[float, float]] = ()


def best_of(seen: Seen, run: Callable[..., None], tried: Iterable[Mapping[str, Any]]) -> Found:
    """Return the best of ``run(course, seen, **settings)`` over settings, each stopped there."""
    started, courses = time.process_time(), []
    for settings in tried:
        course = Course(seen.truth)
        run(course, seen, **settings)
        courses.append((course, settings))
    spent = time.process_time() - started
    course, settings = min(courses, key=lambda one: one[0].nrmse)
    points = [point for one, _ in courses for point in one.points]
    return Found(
        course.volume, settings, course.cpu_seconds, course.wall_seconds, spent, falling(points)
    )


def falling(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points that are better than all before them."""
    kept: list[tuple[float, float]] = []
    for seconds, error in sorted(points):
        if not kept or error < kept[-1][1]:
            kept.append((seconds, error))
    return kept
