"""The error about a folder that can be read in several ways."""

from __future__ import annotations

from collections.abc import Sequence


class UndecidedError(ValueError):
    """Several things in a folder could be what a scan needs: one has to be named.

    Parameters
    ----------
    where : object
        The folder; the message begins with it.
    what : str
        What was looked for.
    choices : sequence of str
        Values of the option, two or more.
    option : str
        The parameter of `propose_scan` that decides.

    Examples
    --------
    >>> print(UndecidedError("run", "rigs", ["a.json", "b.json"], "rig"))
    run: rigs: found a.json and b.json, expected one: rig='a.json', say
    """

    def __init__(self, where: object, what: str, choices: Sequence[str], option: str) -> None:
        self.choices, self.option = tuple(choices), option
        named = f"{', '.join(choices[:-1])} and {choices[-1]}"
        super().__init__(
            f"{where}: {what}: found {named}, expected one: {option}='{choices[0]}', say"
        )
