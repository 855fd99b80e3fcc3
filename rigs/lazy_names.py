"""Names of a package that are loaded on first use; a wrong one is answered with the right one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import lazy_loader


def attach(
    package: str, submodules: list[str], submod_attrs: dict[str, list[str]]
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package.

    As `lazy_loader.attach`, whose error says no more than that there is no such name: Python 3.11
    adds a hint in a terminal alone, not in a notebook. Here it names the one that may be meant.
    """
    load, names, public = lazy_loader.attach(package, submodules, submod_attrs)

    def get(name: str) -> Any:
        if name in public:
            return load(name)
        from importlib.util import find_spec

        if not name.startswith("_") and find_spec(f"{package}.{name}"):
            raise AttributeError(f"{package}.{name} is not loaded yet: import {package}.{name}")
        raise no_such_name(package, name, public)

    return get, names, public


def no_such_name(package: str, name: str, public: list[str]) -> AttributeError:
    """Return the error of a wrong name, with the one that may be meant."""
    # here: commands import packages before they listen to Ctrl-C
    from difflib import get_close_matches

    close = get_close_matches(name, public, 1)
    meant = f"did you mean {close[0]}? " if close else ""
    return AttributeError(f"{package} has no {name!r}: {meant}help({package}) says what there is")
