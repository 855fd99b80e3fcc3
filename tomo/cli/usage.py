"""Help that reads well on 80 columns, and wrong usage in one line as all other bad input."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperCommand

from tomo.cli.errors import end

_NO_BREAK = "\N{NON-BREAKING HYPHEN}"
"""Stands for a hyphen while lines are broken, so that no name is cut."""

_METAVARS = {
    "<int range>": "N",
    "<int>": "N",
    "<float>": "X",
    "<str>": "TEXT",
    "<list[str]>": "TEXT",
    "<path>": "FILE",
}
"""Values in the help, by the names of types that typer gives them."""

if TYPE_CHECKING:
    from typer._click.exceptions import UsageError
else:
    UsageError = typer.BadParameter.__base__  # typer's own or click's, as the version has it


class OneLineUsage(TyperCommand):
    """A command whose errors about its options and arguments are one line, with exit code 2."""

    def make_context(
        self, info_name: str | None, args: list[str], *rest: Any, **extra: Any
    ) -> Any:
        """Return the context of the parsed arguments, or say in one line what is wrong."""
        given = list(args)  # parsing takes them away
        try:
            context = super().make_context(info_name, args, *rest, **extra)
        except UsageError as error:
            _end(error, given)
        if "" in given:  # as a path it would be the present folder
            parsed, _, _ = self.make_parser(context).parse_args(list(given))
            for param in self.params:
                if parsed.get(param.name) == "" and isinstance(context.params[param.name], Path):
                    name = param.opts[-1] if param.param_type_name == "option" else param.metavar
                    see = f"see {context.command_path} --help"
                    end(f"error: {name}: found '', expected a path; {see}", 2)
        return context

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the parts of the usage line."""
        return [piece.strip("{}") for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write one section for the arguments and one for each panel of options."""
        sections: dict[str, list] = {"Arguments": [], "Options": []}
        for param in self.get_params(ctx):
            is_option = param.param_type_name == "option"
            panel = getattr(param, "rich_help_panel", None)
            title = panel or ("Options" if is_option else "Arguments")
            record = param.get_help_record(ctx)
            if record is not None:
                names, text = record
                sections.setdefault(title, []).append((_named(names, is_option), text))
        for title, records in sections.items():
            if not records:
                continue
            with formatter.section(title):
                formatter.write_dl([(n, text.replace("-", _NO_BREAK)) for n, text in records])
        formatter.buffer[:] = [part.replace(_NO_BREAK, "-") for part in formatter.buffer]


def command_line(
    function: Callable[..., None], name: str, *, help: str | None = None, epilog: str | None = None
) -> typer.Typer:
    r"""Return the command line of a function, which is a command of its own.

    Parameters
    ----------
    function : callable
        Its annotations describe the options; its docstring is the help where none is given.
    name : str
    help, epilog : str, optional
        Texts above and below the options. Lines below a line ``\b`` stay as they are.
    """
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command(name=name, cls=OneLineUsage, help=help, epilog=epilog)(function)
    return app


def _named(names: str, is_option: bool) -> str:
    """Return the names of an option, or the name of an argument, with a readable value."""
    for kind, value in _METAVARS.items():
        names = names.replace(kind, value if is_option else "")
    return names.strip()


def _end(error: Any, given: list[str]) -> None:
    """End the command with one line: the option, what was found, what was expected."""
    path = error.ctx.command_path if error.ctx else "flametomo"
    line = f"error: {_message(error, given)}; see {path} --help"
    end(" ".join(line.split()), 2)


def _message(error: Any, given: list[str]) -> str:
    param = getattr(error, "param", None)
    message = error.format_message().rstrip(".")
    if param is None:
        return message
    is_option = param.param_type_name == "option"
    name = param.opts[0] if is_option else param.metavar or param.name.upper()
    if not error.message:  # nothing was given
        about = (getattr(param, "help", None) or "a value").rstrip(".")
        return f"{name}: missing, expected: {about}"
    parsed, _, _ = error.ctx.command.make_parser(error.ctx).parse_args(list(given))
    return f"{name}: found {parsed.get(param.name)!r}, expected {_expected(error.message)}"


_EXPECTED = (
    (r"Input should be a valid integer.*", "a whole number"),
    (r"Input should be a valid number.*", "a number"),
    (r"Input should be greater than or equal to (.*)", r"a number from \1"),
    (r"Input should be less than or equal to (.*)", r"a number up to \1"),
    (r".* is not a valid int(eger)?", "a whole number"),
    (r".* is not a valid float", "a number"),
    (r".* is not in the range (.*)", r"\1"),
    (r"Input should be ", ""),
)


def _expected(message: str) -> str:
    """Return what typer expects, which its versions put in different words."""
    message = message.strip().rstrip(".")
    for pattern, words in _EXPECTED:
        message = re.sub(f"^{pattern}", words, message)
    return message
