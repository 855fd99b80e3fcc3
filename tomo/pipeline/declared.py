"""Values whose fields are declared with their check and their documentation, each once."""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Self, TypeVar

from rigs.files.text import expected_one_of
from tomo.pipeline.checks import Check

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
    """The base of a frozen dataclass whose fields are declared by `option`.

    Attributes
    ----------
    gone : mapping
        Names of earlier options, and what to use in their place.
    """

    gone: ClassVar[Mapping[str, str]] = MappingProxyType({})

    def __init_subclass__(cls, gone: Mapping[str, str] | None = None) -> None:
        """Keep the names that are gone."""
        if gone is not None:
            cls.gone = MappingProxyType(dict(gone))

    def __new__(cls, *values: Any, **named: Any) -> Self:
        """Refuse names that are unknown or gone."""
        for name in named:
            cls.check_name(name)
        return super().__new__(cls)

    @classmethod
    def check_name(cls, name: str) -> None:
        """Raise unless there is an option of that name."""
        if name in cls.gone:
            raise ValueError(f"{name}: found an option that is gone: {cls.gone[name]}")
        known = [option.name for option in dataclasses.fields(cls)]
        if name not in known:
            raise ValueError(f"options: found {name!r}, {expected_one_of(name, known)}")

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
        """Return the options of a mapping such as report.json's ``settings``.

        Raises
        ------
        ValueError
            If a name is unknown, or a value is not allowed.
        """
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
