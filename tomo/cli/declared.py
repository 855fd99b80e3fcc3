"""Options of a command that are made from the declarations of a dataclass."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

T = TypeVar("T")


def with_options_of(declared: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a function that takes ``**values`` an option for each field of a dataclass.

    A field's metadata has ``help``, ``metavar``, ``topic`` and ``check.choices``. An option
    takes text, which the dataclass converts and checks. An option whose default is an empty tuple
    can be repeated. In the help the options come before the function's keyword-only parameters.
    """

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        signature = inspect.signature(function, eval_str=True)
        own = list(signature.parameters.values())
        first = [one for one in own if one.kind is one.POSITIONAL_OR_KEYWORD]
        last = [one for one in own if one.kind is one.KEYWORD_ONLY]
        types = get_type_hints(declared)
        made = [_parameter(field, types[field.name]) for field in dataclasses.fields(declared)]
        parameters = [*first, *made, *last]
        made_anew = signature.replace(parameters=parameters)
        function.__signature__ = made_anew  # type: ignore[attr-defined]  # read by inspect
        function.__annotations__ = {one.name: one.annotation for one in parameters}
        return function

    return decorate


def declared_from(declared: type[T], values: dict[str, Any]) -> T:
    """Return the dataclass of the values that a command was given.

    Raises
    ------
    ValueError
        Naming the option as it is written on the command line.
    """
    values = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
    try:
        return declared(**values)
    except ValueError as error:
        name, _, rest = str(error).partition(":")
        raise ValueError(f"{_flag(name)}:{rest}") from None


def _parameter(field: dataclasses.Field, kind: Any) -> inspect.Parameter:
    """Return the parameter of a command for a field."""
    choices = ", ".join(field.metadata["check"].choices)
    settings = {
        "help": field.metadata["help"] + (f" One of {choices}." if choices else ""),
        "metavar": field.metadata["metavar"],
        "rich_help_panel": field.metadata["topic"],
    }
    default: Any = None if field.default is None else str(field.default)
    names = [_flag(field.name)]
    if kind in (bool, bool | None):
        kind, default = bool | None, field.default
        if field.default is not False:
            names = [f"{names[0]}/{names[0].replace('--', '--no-', 1)}"]
    elif field.default == ():
        kind, default = list[str], []
    else:
        kind = str | None
    return inspect.Parameter(
        field.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=default,
        annotation=Annotated[kind, typer.Option(*names, **settings)],
    )


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")
