"""Run the experiments of the WERNet paper again, and say what holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tomo.cli.stopping import run

if TYPE_CHECKING:
    import typer


def app() -> typer.Typer:
    """Return the command line; it imports libraries once signals are handled."""
    from studies.paper import study

    from tomo.cli.declared import command_line

    return command_line(study.run, "paper", help="The WERNet paper, run again.")


if __name__ == "__main__":
    run(lambda: app()())
