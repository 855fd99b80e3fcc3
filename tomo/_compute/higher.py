"""Methods of values whose work a package on a higher floor does: drawing, writing, projecting.

`Reconstruction.save` writes what `tomo.report` makes, a notebook shows what `tomo.draw` draws, and
`Volume.project` uses `tomo.operators`.
Imports point downwards, so that the method names its function as text, in `HIGHER` alone.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

HIGHER = {
    "save": "tomo.report.outcome_files:write_outcome",
    "reconstruction_html": "tomo.report.notebook:reconstruction_html",
    "scan_html": "tomo.report.notebook:scan_html",
    "image_of": "tomo.operators.image_of:image_of",
    "isosurface": "tomo.draw.volume.isosurface:isosurface",
    "data_array": "tomo.io.xarray_volumes:data_array",
}
"""What a method asks for, and the function that does it."""


def higher(name: str) -> Callable[..., Any]:
    """Return the function of `HIGHER`, imported now.

    >>> higher("save").__name__
    'write_outcome'
    """
    module, function = HIGHER[name].split(":")
    return getattr(import_module(module), function)
