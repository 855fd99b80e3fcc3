"""The commands: ``flametomo VERB``, and ``python tools/VERB.py``, which is the same program."""

from __future__ import annotations

import logging
import sys


def main(*verb: str) -> None:
    """Run the command line of a verb, if one is named, and end the process with its exit code."""
    from tomo.cli.stopping import run

    def command() -> None:
        from tomo.cli.app import app
        from tomo.cli.console import Escaped

        if logging.lastResort is not None:  # where no program has set up its own
            logging.lastResort.setFormatter(Escaped())
        app([*verb, *sys.argv[1:]], prog_name="flametomo")

    run(command)
