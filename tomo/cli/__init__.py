"""The commands: ``flametomo VERB``, and ``python tools/VERB.py``, which is the same program."""

from __future__ import annotations

import sys


def main(*verb: str) -> None:
    """Run the command line, and end the process with its exit code.

    Parameters
    ----------
    *verb : str
        What stands before the arguments of the process, like ``simulate``.
    """
    from tomo.cli.stopping import run

    def command() -> None:
        from tomo.cli.app import app

        app([*verb, *sys.argv[1:]], prog_name="flametomo")

    run(command)
