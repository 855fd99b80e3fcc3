"""How long each part of a piece of work took."""

from __future__ import annotations

import time


class Laps:
    """A stopwatch whose laps have names.

    Attributes
    ----------
    seconds : dict
        By name, in the order of the laps.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._began = self._last = time.perf_counter()

    def end(self, name: str) -> None:
        """End a lap, and begin the next."""
        self.seconds[name] = time.perf_counter() - self._last
        self.skip()

    def skip(self) -> None:
        """Begin the next lap now; what went by belongs to the total alone."""
        self._last = time.perf_counter()

    @property
    def total(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self._began
