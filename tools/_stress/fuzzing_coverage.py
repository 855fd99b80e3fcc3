"""Which statements of the project are run: each one notes itself as it is reached.

Modules are compiled from their source with a note before every statement. To follow lines with
`sys.settrace` would call Python at every call and line, of every library too: readers of YAML then
take twice as long.
"""

from __future__ import annotations

import ast
import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import CodeType, ModuleType
from typing import Any

PACKAGES = ("rigs", "tomo")
_NOTES = "__reached__"
_COMPILED = ("compiled", "overload")
"""Decorators of functions that are no Python: numba knows no notes."""


class Coverage(MetaPathFinder):
    """What of the project was reached, in modules imported once it is installed."""

    def __init__(self) -> None:
        self._reached = bytearray()

    @property
    def statements(self) -> int:
        """How many statements have been reached."""
        return self._reached.count(1)

    def install(self) -> None:
        """Follow the modules that are imported from now on."""
        sys.meta_path.insert(0, self)

    def forget(self) -> None:
        """Start at nothing reached."""
        self._reached[:] = bytes(len(self._reached))

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Return where a module of the project is, to be loaded with its notes."""
        if name.partition(".")[0] not in PACKAGES:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Noted(spec.loader.name, spec.loader.path, self._reached)
        return spec


class _Noted(SourceFileLoader):
    """Loads a module whose statements note themselves."""

    def __init__(self, name: str, path: str, reached: bytearray) -> None:
        super().__init__(name, path)
        self._reached = reached

    def exec_module(self, module: ModuleType) -> None:
        vars(module)[_NOTES] = self._reached
        super().exec_module(module)

    def get_code(self, fullname: str) -> CodeType:
        """Compile the source: what is cached has no notes, and must not get any."""
        path = self.get_filename(fullname)
        tree = ast.parse(self.get_data(path), path)
        _note(tree, self._reached)
        return compile(ast.fix_missing_locations(tree), path, "exec", dont_inherit=True)


def _note(tree: ast.Module, reached: bytearray) -> None:
    """Put a note before every statement that may have one."""
    waiting: list[ast.AST] = [tree]
    for node in waiting:
        if _is_compiled(node):
            continue
        waiting.extend(ast.iter_child_nodes(node))
        for name in ("body", "orelse", "finalbody"):
            statements = getattr(node, name, None)
            if isinstance(statements, list):
                setattr(node, name, _with_notes(statements, reached))


def _with_notes(statements: list[ast.stmt], reached: bytearray) -> list[ast.stmt]:
    found = []
    for number, statement in enumerate(statements):
        if not _is_first_of_all(statement, number):
            place = ast.Subscript(
                ast.Name(_NOTES, ast.Load()), ast.Constant(len(reached)), ast.Store()
            )
            note = ast.Assign([place], ast.Constant(1))
            found.append(ast.copy_location(note, statement))
            reached.append(0)
        found.append(statement)
    return found


def _is_first_of_all(statement: ast.stmt, number: int) -> bool:
    """Say whether nothing may stand before it: a docstring, or what the compiler has to know."""
    if isinstance(statement, ast.ImportFrom):
        return statement.module == "__future__"
    text = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
    return text and number == 0


def _is_compiled(node: ast.AST) -> bool:
    """Say whether numba compiles a function."""
    names = (
        getattr(decorator, "func", decorator) for decorator in getattr(node, "decorator_list", ())
    )
    return any(getattr(name, "id", "") in _COMPILED for name in names)
