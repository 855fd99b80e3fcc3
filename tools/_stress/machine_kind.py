"""What a kind of file is to those who kill its writer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Kind:
    """How one kind of file is written and read.

    Attributes
    ----------
    prepare : callable
        ``prepare()`` returns what writing needs; done once, in a fork.
    tells : bool
        Whether what stands there can say that it is not complete.
    write : callable
        ``write(folder, prepared, version)``.
    read : callable
        ``read(folder)`` returns every version that it finds in what stands under final names;
        none where that says that it is not complete.
    """

    write: Callable[[Path, Any, int], object]
    read: Callable[[Path], set[int]]
    prepare: Callable[[], Any] = lambda: None
    tells: bool = False


def versions(values: np.ndarray) -> set[int]:
    """Return the versions that are in arrays of them, which may be noisy by less than one."""
    return {int(value) for value in np.unique(np.floor(values))}
