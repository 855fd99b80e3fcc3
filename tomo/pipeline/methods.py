"""The reconstruction methods by name, and what each needs."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass

from tomo import solvers, wernet
from tomo.solvers import Solution

AUTO = "auto"
_WERNET = {"wernet": "wernet", "wernet-paper": "wernet_paper"}


@dataclass(frozen=True)
class Method:
    """A method that can be asked for by name; ``auto`` chooses smoothness by pixels left out."""

    name: str
    needs_midpoints: bool = False  # of every segment
    needs_matrix: bool = False  # goes through its entries: a stored one

    @property
    def through_lenses(self) -> bool:
        """Whether it can go through lenses that spread the light of single lines."""
        return self.name == "wernet" or not self.needs_matrix

    @property
    def starts_from_default(self) -> bool:
        """Whether images are corrected and weighted, and volumes solved for, as by ``auto``."""
        return self.name in (AUTO, "wernet")

    @property
    def solver(self) -> Callable[..., Solution]:
        """The solver itself, imported now; ``auto`` has none of its own."""
        if self.name in _WERNET:
            return getattr(wernet, _WERNET[self.name])
        return getattr(solvers, self.name)

    def takes(self, name: str) -> bool:
        """Whether the solver has an argument of that name; ``auto`` has none."""
        return self.name != AUTO and name in inspect.signature(self.solver).parameters

    @property
    def default_iterations(self) -> int:
        """How many iterations the solver runs when none is given; ``auto`` has no such number."""
        return inspect.signature(self.solver).parameters["iterations"].default

    def arguments(self, **given: object) -> dict[str, object]:
        """Return those of the arguments that the solver takes and that are not None."""
        return {k: v for k, v in given.items() if v is not None and self.takes(k)}


def method_names() -> tuple[str, ...]:
    """Return the names that `method_named` knows."""
    return (AUTO, *solvers.METHODS, *_WERNET)


def method_named(name: str) -> Method:
    """Return the method called ``name``."""
    if name not in method_names():
        raise ValueError(f"method: found {name!r}, expected one of {', '.join(method_names())}")
    if name in solvers.METHODS:
        return Method(name, needs_matrix=not solvers.METHODS[name].any_basis)
    learns = name in _WERNET
    return Method(name, needs_midpoints=learns, needs_matrix=learns)
