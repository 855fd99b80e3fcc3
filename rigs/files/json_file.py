"""JSON files: NumPy's numbers become plain ones, NaN and infinity null."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigs.files.atomic import atomic_path


def plain(value: Any, digits: int | None = None) -> Any:
    """Return data as JSON holds it: text keys, lists, null for NaN and infinity.

    Parameters
    ----------
    value : mapping, list, tuple, str, bool, number or None
        Numbers of NumPy's kinds too.
    digits : int, optional
        Significant digits to keep; all when None.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(inner, digits) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner, digits) for inner in value]
    if hasattr(value, "item"):
        value = value.item()
    if not isinstance(value, float):
        return value
    if not math.isfinite(value):
        return None
    return value if digits is None else float(f"{value:.{digits}g}")


def write_json(path: Path, value: Any, indent: int | None = None) -> None:
    """Write plain data to a file atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(value, indent=indent) + "\n", "utf-8")
