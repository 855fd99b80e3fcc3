"""What a scan.yaml may hold: every field checked before anything else sees it."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from rigs._text import read_yaml_mapping


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class _Grid(_Strict):
    shape: list[int]
    spacing: float | list[float]
    center: list[float] = [0.0, 0.0, 0.0]


class _Frame(_Strict):
    name: Annotated[str, Field(min_length=1)]
    images: dict[str, str]


def _one_or_each(expected: str, accepts: Callable[[Any], bool]) -> Any:
    """Return the type of a correction: one value for all cameras, or a mapping to values."""

    def check(value: Any) -> Any:
        if value is None:
            return None
        each = value if isinstance(value, dict) else {None: value}
        for camera, one in each.items():
            if (camera is None and isinstance(value, dict)) or not accepts(one):
                where = "" if camera is None else f"camera {_plain(camera)}: "
                found = reprlib.repr(one)
                raise ValueError(f"{where}found {found}, expected {expected} or one per camera")
        return value

    return Annotated[Any, BeforeValidator(check)]


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < 1e300 and math.isfinite(value)


def _is_path(value: Any) -> bool:
    return isinstance(value, str) and value != ""


def _is_positive(value: Any) -> bool:
    return _is_number(value) and value > 0


def _is_bit_depth(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= 16


_Number = _one_or_each("a number, an image's path", lambda v: _is_number(v) or _is_path(v))
_Positive = _one_or_each("a positive number", _is_positive)
_Flat = _one_or_each(
    "a positive number, an image's path", lambda v: _is_positive(v) or _is_path(v)
)
_Mask = _one_or_each("an image's path", _is_path)
_BitDepth = _one_or_each("a whole number from 1 to 16", _is_bit_depth)


class _Corrections(_Strict):
    dark: _Number = None
    flat: _Flat = None
    gain: _Positive = None
    mask: _Mask = None
    saturation: _Positive = None
    bit_depth: _BitDepth = None


class _Effects(_Strict):
    """The fields of `tomo.effects.Effects`, which checks their ranges, and the cameras' gains."""

    gain_spread: float = 0.0
    absorption: float = 0.0
    self_absorption: float = 0.0
    vignetting: float = 0.0
    aperture: float = 0.0
    focus_distance: float | None = None
    aperture_rays: int = 32
    gains: dict[str, float] = {}


class ScanFile(_Strict):
    format: Literal["emission-scan"]
    version: Literal[1]
    rig: str
    grid: _Grid | None = None
    frames: Annotated[list[_Frame], Field(min_length=1)]
    corrections: _Corrections = _Corrections()
    truth: str | None = None
    effects: _Effects | None = None


def parse_scan_file(path: Path) -> ScanFile:
    """Return the checked content of a scan.yaml; whatever is wrong is one line."""
    content = read_yaml_mapping(path)
    try:
        return ScanFile.model_validate(content)
    except ValidationError as error:
        raise ValueError(f"{path}: {_first_problem(error)}") from None
    except (RecursionError, ValueError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None


def _first_problem(error: ValidationError) -> str:
    problem = error.errors(include_url=False)[0]
    where = ".".join(_plain(part) for part in problem["loc"])
    if problem["type"] == "missing":
        return f"{where}: found none, expected one"
    if problem["type"] == "extra_forbidden":
        return f"{where}: found an unknown field, expected only known ones"
    if problem["type"] == "value_error":
        return f"{where}: {problem['ctx']['error']}"
    expected = problem["msg"].removeprefix("Input should be ")
    return f"{where}: found {reprlib.repr(problem['input'])}, expected {expected}"


def _plain(name: Any) -> str:
    """Return a name from the file fit for one line."""
    return str(name).encode("unicode_escape").decode()
