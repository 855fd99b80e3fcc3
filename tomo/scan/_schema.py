"""The content of a scan.yaml: every field checked before anything else sees it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, ValidationError

from rigs.files.messages import dotted, first_problem
from rigs.files.schema import Number, Text, VolumeEntry, Whole
from rigs.files.text import read_yaml_mapping, shortened
from rigs.recordings import MOST_BITS
from rigs.recordings.film_formats.raw_film import PIXEL_TYPES
from rigs.recordings.mosaic import COLOURS, PATTERNS, is_channel

SCAN_FORMAT = "emission-scan"


def _only(accepts: Callable[[Any], bool], expected: str) -> AfterValidator:
    """Return the check that refuses a value that is not accepted."""

    def check(value: Any) -> Any:
        if not accepts(value):
            shown = "none" if value == [] else f"{value:g}" if value != "" else "''"
            raise ValueError(f"found {shown}, expected {expected}")
        return value

    return AfterValidator(check)


_named = _only(bool, "a name")
_some = _only(bool, "at least one")
_from_zero = _only(lambda number: number >= 0, "0 or more")
_from_one = _only(lambda number: number >= 1, "1 or more")
_above_zero = _only(lambda number: number > 0, "a number above 0")


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class _Frame(_Strict):
    name: Annotated[Text, _named]
    images: dict[str, Text]


class _Raw(_Strict):
    width: Annotated[Whole, _from_one]
    height: Annotated[Whole, _from_one]
    dtype: Literal[PIXEL_TYPES]  # type: ignore[valid-type]  # a tuple of words, elsewhere
    byte_order: Literal["little", "big"] = "little"
    header_bytes: Annotated[Whole, _from_zero] = 0
    gap_bytes: Annotated[Whole, _from_zero] = 0


class _Film(_Strict):
    path: Text
    raw: _Raw | None = None
    first: Annotated[Whole, _from_zero] = 0
    step: Annotated[Whole, _from_one] = 1
    offset: Whole = 0


def _film(entry: Any) -> Any:
    """Let a path stand for a film without further settings."""
    return {"path": entry} if isinstance(entry, str) else entry


def _one_or_each(
    expected: str, accepts: Callable[[Any], bool], read: Callable[[Any], Any] = lambda value: value
) -> BeforeValidator:
    """Return the check of a correction: one value for all cameras, or a mapping to values."""

    def check(value: Any) -> Any:
        if value is None:
            return None
        many = isinstance(value, Mapping)
        each = {key: read(one) for key, one in (value if many else {None: value}).items()}
        for camera, one in each.items():
            if (camera is None and many) or not accepts(one):
                where = "" if camera is None else f"camera {dotted([camera])}: "
                raise ValueError(
                    f"{where}found {shortened(one)}, expected {expected}, or one per camera"
                )
        return each if many else each[None]

    return BeforeValidator(check)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < 1e300 and math.isfinite(value)


def _number_in_text(value: Any) -> Any:
    """Return the number of a text like ``1e-3``, which YAML 1.1 reads as text."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _is_path(value: Any) -> bool:
    """Tell whether a value is an image's path; a program may give arrays too."""
    return isinstance(value, Path | np.ndarray) or (isinstance(value, str) and value != "")


def _is_positive(value: Any) -> bool:
    return _is_number(value) and value > 0


