"""Values whose fields are declared with their check and their documentation, each once."""

from __future__ import annotations

import dataclasses
import math
import os
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass
from numbers import Integral, Real
from typing import Any, Self, TypeVar

from rigs.files.text import expected_one_of
from tomo.operators.gpu.names import DEVICES, device_number


@dataclass(frozen=True)
class Check:
    """How a value is accepted."""

    expected: str  # the values allowed, for messages: found X, expected ...
    convert: Callable[[Any], Any]  # to its own type; raises ValueError or TypeError
    choices: tuple[str, ...] = ()  # the words allowed where there is nothing else
    metavar: str | None = None  # stands for a value in --help

    def instead_of(self, value: Any) -> str:
        """Return what was expected instead of a value, or what it is like."""
        if self.choices and isinstance(value, str):
            return expected_one_of(value, self.choices)
        return f"expected {self.expected}"


def _or_none(
    convert: Callable[[Any], Any], words: Sequence[str] = (), optional: bool = True
) -> Callable[[Any], Any]:
    """Return a conversion that leaves some words as they are, and None where it is optional."""

    def convert_others(value: Any) -> Any:
        is_word = isinstance(value, str) and value in words
        return value if is_word or (value is None and optional) else convert(value)

    return convert_others


def choice(*words: str) -> Check:
    """Accept one of some words."""
    return Check(f"one of {', '.join(words)}", lambda value: words[words.index(value)], words)


def switch(*, optional: bool = False) -> Check:
    """Accept True and False, and None where it is optional."""

    def convert(value: Any) -> bool:
        return bool((False, True).index(value))

    expected = "True, False or None" if optional else "True or False"
    return Check(expected, _or_none(convert, optional=optional))


def text() -> Check:
    """Accept text that is not empty, and None."""

    def convert(value: Any) -> str:
        if not isinstance(value, str) or not value:
            raise TypeError
        return value

    return Check("text", _or_none(convert))


def device() -> Check:
    """Accept the name of a device."""

    def convert(value: Any) -> str:
        device_number(value)
        return str(value)

    return Check(DEVICES, convert)


def path() -> Check:
    """Accept the path of a file, or None."""
    return Check("a path", _or_none(os.fspath), metavar="FILE")


def names(*, optional: bool = False) -> Check:
    """Accept names in a sequence, or in one text with commas between them."""

    def convert(value: Any) -> tuple[str, ...]:
        parts = [part.strip() for part in value.split(",")] if isinstance(value, str) else value
        if not all(isinstance(part, str) for part in parts):
            raise TypeError
        return tuple(parts)

    return Check("names of cameras", _or_none(convert, optional=optional))


def whole(
    lower: float = -math.inf,
    upper: int | None = None,
    *,
    words: tuple[str, ...] = (),
    but: tuple[int, ...] = (),
    optional: bool = False,
    expected: str | None = None,
) -> Check:
    """Accept a whole number within bounds, one of some words, and None where it is optional."""

    def convert(value: Any) -> int:
        number: Any = value if isinstance(value, Integral) else _whole_float(value)
        if isinstance(value, bool) or number < lower or number in but:
            raise ValueError
        if upper is not None and number > upper:
            raise ValueError
        return int(number)

    bounds = f" >= {lower}" if lower > -math.inf else ""
    if upper is not None:
        bounds = f" from {lower} to {upper}"
    return Check(
        expected or f"a whole number{bounds}", _or_none(convert, words, optional), (), "N"
    )


def number(
    lower: float = -math.inf,
    *,
    above: float = -math.inf,
    words: tuple[str, ...] = (),
    optional: bool = False,
) -> Check:
    """Accept a finite number, one of some words, and None where it is optional."""

    def convert(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, Real | str):
            raise TypeError
        found = float(value)
        if not (math.isfinite(found) and found >= lower and found > above):
            raise ValueError
        return found

    bound = f"a number >= {lower:g}" if lower > -math.inf else "a number"
    bound = f"a number above {above:g}" if above > -math.inf else bound
    expected = " or ".join([", ".join(words), bound][not words :])
    return Check(expected, _or_none(convert, words, optional), (), "X")


