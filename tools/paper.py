"""Run the experiments of the WERNet paper again, and say what holds."""

from collections.abc import Callable

from tomo.cli.stopping import run


def app() -> Callable[..., object]:
    """Return the command line; it imports libraries once signals are handled."""
    from studies.paper import study

    from tomo.cli.declared import command_line

    return command_line(study.run, "paper", help="The WERNet paper, run again.")


if __name__ == "__main__":
    run(lambda: app()())
