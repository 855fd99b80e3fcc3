"""Triangles in STL, OBJ, PLY and GLB files."""

from __future__ import annotations

import io
import os
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.files.text import check_plain_file, write_bytes
from rigs.scene.mesh import LARGEST, Mesh

SUFFIXES = ("stl", "obj", "ply", "glb")

_SMALLEST = 12
"""Bytes of a triangle in the densest of the files, a binary PLY's three whole numbers."""


def read_mesh(path: str | os.PathLike) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the vertices ``(V, 3)`` and the triangles ``(T, 3)`` of a file.

    The parts of a file are put together, each at its place in it.

    Raises
    ------
    ValueError
        If the format is unknown, the file is damaged, or it may hold too many triangles.
    """
    path = Path(path)
    suffix = path.suffix.lower().lstrip(".")
    if suffix not in SUFFIXES:
        raise ValueError(f"found a .{suffix} file, expected one of {', '.join(SUFFIXES)}")
    check_plain_file(path)
    size = path.stat().st_size
    if size > LARGEST * 100:
        raise ValueError(
            f"found {size / 1e6:.0f} MB (up to {size // _SMALLEST} triangles, which take some "
            f"{size // _SMALLEST * 380 / 1e9:.0f} GB of memory), expected at most "
            f"{LARGEST * 100 / 1e6:.0f} MB: simplify the mesh"
        )
    import trimesh

    data = path.read_bytes()
    try:
        loaded = trimesh.load_mesh(
            io.BytesIO(data), file_type=suffix, process=False, maintain_order=True
        )
        vertices = np.array(loaded.vertices, np.float64)
        triangles = np.array(loaded.faces, np.int64).reshape(-1, 3)
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, EOFError) as error:
        raise ValueError(f"not a mesh: {_short(error)}") from None
    except (
        struct.error,
        MemoryError,
        UnicodeError,
        ArithmeticError,
        NotImplementedError,
    ) as error:
        raise ValueError(f"not a mesh: {_short(error)}") from None
    if not len(triangles):
        raise ValueError("found no triangle, expected a mesh of at least one")
    return vertices, triangles


def write_mesh(mesh: Mesh, path: str | os.PathLike) -> None:
    """Write a mesh as OBJ, with all digits of its coordinates."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (mesh.triangles + 1).tolist()]
    write_bytes(path, ("\n".join(lines) + "\n").encode())


def _short(error: Exception) -> str:
    """Return a library's message in one short line."""
    return " ".join(str(error).split())[:80] or type(error).__name__
