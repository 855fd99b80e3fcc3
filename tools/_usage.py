"""Wrong options and arguments are one line too, as all other bad input is."""

from __future__ import annotations

import re
from typing import Any

import typer
from typer.core import TyperCommand

UsageError = typer.BadParameter.__base__  # of typer's own or of click's, as the version has it


class OneLineUsage(TyperCommand):
    """A command whose errors about its options and arguments are one line, with exit code 2."""

    def make_context(
        self, info_name: str | None, args: list[str], *rest: Any, **extra: Any
    ) -> Any:
        """Return the context of the parsed arguments, or say in one line what is wrong."""
        given = list(args)  # parsing takes them away
        try:
            return super().make_context(info_name, args, *rest, **extra)
        except UsageError as error:
            line = f"error: {_told(error, given)}; see {info_name} --help"
            typer.echo(" ".join(line.split()), err=True)
            raise typer.Exit(2) from None


def _told(error: Any, given: list[str]) -> str:
    """Return what is wrong: the option, what was found, what was expected."""
    param = getattr(error, "param", None)
    said = error.format_message().rstrip(".")
    if param is None:
        return said
    is_option = param.param_type_name == "option"
    name = param.opts[0] if is_option else param.metavar or param.name.upper()
    if not error.message:  # nothing was given
        about = (getattr(param, "help", None) or "a value").rstrip(".")
        return f"{name}: missing, expected: {about}"
    parsed, _, _ = error.ctx.command.make_parser(error.ctx).parse_args(list(given))
    return f"{name}: found {parsed.get(param.name)!r}, expected {_expected(error.message)}"


_SAID = (
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
    """Return what typer says it wants, which its versions put in different words."""
    message = message.strip().rstrip(".")
    for pattern, words in _SAID:
        message = re.sub(f"^{pattern}", words, message)
    return message
