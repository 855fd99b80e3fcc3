"""Chart run time against error, with memory, start-up, and the studies of accuracy."""

from collections.abc import Callable

from tomo.cli.stopping import run


def app() -> Callable[..., object]:
    """Return the command line; it imports libraries once signals are handled."""
    from studies.benchmark import STUDY
    from studies.common.study import command

    return command(STUDY)


if __name__ == "__main__":
    run(lambda: app()())
