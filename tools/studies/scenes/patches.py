"""Constants of modules set to other values for a while: what an ablation changes."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from typing import Any
from unittest import mock


def parsed(settings: Sequence[str], option: str) -> dict[str, Any]:
    """Return ``NAME=VALUE`` settings as a mapping; values as Python writes them, else as text."""
    found = {}
    for setting in settings:
        name, sign, value = setting.partition("=")
        if not (name and sign):
            raise ValueError(f"{option}: found {setting!r}, expected NAME=VALUE")
        try:
            found[name] = ast.literal_eval(value)
        except (ValueError, SyntaxError):
            found[name] = value
    return found


@contextmanager
def patched(constants: Mapping[str, Any]) -> Iterator[None]:
    """Set constants such as ``tomo.hull.darkness.VOTES`` to other values within a block.

    Modules that have imported the constant by its name see the other value too. Default arguments
    do not, nor do kernels that are compiled already.
    """
    with ExitStack() as changes:
        for path, value in constants.items():
            module, _, name = path.rpartition(".")
            try:
                before = getattr(import_module(module), name)
            except (ImportError, AttributeError, ValueError):
                raise ValueError(
                    f"--set: found {path!r}, expected a module's constant, like "
                    "tomo.solvers.curvature.FIRST"
                ) from None
            for holder in _holders(module, name, before):
                changes.enter_context(mock.patch.object(holder, name, value))
        yield


def _holders(module: str, name: str, value: Any) -> list[Any]:
    """Return the loaded modules of the toolkit that have the constant under its name."""
    package = module.partition(".")[0]
    loaded = [m for key, m in list(sys.modules.items()) if key.partition(".")[0] == package]
    alike = [one for one in loaded if vars(one).get(name) is value]
    return [one for one in alike if one.__name__ == module or not _assigns(one, name)]


def _assigns(module: Any, name: str) -> bool:
    """Return whether a module has a constant of its own of that name: small numbers are shared."""
    for node in ast.parse(inspect.getsource(module)).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        names = (one for target in targets if target for one in ast.walk(target))
        if any(isinstance(one, ast.Name) and one.id == name for one in names):
            return True
    return False
