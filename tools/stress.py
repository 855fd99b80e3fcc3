"""Stress the toolkit: wrong pixels, views and cameras, rigs that say too little, other units."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tomo.cli.stopping import run

if TYPE_CHECKING:
    import typer


def app() -> typer.Typer:
    """Return the command line; it imports libraries once signals are handled."""
    from studies.common.study import command
    from studies.stress import STUDY

    return command(STUDY)


if __name__ == "__main__":
    run(lambda: app()())