def comparisons(known: Sequence[str]) -> Check:
    """Accept methods, each as ``METHOD`` or ``METHOD:ITERATIONS``."""

    def convert(value: Any) -> tuple[str, ...]:
        if isinstance(value, str):
            raise TypeError
        for one in value:
            if comparison(one)[0] not in known:
                raise ValueError
        return tuple(value)

    return Check(f"METHOD or METHOD:ITERATIONS, of the methods {', '.join(known)}", convert)


def comparison(written: str) -> tuple[str, int | None]:
    """Return method and iterations of ``METHOD`` or ``METHOD:ITERATIONS``."""
    match = re.fullmatch(r"([\w-]+)(?::(\d{1,6}))?", written, re.ASCII)
    if match is None:
        raise ValueError(f"compare: found {written!r}, expected METHOD or METHOD:ITERATIONS")
    return match[1], int(match[2]) if match[2] else None


def _whole_float(value: Any) -> int:
    """Return a whole number that was written as text or as a float."""
    found = float(value)
    if found != int(found):
        raise ValueError
    return int(value) if isinstance(value, str) and value.isdecimal() else int(found)


T = TypeVar("T", bound="Declared")


def option(
    default: Any, help: str, check: Check, *, topic: str | None = None, metavar: str | None = None
) -> Any:
    """Declare an option: its default, its documentation, its check, its section of the help."""
    metavar = metavar or check.metavar
    metadata = {"help": help, "check": check, "topic": topic, "metavar": metavar}
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Declared:
    """The base of a frozen dataclass whose fields are declared by `option`."""

    def __new__(cls, *values: Any, **named: Any) -> Self:
        """Refuse names that are unknown."""
        known = [option.name for option in dataclasses.fields(cls)]
        for name in named:
            if name not in known:
                raise ValueError(f"options: found {name!r}, {expected_one_of(name, known)}")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        """Check every value, and keep it in the type of its declaration."""
        for option in dataclasses.fields(self):
            value = getattr(self, option.name)
            check = option.metadata["check"]
            try:
                object.__setattr__(self, option.name, check.convert(value))
            except (TypeError, ValueError, OverflowError):
                raise ValueError(
                    f"{option.name}: found {value!r}, {check.instead_of(value)}"
                ) from None

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Self:
        """Return the options of a mapping such as report.json's ``settings``, each checked."""
        return cls(**values)

    def but(self, **others: Any) -> Self:
        """Return these options with some others; errors as of `from_mapping`."""
        return self.from_mapping(self.to_mapping() | others) if others else self

    def to_mapping(self) -> dict[str, Any]:
        """Return every option by name, as JSON holds them; `from_mapping` takes it back."""
        values = {option.name: getattr(self, option.name) for option in dataclasses.fields(self)}
        return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}


def documented(declared: type[T]) -> type[T]:
    """Append the numpy-style list of the options to the docstring, from their declarations."""
    if not declared.__doc__:  # python -OO has none
        return declared
    lines = ["", "", "Parameters", "----------"]
    for option in dataclasses.fields(declared):
        lines.append(f"{option.name} : {option.type}")
        lines += textwrap.wrap(_described(option), 91, initial_indent="    ",
                               subsequent_indent="    ")  # fmt: skip
    text = "\n".join(f"    {line}".rstrip() for line in lines)
    declared.__doc__ = f"{declared.__doc__.rstrip()}{text}\n    "
    return declared


def _described(option: Field) -> str:
    """Return what an option means, its choices and its default, as documentation shows it."""
    said = option.metadata["help"]
    choices = option.metadata["check"].choices
    if choices:
        said += f" One of {', '.join(choices)}."
    if option.default is MISSING or option.default in (None, ()):
        return said
    return f"{said} Default: {option.default}."
