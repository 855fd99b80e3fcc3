"""Run known scenes that nobody tuned on: errors over the best possible, and faults named."""

from collections.abc import Callable

from tomo.cli.stopping import run


def app() -> Callable[..., object]:
    """Return the command line; it imports libraries once signals are handled."""
    from studies.scenes.study import command

    return command()


if __name__ == "__main__":
    run(lambda: app()())
