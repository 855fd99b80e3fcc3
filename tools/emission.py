"""Chart error against run time on known emissions: the project's methods and tuned peers."""

from collections.abc import Callable

from tomo.cli.stopping import run


def app() -> Callable[..., object]:
    """Return the command line; it imports libraries once signals are handled."""
    from studies.emission import study

    from tomo.cli.declared import command_line

    return command_line(study.run, "emission", help="Error against run time on known emissions.")


if __name__ == "__main__":
    run(lambda: app()())
