"""Figures of a value each of which may be unknown: plain floats in a range, or one line."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields
from typing import Any


def check_figures(owner: Any, name: str, is_right: Callable[[float], bool], expected: str) -> None:
    """Make the numbers of a frozen dataclass plain floats, so that values compare and hash.

    None stays. ``is_right`` says whether a finite number is in range, ``expected`` the same in
    words, ``name`` what files call the whole.

    Raises
    ------
    ValueError
        One line that names the first figure that is no such number.
    """
    for field in fields(owner):
        found = getattr(owner, field.name)
        if found is None:
            continue
        try:
            value = float(found)
        except (TypeError, ValueError, OverflowError):
            value = math.nan
        if not (math.isfinite(value) and is_right(value)) or isinstance(found, bool):
            raise ValueError(f"{name}.{field.name}: found {found!r}, expected {expected}")
        object.__setattr__(owner, field.name, value)
