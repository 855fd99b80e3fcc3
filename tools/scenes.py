"""Run known scenes that nobody tuned on: errors over the best possible, and faults named."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tomo.cli.stopping import run

if TYPE_CHECKING:
    import typer


def app() -> typer.Typer:
    """Return the command line; it imports libraries once signals are handled."""
    from studies.scenes.study import command

    return command()


if __name__ == "__main__":
    run(lambda: app()())
