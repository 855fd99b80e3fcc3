"""Which page of a TIFF file is which moment and channel: what the file says, held against it."""

from __future__ import annotations

import json
import math
import operator
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from rigs.files.xml_file import parse_xml

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

    import tifffile


@dataclass(frozen=True, eq=False)
class Planes:
    """Where the planes of a recording are in its file: the page of each, ``(frames, channels)``.

    ``channels`` are names, or numbers where the file has none; ``note`` a line on what was
    guessed. ``is_one_block``: the first page alone has a header, and the other planes follow its
    values.
    """

    pages: NDArray[np.intp]
    channels: tuple[str, ...]
    is_one_block: bool = False
    note: str = ""


@dataclass(frozen=True)
class _Said:
    """What a file's description says: axes and their lengths, the slowest first."""

    by: str
    axes: str
    shape: tuple[int, ...]
    names: tuple[str, ...] = ()
    blocks: tuple[tuple[int, int, int], ...] = ()  # page, plane and number of planes
    note: str = ""

    @property
    def count(self) -> int:
        """The number of planes."""
        return math.prod(self.shape)

    @property
    def channels(self) -> int:
        """The number of channels."""
        return dict(zip(self.axes, self.shape, strict=True)).get("C", 1)

    @property
    def pages(self) -> int:
        """The number of pages that have to be in the file."""
        return max((page + number for page, _, number in self.blocks), default=self.count)

    def __str__(self) -> str:
        lengths = [f"{axis} {length}" for axis, length in zip(self.axes, self.shape, strict=True)]
        return f"its {self.by} says {self.count} planes ({', '.join(lengths)})"


def is_stack(file: tifffile.TiffFile) -> bool:
    """Return whether a file holds several pages like the first, or has lost them."""
    count, lost = there = _pages_there(file)
    if count < 2:
        return lost is not None or _one_block(file, there) is not None
    return file.pages.get(1).shape == file.pages.first.shape


def check_chain(file: tifffile.TiffFile) -> None:
    """Raise where the header of a page names a next one that is not there."""
    _, lost = _pages_there(file)
    if lost is not None:
        raise ValueError(f"{lost}: truncated or damaged")


def planes_of(file: tifffile.TiffFile) -> Planes:
    """Return a file's planes by OME-XML, ImageJ or tifffile's description, else a page a frame."""
    count, lost = there = _pages_there(file)
    block = _one_block(file, there)
    if block is not None:
        return Planes(*_ordered(block), is_one_block=True, note=block.note)
    said = _said(file)
    if lost is None:
        last = cast("tifffile.TiffPage", file.pages.get(count - 1, aspage=True))
        end = max(map(operator.add, last.dataoffsets, last.databytecounts), default=0)
        if end > file.filehandle.size:
            lost = f"page {count - 1}: its values end at byte {end}, the file before"
        elif said is not None and count < said.pages:
            lost = f"page {count}: missing"
    if lost is not None:
        what = "" if said is None else f", {said}"
        raise ValueError(
            f"{lost}: truncated or damaged{what}. Copy the whole pages into a new file to go on "
            "without the others"
        )
    has_more = said is not None and not said.blocks and count > said.count
    if said is None or (has_more and said.channels == 1):
        return Planes(np.arange(count)[:, None], ("0",))
    if has_more:
        raise ValueError(f"found {count} pages, but {said}: which page is which is not known")
    return Planes(*_ordered(said), note=said.note)


def _ordered(said: _Said) -> tuple[NDArray[np.intp], tuple[str, ...]]:
    """Return the pages by moment and channel, and the channels' names."""
    moments = [axis for axis, length in zip(said.axes, said.shape, strict=True)
               if axis != "C" and length > 1]  # fmt: skip
    if len(moments) > 1:
        raise ValueError(
            f"{said}: expected one axis of moments and one of channels (C): store one of "
            f"{' and '.join(moments)} alone"
        )
    if said.axes.count("C") > 1:
        raise ValueError(f"{said}: expected one axis of channels")
    pages: NDArray = np.arange(said.count)
    for page, plane, number in said.blocks:
        pages[plane : plane + number] = np.arange(page, page + number)
    pages = pages.reshape(said.shape)
    if "C" not in said.axes:
        return pages.reshape(-1, 1), ("0",)
    pages = np.moveaxis(pages, said.axes.index("C"), -1)
    pages = pages.reshape(-1, pages.shape[-1])
    numbers = tuple(map(str, range(pages.shape[1])))
    return pages, said.names if len(said.names) == pages.shape[1] else numbers


def _pages_there(file: tifffile.TiffFile) -> tuple[int, str | None]:
    """Return how many pages the headers lead to, and where the next one is lost if one is."""
    tiff, handle = file.tiff, file.filehandle
    offset = file.pages.first.offset
    seen: dict[int, int] = {}
    while offset and offset not in seen:
        page = len(seen)
        try:
            handle.seek(offset)
            (tags,) = struct.unpack(tiff.tagnoformat, handle.read(tiff.tagnosize))
            handle.seek(offset + tiff.tagnosize + tags * tiff.tagsize)
            (following,) = struct.unpack(tiff.offsetformat, handle.read(tiff.offsetsize))
        except (struct.error, OSError, OverflowError):
            return page, f"page {page}: its header at byte {offset} is not in the file"
        if not 0 < tags <= 4096:  # tifffile reads no page of more either
            return page, f"page {page}: its header at byte {offset} is damaged"
        seen[offset] = page
        offset = following
    if offset:
        return len(seen), f"page {len(seen)}: the header before it leads to page {seen[offset]}"
    return len(seen), None


