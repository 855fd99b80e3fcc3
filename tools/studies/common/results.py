"""The results of a study as plain data in JSON, and an earlier run to go on from."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from studies.common.fingerprint import origin
from studies.common.machine import machine

if TYPE_CHECKING:
    from studies.common.study import Request


def fresh_run(study: str, version: int, request: Request) -> dict[str, Any]:
    """Return the result of no part yet."""
    return {
        "study": study,
        "version": version,
        "size": request.size,
        "seed": request.seed,
        "machine": machine(),
        **origin(),
        "parts": {},
    }


def kept_run(path: Path, fresh: dict[str, Any]) -> dict[str, Any]:
    """Return what an earlier run left, to go on from it; ``fresh`` where there is nothing.

    Raises
    ------
    ValueError
        If it is of another study, or was of another size, seed or machine.
    """
    if not path.is_file():
        return fresh
    try:
        result = json.loads(path.read_text("utf-8"))
        known = all(result[key] == fresh[key] for key in ("study", "version"))
        known = known and isinstance(result["parts"], dict)
        settings = {key: (result[key], fresh[key]) for key in ("size", "seed")}
        for key in ("cpu", "cores"):
            settings[key] = result["machine"][key], fresh["machine"][key]
    except (ValueError, KeyError, TypeError):
        known = False
    if not known:
        raise ValueError(f"{path}: expected the result of an earlier {fresh['study']} run")
    for key, (found, expected) in settings.items():
        if found != expected:
            raise ValueError(f"{path}: --resume: {key}: found {found!r}, expected {expected!r}")
    return result
