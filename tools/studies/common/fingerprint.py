"""Which code made a figure: the commit, and a hash of the modules that the default enters.

Comments and docstrings do not count: the hash changes with what the default computes from, not
with its words. ``python -m studies.common.fingerprint`` prints the modules, in a fresh process.
"""

from __future__ import annotations

import ast
import hashlib
import json
import sys
import threading
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

from studies.common.timing import in_fresh_process
from tomo.report.about import commit

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = ("rigs", "tomo")


def origin() -> dict[str, Any]:
    """Return the commit of this checkout, and the modules of the default with their hash."""
    return {"commit": commit() or "unknown", "default": _default()}


@cache
def _default() -> dict[str, Any]:
    modules = in_fresh_process("studies.common.fingerprint")["modules"]
    return {"hash": hash_of(modules), "modules": modules}


def hash_of(modules: Iterable[str], root: Path = ROOT) -> str:
    """Return a hash of modules, given by their paths below ``root``; "" where one is gone."""
    found = hashlib.sha256()
    for path in modules:
        if not (root / path).is_file():
            return ""
        tree = ast.parse((root / path).read_text("utf-8"))
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            if isinstance(body, list):  # docstrings, also those behind constants
                node.body = [one for one in body if not _is_text(one)]
        found.update(f"{path}\n{ast.dump(tree)}\n".encode())
    return found.hexdigest()[:16]


def modules_of_default() -> list[str]:
    """Reconstruct a tiny flame in this process; return the paths of the modules it enters.

    Those whose functions are called, and all that hold compiled kernels, whose calls Python does
    not see.
    """
    import numba

    import phantoms
    import rigs
    from tomo import VoxelGrid, reconstruct, simulate

    grid = VoxelGrid((8, 10, 8), 1.0)
    rig = rigs.ring(5, distance=200, image_size=(16, 20), footprint=1.0)
    scan = simulate(rig, phantoms.create("jet", extent=grid.extent), grid)
    entered: set[str] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_name != "<module>":
            entered.add(frame.f_code.co_filename)

    threading.setprofile(note)
    sys.setprofile(note)
    reconstruct(scan, grid)
    sys.setprofile(None)
    threading.setprofile(None)
    for module in list(sys.modules.values()):
        kernels = (type(value) for value in vars(module).values())
        if any(issubclass(kind, numba.core.dispatcher.Dispatcher) for kind in kernels):
            entered.add(module.__file__ or "")
    folders = tuple(ROOT / package for package in PACKAGES)
    return sorted(
        path.relative_to(ROOT).as_posix()
        for path in map(Path, entered)
        if any(folder in path.parents for folder in folders)
    )


def _is_text(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


if __name__ == "__main__":
    sys.stdout.write(json.dumps({"modules": modules_of_default()}))
