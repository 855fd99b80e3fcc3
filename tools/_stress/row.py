"""One stress: what was done, over which range, the worst that came of it, and its bound."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Size:
    """How much of each stress is run.

    Attributes
    ----------
    quick : bool
        Whether the small version is asked for, which all areas end within three minutes.
    seed : int
        Of everything random.
    """

    quick: bool = False
    seed: int = 0


@dataclass(frozen=True)
class Chart:
    """What a row's figure came from, as curves on logarithmic axes.

    Attributes
    ----------
    title, x, y : str
        Words above the plot and along its axes.
    curves : mapping of str to sequence of (float, float)
        By name, the points of each; what is not above zero is not drawn.
    """

    title: str
    x: str
    y: str
    curves: Mapping[str, Sequence[tuple[float, float]]]


@dataclass(frozen=True)
class Row:
    """One stress and its figure.

    Attributes
    ----------
    stress : str
        What was done to the toolkit.
    over : str
        The range it was done over.
    figure : float
        The worst that was measured; NaN where nothing came of it.
    bound : float
        What it may be at most, or has to be at least.
    unit : str
        Of both; "faults" for counts of what must not happen.
    at_least : bool
        Whether the figure has to be at least the bound.
    note : str
        Where it was worst, or why the bound is right to fail.
    chart : Chart, optional
        Shown below the area's table.
    """

    stress: str
    over: str
    figure: float
    bound: float
    unit: str = ""
    at_least: bool = False
    note: str = ""
    chart: Chart | None = None

    @classmethod
    def of_faults(cls, stress: str, over: str, faults: Sequence[str], otherwise: str = "") -> Self:
        """Return the row that counts what must not happen; its note is `told` or ``otherwise``."""
        return cls(stress, over, len(faults), 0, "faults", note=told(faults) or otherwise)

    @property
    def holds(self) -> bool:
        """Whether the figure is within its bound; NaN never is."""
        return self.figure >= self.bound if self.at_least else self.figure <= self.bound

    def plain(self) -> dict[str, Any]:
        """Return it as plain data, with what is not finite as words."""
        row = asdict(self) | {"holds": bool(self.holds)}
        for key in ("figure", "bound"):
            value = float(row[key])
            row[key] = value if math.isfinite(value) else str(value)
        return row


def told(faults: Iterable[str]) -> str:
    """Return the first five of what was found as a note, each once; empty words are nothing."""
    return "; ".join(list(dict.fromkeys(filter(None, faults)))[:5])


Progress = Callable[[int, int, str], None]
"""``progress(done, total, where)``."""


def relative_error(found: ArrayLike, expected: ArrayLike) -> float:
    """Return ``|found - expected| / |expected|`` in float64; infinite where found is not finite.

    Both are scaled by the largest expected value first: squares of 1e200 or 1e-200 must not
    overflow or vanish.
    """
    found, expected = np.asarray(found, np.float64), np.asarray(expected, np.float64)
    if found.shape != expected.shape or not np.isfinite(found).all():
        return math.inf
    scale = np.abs(expected).max(initial=0.0)
    if scale == 0:
        return 0.0 if not found.any() else math.inf
    return float(np.linalg.norm((found - expected) / scale) / np.linalg.norm(expected / scale))


def worst_of(figures: Iterable[tuple[str, float]]) -> tuple[float, str]:
    """Return the largest of named figures and its name; NaN is worse than any number."""
    worst, where = -math.inf, ""
    for name, figure in figures:
        if math.isnan(figure) or figure > worst:
            worst, where = figure, name
        if math.isnan(figure):
            break
    return worst, where


def faults_of_refusing(calls: Iterable[tuple[str, Callable[[], object]]]) -> list[str]:
    """Return what did not refuse its input with one line of ValueError or its kin.

    Parameters
    ----------
    calls : iterable of (str, callable)
        A name, and what has to raise.

    Returns
    -------
    list of str
        The name and what came instead, for each fault.
    """
    faults = []
    for name, call in calls:
        try:
            call()
        except (ValueError, OSError) as error:
            if not str(error).strip() or "\n" in str(error):
                faults.append(f"{name}: {type(error).__name__} without a line")
        except Exception as error:  # anything else is what is looked for
            faults.append(f"{name}: {type(error).__name__}")
        else:
            faults.append(f"{name}: accepted")
    return faults