def _one_block(file: tifffile.TiffFile, there: tuple[int, str | None]) -> _Said | None:
    """Return what is said of planes whose values follow those of the only page, else None."""
    page = file.pages.first
    if page.is_ome or not page.is_contiguous or there != (1, None):
        return None
    said = _said(file)
    if said is None or said.count < 2:
        return None
    end = page.dataoffsets[0] + said.count * page.nbytes
    return said if end <= file.filehandle.size else None


def _said(file: tifffile.TiffFile) -> _Said | None:
    """Return what the first page's description says of all, None where it says nothing."""
    page = file.pages.first
    if page.is_ome:
        return _said_by_ome(page)
    if page.imagej_description:
        return _said_by_imagej(page.imagej_description)
    return _said_by_tifffile(page) if page.shaped_description else None


def _said_by_imagej(text: str) -> _Said | None:
    """Return the lengths that ImageJ writes; channels lie nearest, then slices, then frames."""
    found = {name: int(number) for name, number in re.findall(r"(?m)^(\w+)=(\d{1,9})\s*$", text)}
    shape = tuple(found.get(name, 1) for name in ("frames", "slices", "channels"))
    images = found.get("images", math.prod(shape))
    if images <= 1:
        return None
    if shape[2] == 1 and math.prod(shape) != images:
        shape = (images, 1, 1)
    return _Said("ImageJ description", "TZC", shape)


def _said_by_tifffile(page: tifffile.TiffPage) -> _Said | None:
    """Return the shape that tifffile writes, without the axes inside a page."""
    text = page.shaped_description or ""
    try:
        found = json.loads(text) if text.startswith("{") else {}
    except (ValueError, RecursionError):
        return None
    shape, axes = found.get("shape"), found.get("axes")
    if not (isinstance(shape, list) and all(type(one) is int and one > 0 for one in shape)):
        return None
    leading = shape[: max(len(shape) - len(page.shape), 0)]
    if math.prod(leading) <= 1:
        return None
    if not (isinstance(axes, str) and len(axes) == len(shape)):
        axes = "Q" * len(shape)  # tifffile's letter of an axis without a name
    return _Said("description", axes[: len(leading)], tuple(leading))


def _said_by_ome(page: tifffile.TiffPage) -> _Said:
    """Return axes, lengths and places of planes in OME-XML."""
    root = parse_xml(page.description, "OME-XML")
    images = [one for one in root.iter() if _tag(one) == "Pixels"]
    here = [one for one in images if _blocks_here(one, root.get("UUID")) is not None]
    if len(here) != 1:
        raise ValueError(f"found {len(here)} images in its OME-XML, expected one")
    (pixels,) = here
    lengths = {axis: _whole(pixels, f"Size{axis}", 1) for axis in "ZCT"}
    lengths["C"] //= max(page.samplesperpixel, 1)  # colours inside a page
    order = pixels.get("DimensionOrder", "XYZCT")[:1:-1]
    if sorted(order) != ["C", "T", "Z"] or min(lengths.values()) < 1:
        raise ValueError(f"found the axes {order!r} in its OME-XML, expected Z, C and T")
    shape = tuple(lengths[axis] for axis in order)
    steps = {axis: math.prod(shape[place + 1 :]) for place, axis in enumerate(order)}
    blocks = []
    for one in _blocks_here(pixels, root.get("UUID")) or ():
        number = _whole(one, "PlaneCount", 1 if one.get("IFD") else math.prod(shape))
        plane = sum(_whole(one, f"First{axis}", 0) * step for axis, step in steps.items())
        blocks.append((_whole(one, "IFD", 0), plane, number))
    names = [one.get("Name", "") for one in pixels if _tag(one) == "Channel"]
    note = ""
    if lengths["C"] > lengths["Z"] == lengths["T"] == 1 and not any(names):
        order = order.translate(str.maketrans("CT", "TC"))  # writers call an axis without a name C
        note = "its OME-XML knows channels alone, without names: they are taken for moments"
    said = _Said("OME-XML", order, shape, tuple(names) if all(names) else (), tuple(blocks), note)
    inside = sum(number for _, _, number in blocks)
    if blocks and inside != said.count:
        raise ValueError(f"{said}, of which {inside} are in this file: expected all of them")
    if any(plane + number > said.count for _, plane, number in blocks):
        raise ValueError(f"{said}: found a plane beyond the last")
    return said


def _blocks_here(pixels: Element, own: str | None) -> Sequence[Element] | None:
    """Return the elements on planes in this file; None where all planes are in other files."""
    blocks = [one for one in pixels if _tag(one) == "TiffData"]
    others = [
        [inner.text for inner in one if _tag(inner) == "UUID" and inner.text != own]
        for one in blocks
    ]
    here = [one for one, other in zip(blocks, others, strict=True) if not other]
    return None if blocks and not here else here


def _tag(element: Element) -> str:
    return element.tag.rpartition("}")[2]


def _whole(element: Element, name: str, default: int) -> int:
    """Return an attribute that is a whole number of at most nine digits."""
    text = element.get(name)
    if text is None:
        return default
    if re.fullmatch(r"\d{1,9}", text, re.ASCII) is None:
        raise ValueError(f"OME-XML: {_tag(element)}.{name}: found {text!r}, expected a number")
    return int(text)
