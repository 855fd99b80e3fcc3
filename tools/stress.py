"""Stress the toolkit: wrong pixels, views and cameras, rigs that say too little, other units."""

from collections.abc import Callable

from tomo.cli.stopping import run


def app() -> Callable[..., object]:
    """Return the command line; it imports libraries once signals are handled."""
    from studies.common.study import command
    from studies.stress import STUDY

    return command(STUDY)


if __name__ == "__main__":
    run(lambda: app()())
