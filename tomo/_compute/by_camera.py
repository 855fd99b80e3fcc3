"""What a report says of every camera: under its name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray


def by_name(names: Sequence[str], values: NDArray) -> dict[str, Any]:
    """Return plain numbers, or lists of them, by name.

    Parameters
    ----------
    names : (cameras,) sequence of str
    values : (cameras, ...)

    Raises
    ------
    ValueError
        If there are not as many as names.
    """
    return dict(zip(names, values.tolist(), strict=True))
