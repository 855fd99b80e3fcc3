"""Timings that can be compared: in one process, in turn, medians; and a watch that can pause."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager


def in_turn(candidates: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Return the median seconds of each candidate, the candidates run in turn.

    Whatever else slows the machine down for a while then slows all of them down alike. Each runs
    once before, unmeasured: compiled code is loaded and memory is touched.
    """
    for candidate in candidates.values():
        candidate()
    taken: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(repeats):
        for name, candidate in candidates.items():
            started = time.perf_counter()
            candidate()
            taken[name].append(time.perf_counter() - started)
    return {name: statistics.median(seconds) for name, seconds in taken.items()}


class Stopwatch:
    """Seconds since it was made, without those spent paused."""

    def __init__(self) -> None:
        self._started = time.perf_counter()

    @contextmanager
    def paused(self) -> Iterator[float]:
        """Stand still, yielding what the watch shows: judging takes none of what is judged."""
        stopped = time.perf_counter()
        try:
            yield stopped - self._started
        finally:
            self._started += time.perf_counter() - stopped
