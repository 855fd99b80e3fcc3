"""One reader of files: what it reads, and how its files are changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from _stress.fuzzing_mutations import Mutation


@dataclass(frozen=True)
class Reader:
    """One reader and its files.

    Attributes
    ----------
    name : str
    file : str
        The file that is changed, in a folder of its own.
    read : callable
        Reads it, given its path.
    seeds : tuple of bytes
        The file as it may be.
    mutations : tuple of Mutation
    beside : mapping
        The other files of the folder.
    links : tuple of str
        Other names of the file.
    """

    name: str
    file: str
    read: Callable[[Path], object]
    seeds: tuple[bytes, ...]
    mutations: tuple[Mutation, ...]
    beside: Mapping[str, bytes] = field(default_factory=dict)
    links: tuple[str, ...] = ()
