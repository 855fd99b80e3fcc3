"""Commands from declarations: signatures and docstrings of functions, and fields of dataclasses.

A command is a function. Its positional-only parameters are arguments, its keyword-only ones are
options; one that is annotated with a dataclass stands for an option for each field. What
``--help`` says of them is in the docstrings, as numpydoc has it: ``name : METAVAR``, then the
text. A title other than Parameters is a section of the help. The fields of a
`tomo.pipeline.declared.Declared` say it themselves.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import types
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer

from tomo.cli.console import OneLineUsage, bad_input_in_one_line, flag
from tomo.pipeline.declared import Check, Declared, number, whole

OTHERS = "More options"
"""The section of options that have none of their own, where others come first."""

_Said = tuple[str, str, str | None]  # metavar, help, section
_NONE = inspect.Parameter.empty
_SAID = {
    "json": ("", "Print one JSON object on stdout."),
    "out": ("FOLDER", "The folder to write."),
    "scan": ("SCAN", "A scan folder, scan.yaml or transforms.json."),
    "rig": ("RIG", "A rig.yaml, a preset's name, a scan, or a file of another format."),
    "pattern": (
        "PATTERN",
        "How the files of --images are named, where not as CAMERA/FRAME.tif, CAMERA_FRAME.tif or "
        "CAMERA.tif: '{frame}/{camera}.png', say.",
    ),
}
"""Metavar and help of what means the same in several commands."""

_TITLE = re.compile(r"^(\S.*)\n-{3,}\n", re.MULTILINE)
_ENTRY = re.compile(r"^(\w+) : *(.*)\n((?:(?:    .*)?(?:\n|\Z))*)", re.MULTILINE)


def _path(text: str) -> Path:
    if not text:  # it would be the present folder
        raise ValueError
    return Path(text)


_CHECKS = {int: whole(), float: number(), Path: Check("a path", _path, metavar="FILE")}


@dataclass(frozen=True)
class Given:
    """An argument or option of a command."""

    name: str
    default: Any  # `inspect.Parameter.empty` where one has to be given
    is_argument: bool
    is_switch: bool
    is_many: bool  # it can be repeated
    check: Check | None  # converts a value; text stays as it is without
    help: str
    metavar: str
    section: str | None  # of the help

    def for_typer(self) -> inspect.Parameter:
        """Return the parameter of texts, or the flag, that typer parses."""
        said: dict[str, Any] = {"help": self.help, "metavar": self.metavar}
        if self.is_argument:
            info: Any = typer.Argument(show_default=False, **said)
        elif self.is_switch:
            both = "" if self.default is False else f"/{flag(f'no_{self.name}')}"
            info = typer.Option(flag(self.name) + both, help=self.help)
        else:
            info = typer.Option(flag(self.name), *["-o"] * (self.name == "out"), **said)
        info.rich_help_panel = self.section
        default, kind = self.default, Annotated[str | None, info]
        if self.is_switch:
            kind = Annotated[bool | None, info]
        elif self.is_many:
            default, kind = (_NONE if default is _NONE else []), Annotated[list[str], info]
        elif default not in (None, _NONE):
            default = str(default)
        only = inspect.Parameter.KEYWORD_ONLY
        return inspect.Parameter(self.name, only, default=default, annotation=kind)

    def value_of(self, parsed: Any) -> Any:
        """Return what the function takes for what typer has parsed."""
        if not self.is_many:
            return parsed if parsed is None or self.is_switch else self._converted(parsed)
        return [self._converted(text) for text in parsed] if parsed else self.default

    def _converted(self, text: str) -> Any:
        name = self.metavar if self.is_argument else flag(self.name)
        return text if self.check is None else converted(self.check, text, name)


def converted(check: Check, text: str, name: str) -> Any:
    """Return the value of a text; what is wrong is a line that begins with a name."""
    try:
        return check.convert(text)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: found {text!r}, {check.instead_of(text)}") from None


def command_line(
    function: Callable[..., None],
    name: str,
    *,
    help: str = "",
    epilog: str | None = None,
    first: Sequence[str] = (),
) -> typer.Typer:
    r"""Return the command line of a function: one as the module says, or with typer's annotations.

    ``help`` and ``epilog`` stand above and below the options, after what the docstring says, lines
    below a line ``\b`` as they are. The help begins with the ``first`` options.
    """
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    parameters = inspect.signature(function, eval_str=True).parameters.values()
    groups = {one.name: one.annotation for one in parameters if _is_group(one.annotation)}
    if any(one.kind is not one.POSITIONAL_OR_KEYWORD for one in parameters):
        given = [_among(one, first) for one in _given_of(function)]
        given.sort(key=lambda one: first.index(one.name) if one.name in first else len(first))
        about = _TITLE.split(f"{inspect.getdoc(function) or ''}\n")[0]
        help, function = f"{about}\n\n{help}", _run(function, given, groups)
    app.command(name=name, cls=OneLineUsage, help=help, epilog=epilog)(function)
    return app


def _run(
    function: Callable[..., None], given: Sequence[Given], groups: dict[str, type]
) -> Callable[..., None]:
    """Return what typer calls with texts and flags: it calls the function with values."""

    def run(**parsed: Any) -> None:
        with bad_input_in_one_line():
            values = {one.name: one.value_of(parsed[one.name]) for one in given}
            arguments = [values.pop(one.name) for one in given if one.is_argument]
            for name, kind in groups.items():
                names = [field.name for field in dataclasses.fields(kind)]
                values[name] = _made(kind, {field: values.pop(field) for field in names})
            function(*arguments, **values)

    made = [one.for_typer() for one in given]
    run.__signature__ = inspect.Signature(made)  # type: ignore[attr-defined]  # read by inspect
    run.__annotations__ = {one.name: one.annotation for one in made}
    return run


def _made(kind: type, values: dict[str, Any]) -> Any:
    """Return a dataclass; an error names the option as it is typed."""
    try:
        return kind(**{k: tuple(v) if isinstance(v, list) else v for k, v in values.items()})
    except ValueError as error:
        name, _, rest = str(error).partition(":")
        raise ValueError(f"{flag(name)}:{rest}") from None


def _given_of(function: Callable[..., None]) -> Iterator[Given]:
    """Yield the arguments and options of a function, in the order of its parameters."""
    said = _said_in(function)
    for one in inspect.signature(function, eval_str=True).parameters.values():
        if not _is_group(one.annotation):
            is_argument = one.kind is one.POSITIONAL_ONLY
            yield _given(one.name, one.annotation, one.default, is_argument, said)
            continue
        own, kinds = _said_in(one.annotation), get_type_hints(one.annotation, include_extras=True)
        for field in dataclasses.fields(one.annotation):
            if issubclass(one.annotation, Declared):
                yield _declared(field, kinds[field.name])
            else:
                yield _given(field.name, kinds[field.name], field.default, False, own)


def _given(name: str, kind: Any, default: Any, is_argument: bool, said: dict[str, _Said]) -> Given:
    """Return the argument or option of a parameter or field, by its type."""
    check = None
    if get_origin(kind) is Annotated:
        kind, check = get_args(kind)
    plain = [one for one in get_args(kind) if one is not types.NoneType] or [kind]
    one = plain[0] if isinstance(kind, types.UnionType) else kind
    is_many = get_origin(one) is Sequence
    one = get_args(one)[0] if is_many else one
    metavar, text, section = said.get(name, (*_SAID.get(name, ("", "")), None))
    check = check or _CHECKS.get(one)
    metavar = metavar or (check and check.metavar) or "TEXT"
    return Given(name, default, is_argument, one is bool, is_many, check, text, metavar, section)


def _declared(field: dataclasses.Field, kind: Any) -> Given:
    """Return the option of a declared field, which converts its text itself."""
    said = field.metadata
    text = said["help"]
    if choices := said["check"].choices:
        text += f" One of {', '.join(choices)}."
    is_switch, is_many = kind in (bool, bool | None), field.default == ()
    return Given(
        field.name, field.default, False, is_switch, is_many, None, text,
        said["metavar"] or "TEXT", said["topic"],
    )  # fmt: skip


def _among(one: Given, first: Sequence[str]) -> Given:
    """Return an option in the section that it has where some come first."""
    if not first or one.is_argument:
        return one
    return replace(one, section=None if one.name in first else one.section or OTHERS)


def _is_group(annotation: Any) -> bool:
    return isinstance(annotation, type) and dataclasses.is_dataclass(annotation)


def _said_in(documented: Any) -> dict[str, _Said]:
    """Return metavar, help and section of what a docstring describes; none of it with -OO."""
    found: dict[str, _Said] = {}
    _, *parts = _TITLE.split(f"{inspect.getdoc(documented) or ''}\n")
    for title, text in zip(parts[::2], parts[1::2], strict=True):
        section = None if title == "Parameters" else title
        for name, metavar, about in _ENTRY.findall(text):
            found[name] = (metavar, " ".join(about.split()), section)
    return found
