"""Lines on images that are read as they are, though their files say something of them."""

from __future__ import annotations

import contextlib
import os
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, cast

from rigs.recordings.stills import header_of
from rigs.recordings.tiff import TIFF_MARKS, image_page, opened_tiff

if TYPE_CHECKING:
    import tifffile

_VIEWS = {
    2: "mirrored left to right",
    3: "turned by 180 degrees",
    4: "mirrored top to bottom",
    5: "with rows and columns exchanged",
    6: "turned by 90 degrees to the right",
    7: "with rows and columns exchanged and turned by 180 degrees",
    8: "turned by 90 degrees to the left",
}
_LOSSY = ("JPEG", "WEBP")
_NAMED = 3  # cameras that a line names


def image_notes(images: Mapping[str, Iterable[str | os.PathLike]]) -> list[str]:
    """Return a line on each thing that files say and that reading them does not heed.

    Parameters
    ----------
    images : mapping
        Camera to its image files; only their headers are read. Files that cannot be read
        are left to the reader of pixels.
    """
    return grouped_notes(
        (camera, _said_by(path)) for camera, paths in images.items() for path in paths
    )


def grouped_notes(said: Iterable[tuple[str, Iterable[str]]]) -> list[str]:
    """Return one line for each different text, with the cameras that it is about.

    Parameters
    ----------
    said : iterable of (str, iterable of str)
        A camera and what is to say of one of its files.
    """
    found: dict[str, Counter[str]] = {}
    files: Counter[str] = Counter()
    for camera, texts in said:
        files[camera] += 1
        for text in texts:
            found.setdefault(text, Counter())[camera] += 1
    return [f"{_who(cameras, files)}: {text}" for text, cameras in found.items()]


def lossy_note(what: str) -> str:
    """Return the line on a format whose numbers are no measure of light."""
    return (
        f"{what} has 8 bits, is lossy, and is usually gamma-encoded: its numbers are not "
        "proportional to light, as a reconstruction takes them to be. Record TIFF or PNG"
    )


def _said_by(path: str | os.PathLike) -> list[str]:
    """Return what is to say of one file."""
    said: list[str] = []
    with contextlib.suppress(Exception), open(path, "rb") as file:
        is_tiff = file.read(2) in TIFF_MARKS
        file.seek(0)
        orientation = 1
        kind: str | None = "TIFF"
        if is_tiff:
            with opened_tiff(file) as opened:
                page = image_page(opened)
                orientation = page.tags.valueof("Orientation", 1)
                others = [
                    opened.pages.first,
                    cast("tifffile.TiffPage", opened.pages.get(1, default=page)),
                ]
                if any(one.shape != page.shape and not one.subfiletype for one in others):
                    said.append(
                        f"the page of {page.imagewidth} x {page.imagelength} pixels is the image; "
                        "smaller ones beside it are taken for thumbnails"
                    )
        else:
            import PIL.ExifTags
            import PIL.Image

            header = header_of(file)
            # the general method: PNG's own decodes the image first, however large it claims to be
            exif = PIL.Image.Image.getexif(header)
            orientation, kind = exif.get(PIL.ExifTags.Base.Orientation, 1), header.format
        if orientation in _VIEWS:
            said.append(
                f"an orientation tag ({orientation}) asks for images to be viewed "
                f"{_VIEWS[orientation]}; they are used as stored, row 0 first. A rig calibrated "
                "from turned images, as OpenCV's imread returns them, does not fit: calibrate "
                "with calibrate-rig"
            )
        if kind in _LOSSY:
            said.append(lossy_note(kind))
    return said


def _who(cameras: Counter[str], files: Counter[str]) -> str:
    """Return the cameras' names, and how many of their files are meant where not all are."""
    names = list(cameras)
    named = ", ".join(names[:_NAMED])
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    total = sum(files[name] for name in names)
    some = f" ({cameras.total()} of {total} images)" if cameras.total() < total else ""
    return f"camera{'s' if len(names) > 1 else ''} {named}{more}{some}"
