"""Chart run time against error, with memory, start-up, and the studies of accuracy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tomo.cli.stopping import run

if TYPE_CHECKING:
    import typer


def app() -> typer.Typer:
    """Return the command line; it imports libraries once signals are handled."""
    from studies.benchmark import STUDY
    from studies.common.study import command

    return command(STUDY)


if __name__ == "__main__":
    run(lambda: app()())
