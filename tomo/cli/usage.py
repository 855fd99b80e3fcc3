"""Help that reads well on 80 columns, and wrong usage in one line as all other bad input."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperCommand

from tomo.cli.console import end

_NO_BREAK = "\N{NON-BREAKING HYPHEN}"
"""Stands for a hyphen while lines are broken, so that no name is cut."""

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
        try:
            return super().make_context(info_name, args, *rest, **extra)
        except UsageError as error:
            path = error.ctx.command_path if error.ctx else "flametomo"
            line = f"error: {self._message(error)}; see {path} --help"
            end(" ".join(line.split()), 2)

    def _message(self, error: Any) -> str:
        """Return the option, what was found, what was expected."""
        param = getattr(error, "param", None)
        unknown = getattr(error, "option_name", None)
        if unknown and "requires" not in error.message:
            return self._unknown(unknown)
        if param is None:
            return error.format_message().rstrip(".")
        is_option = param.param_type_name == "option"
        name = param.opts[0] if is_option else param.metavar or param.name.upper()
        if not error.message:  # nothing was given
            about = (getattr(param, "help", None) or "a value").rstrip(".")
            return f"{name}: missing, expected: {about}"
        return f"{name}: {error.message.rstrip('.')}"

    def _unknown(self, option: str) -> str:
        """Return what to use in place of an option that is misspelt."""
        from rigs.files.text import nearest

        known = [name for one in self.params for name in (*one.opts, *one.secondary_opts)]
        near = nearest(option, known)
        return f"{option}: no such option" + (f", did you mean {near}?" if near else "")

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
                names = names if is_option else re.sub(" <.*", "", names)  # no type
                sections.setdefault(title, []).append((names, text))
        for title, records in sections.items():
            if not records:
                continue
            with formatter.section(title):
                formatter.write_dl([(n, text.replace("-", _NO_BREAK)) for n, text in records])
        formatter.buffer[:] = [part.replace(_NO_BREAK, "-") for part in formatter.buffer]