def _is_bit_depth(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= MOST_BITS


def _is_region(value: Any) -> bool:
    whole = isinstance(value, list) and all(type(one) is int for one in value)
    return whole and len(value) == 4 and min(value[:2]) >= 0 and min(value[2:]) > 0


_Number = _one_or_each("a number or an image's path", lambda v: _is_number(v) or _is_path(v))
_Positive = _one_or_each("a positive number", _is_positive, _number_in_text)
_Flat = _one_or_each(
    "a positive number or an image's path", lambda v: _is_positive(v) or _is_path(v)
)
_Mask = _Image = _one_or_each("an image's path", _is_path)
_Region = _one_or_each("[x, y, width, height] in whole pixels", _is_region)
_Transmission = _one_or_each(
    "a number above 0 up to 1", lambda v: _is_positive(v) and v <= 1, _number_in_text
)
_BitDepth = _one_or_each(f"a whole number from 1 to {MOST_BITS}", _is_bit_depth)
_Bayer = _one_or_each(f"one of {', '.join(PATTERNS)}", lambda v: v in PATTERNS)
_Channel = _one_or_each(
    f"one of {', '.join(COLOURS)}, or a film's channel, counted from 0",
    is_channel,
    lambda v: str(v) if type(v) is int else v,
)


class _Corrections(_Strict):
    dark: Annotated[Any, _Number] = None
    flat: Annotated[Any, _Flat] = None
    gain: Annotated[Any, _Positive] = None
    mask: Annotated[Any, _Mask] = None
    saturation: Annotated[Any, _Positive] = None
    bit_depth: Annotated[Any, _BitDepth] = None
    bayer: Annotated[Any, _Bayer] = None
    channel: Annotated[Any, _Channel] = None


class _Conditions(_Strict):
    exposure: Annotated[Any, _Positive] = None
    f_number: Annotated[Any, _Positive] = None
    transmission: Annotated[Any, _Transmission] = None


class _Calibration(_Conditions):
    factor: Annotated[Any, _Positive] = None
    image: Annotated[Any, _Image] = None
    radiance: Annotated[Any, _Positive] = None
    region: Annotated[Any, _Region] = None
    dark: Annotated[Any, _Number] = None


class _Radiometry(_Conditions):
    """The fields of `tomo.scan.radiometry.Radiometry`, which checks the units."""

    unit: Text
    calibration: _Calibration
    volume_unit: Text | None = None
    wavelength: Annotated[Number, _above_zero] | None = None


class _Effects(_Strict):
    """The fields of `tomo.simulation.effects.Effects`, which checks them, and the gains."""

    gain_spread: Number = 0.0
    absorption: Number = 0.0
    self_absorption: Number = 0.0
    vignetting: Number = 0.0
    aperture: Number | Literal["optics"] = 0.0
    focus_distance: Number | None = None
    aperture_rays: Whole = 32
    gains: dict[str, Annotated[Number, _above_zero]] = {}


class ScanFile(_Strict):
    format: Literal["emission-scan"]
    version: Literal[1]
    rig: Text
    grid: VolumeEntry | None = None
    frames: Annotated[list[_Frame], _some] | None = None
    films: dict[str, Annotated[_Film, BeforeValidator(_film)]] | None = None
    images: Annotated[Text, _named] | None = None
    frame_rate: Annotated[Number, _above_zero] | None = None
    corrections: _Corrections = _Corrections()
    radiometry: _Radiometry | None = None
    peak: Annotated[Number, _above_zero] | None = None
    truth: Text | None = None
    effects: _Effects | None = None


def parse_scan_file(path: Path) -> ScanFile:
    """Return the checked content of a scan.yaml; whatever is wrong is one line."""
    content = read_yaml_mapping(path)
    try:
        found = ScanFile.model_validate(content)
    except ValidationError as error:
        steps, said = first_problem(error, ScanFile, content)
        raise ValueError(f"{path}: {_where(steps, content)}: {said}") from None
    given = [name for name in ("frames", "films", "images") if getattr(found, name) is not None]
    if not given or found.films == {}:
        raise ValueError(
            f"{path}: frames: missing, expected a list of mappings, or films, or images"
        )
    if len(given) > 1:
        raise ValueError(f"{path}: {given[1]}: found {given[0]} too, expected one of the two")
    return found


def checked_corrections(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the corrections of a command or a program, checked as those of a scan.yaml are."""
    try:
        return _Corrections.model_validate(given).model_dump()
    except ValidationError as error:
        steps, said = first_problem(error, _Corrections, given)
        raise ValueError(f"{dotted(steps)}: {said}") from None


def _where(steps: list[str | int], content: dict[str, Any]) -> str:
    """Return the frame by name, where it has one, and the field."""
    if steps[0] == "frames" and len(steps) > 2:
        name = content["frames"][steps[1]].get("name")
        frame = f"frame {name!r}" if isinstance(name, str) and name else dotted(steps[:2])
        return f"{frame}: {dotted(steps[2:])}"
    return dotted(steps)
