"""A scan as notebooks show it: thumbnails of its first frame, and a table."""

from __future__ import annotations

import io
from html import escape

import numpy as np
from numpy.typing import NDArray

from rigs.notebook import facts, framed, some, times
from tomo.draw.page import embedded
from tomo.draw.rig.thumbnails import load_thumbnails
from tomo.scan import Scan

MOST = 8
"""Cameras that are shown: a row of a notebook."""

_TALLEST = 96  # pixels of a thumbnail


def scan_html(scan: Scan) -> str:
    """Return what a notebook shows of a scan; images that cannot be read are named instead."""
    names = scan.rig.names[:MOST]
    sizes = sorted({camera.image_size for camera in scan.rig})
    rows: list[tuple[str, object]] = [
        ("cameras", some(scan.rig.names)),
        ("frames", some(scan.frame_names)),
        ("images", some([f"{times(size)} pixels" for size in sizes])),
    ]
    if scan.grid is not None:
        unit = scan.rig.length_unit
        rows.append(("voxels", f"{times(scan.grid.shape)} of {times(scan.grid.spacing)} {unit}"))
    rows.append(("truth", "known" if scan.truth is not None else "not known"))
    if scan.source is not None:
        rows.append(("source", scan.source))
    try:
        pictures = load_thumbnails(scan.rig, scan.only(*names), longest=_TALLEST)
    except (ValueError, OSError) as error:
        rows.append(("not readable", " ".join(str(error).split())))
        pictures = {}
    figures = "".join(
        '<figure style="display:inline-block;margin:0 6px 4px 0;text-align:center">'
        f'<img alt="{escape(name)}" src="{embedded(_png(one))}">'
        f'<figcaption style="font-size:.75em;opacity:.75">{escape(name)}</figcaption></figure>'
        for name, one in pictures.items()
    )
    count = f"{len(scan.frames)} frame{'s' if len(scan.frames) != 1 else ''}"
    return framed(f"Scan of {count} by {len(scan.rig)} cameras", figures, facts(rows))


def _png(grey: NDArray[np.uint8]) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(grey).save(buffer, "png", optimize=True)
    return buffer.getvalue()
