"""A scan of the images in a folder, with what was found and what was assumed, in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigs import Rig, formats, load, preset_names
from rigs.changes import with_cameras
from rigs.files.units import UNKNOWN
from rigs.recordings import read_still
from rigs.recordings.naming import patterns_of
from tomo.grid import VoxelGrid, grid_of_rig
from tomo.measurement.stored_bits import FEWER, stored_bits
from tomo.scan.films import frame_rate_of, notes_of_films
from tomo.scan.propose.box import Box, box_of_light, grid_in
from tomo.scan.propose.camera_images import (
    CameraImages,
    check_sizes,
    images_of,
    renamed_as_images,
    sizes_of,
)
from tomo.scan.propose.contents import KINDS, NONE, RIG_FILE, Contents, Request, find_rig
from tomo.scan.propose.dark_and_flat import check_correction, correction_of
from tomo.scan.scan import Scan


@dataclass(frozen=True, eq=False)
class Proposal:
    """A scan that is not written yet, and sentences on what was found, and what was assumed."""

    folder: Path
    scan: Scan  # with rig, grid and corrections
    images: CameraImages
    corrections: dict[str, Any]  # as scan.yaml has them
    rig: Rig | None  # to write, of whole images; None where the folder's rig.yaml stays
    said: dict[str, list[str]]  # on the rig, the images, each correction and the grid
    scale: int = 1  # by which images may be shrunk for such voxels

    @property
    def grid(self) -> VoxelGrid:
        """The voxels."""
        assert self.scan.grid is not None
        return self.scan.grid


def propose_scan(folder: Path, request: Request | None = None) -> Proposal:
    """Return the scan of the images in a folder; nothing is written.

    Raises
    ------
    UndecidedError
        If the folder can be read in several ways: it names them, and the field of ``request``.
    ValueError, OSError
        In one line that names file, camera and field.
    """
    folder, request = Path(folder), request or Request()
    contents = Contents.of(folder)
    if request.pattern is None:
        contents.check_light()
    rig, is_kept, said = rig_of(contents, request)
    images = images_of(contents, rig, request.pattern, request.drop)
    check_sizes(rig, images)
    said["images"] = _about_images(images, rig)
    corrections = _corrections(contents, rig, images, request, said)
    if "bit_depth" not in corrections:
        corrections |= _bit_depth(images, said)
    scan = _scan(folder, rig, images, corrections)
    grid, scale, said["grid"] = _grid(scan, images, request)
    written = None if is_kept else rig
    return Proposal(folder, replace(scan, grid=grid), images, corrections, written, said, scale)


def _about_images(images: CameraImages, rig: Rig) -> list[str]:
    """Return what to say of the images."""
    frames, sizes = images.frames, {" x ".join(map(str, camera.image_size)) for camera in rig}
    names = [frame.name for frame in frames]
    span = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
    moments = f"{len(names)} frame{'s' * (len(names) > 1)} ({span})"
    kind = "films" if images.films else "images"
    said = [
        f"{kind} of {len(rig)} cameras named {images.pattern}, {moments}, "
        f"{', '.join(sorted(sizes))} pixels"
    ]
    if images.others:
        said.append(f"not used: {', '.join(images.others)}; --pattern takes them")
    lacking = [frame.name for frame in frames if len(frame.images) < len(rig)]
    if lacking and not images.films:
        first = next(frame for frame in frames if frame.name == lacking[0])
        camera = next(name for name in rig.names if name not in first.images)
        if len(lacking) == len(frames):
            raise ValueError(
                f"{images.pattern}: frame {first.name!r}: camera {camera}: found no image, and no "
                "frame with one of each camera; expected files of one moment to have one number"
            )
        said.append(
            f"{len(lacking)} frames lack a camera's image, the first {first.name} that of {camera}"
        )
    return said


def _corrections(
    contents: Contents,
    rig: Rig,
    images: CameraImages,
    request: Request,
    said: dict[str, list[str]],
) -> dict[str, Any]:
    """Return the corrections as scan.yaml has them, and say how each was found."""
    found: dict[str, Any] = {}
    for name in KINDS:
        given = getattr(request, name)
        if given == NONE:
            said[name] = ["left out, as asked"]
            continue
        value = given
        if value is None:
            value = correction_of(contents, name, rig, images.pattern, request.drop)
        if value is None:
            said[name] = ["none found"]
            continue
        counts = check_correction(contents.folder, name, value, rig)
        said[name] = [f"{value}, {'found by its name' if given is None else 'named'}"]
        most, least = max(counts.values()), min(counts.values())
        if most > 1:
            each = most if most == least else f"{least} to {most}"
            said[name][0] += f"; the mean of {each} images of each camera"
        if name == "dark" and given is None and "background" in str(value).lower():
            said[name].append("assumed: what the background shows is in the images too")
        if name == "flat":
            said[name].append("assumed: its dark level has been taken off, and its mean stays")
        found[name] = value
    for name in ("bit_depth", "bayer", "channel"):
        if getattr(request, name) is not None:
            found[name] = getattr(request, name)
            said[name] = ["named"]
    return found


def _scan(folder: Path, rig: Rig, images: CameraImages, corrections: Mapping[str, Any]) -> Scan:
    """Return the scan, which reads as its scan.yaml will."""
    paths = {
        name: folder / value if name in KINDS and isinstance(value, str) else value
        for name, value in corrections.items()
    }
    rate, notes = None, tuple[str, ...]()
    if images.films:
        rate, notes = frame_rate_of(images.films), notes_of_films(images.films)
    scan = Scan(rig, images.frames, source=folder, frame_rate=rate, notes=tuple(notes))
    return scan.with_corrections(**paths) if paths else scan


def _bit_depth(images: CameraImages, said: dict[str, list[str]]) -> dict[str, Any]:
    """Return the bits that the numbers of 16-bit images show, where all cameras agree."""
    largest = 0
    for frame in images.moments:
        paths = [image for image in frame.images.values() if isinstance(image, Path)]
        pixels = [read_still(path).pixels for path in paths]
        bits = [stored_bits(one) for one in pixels if one.dtype == np.uint16 and one.ndim == 2]
        found = {one.bits for one in bits if one.bits and not one.shift}
        if len(found) == 1:
            (depth,) = found
            said["bit_depth"] = [
                f"assumed: cameras of {depth} bits, as pixels of frame {frame.name} end at just "
                f"{2**depth - 1}"
            ]
            return {"bit_depth": depth}
        largest = max([largest, *(one.largest for one in bits)])
    fewer = next((bits for bits in FEWER if 0 < largest < 2**bits), None)
    if fewer is not None:
        said["bit_depth"] = [
            f"assumed: cameras of 16 bits, although no pixel is above {largest}; where they have "
            f"{fewer}, --bit-depth {fewer} keeps the volume from being {2 ** (16 - fewer)} times "
            "too faint"
        ]
    return {}


def _grid(scan: Scan, images: CameraImages, request: Request) -> tuple[VoxelGrid, int, list[str]]:
    """Return the voxels, by how much images may be shrunk for them, and how they were found."""
    if request.grid is not None:
        return request.grid, 1, ["named"]
    known = grid_of_rig(scan.rig)
    if known is not None and request.box is None and request.voxel is None:
        return known, 1, ["the volume of the rig"]
    if request.box is not None:
        lower, upper = request.box
        box = Box(np.array(lower, np.float64), np.array(upper, np.float64), "named")
    else:
        box = box_of_light(scan, list(dict.fromkeys(one.name for one in images.moments)))
    grid, scale, check = grid_in(scan.rig, box, request.voxel)
    said = [f"box {box.reason}"]
    unit = scan.rig.length_unit
    if request.voxel is None:
        half = check.resolved.half
        said.append(
            f"voxels of {grid.spacing[0]:g} {unit}: an eighth of the details of which the views "
            f"measure half ({half:.3g} {unit}), or a pixel, whichever is larger"
        )
    else:
        said.append(f"voxels of {grid.spacing[0]:g} {unit}, named")
    if box.cut:
        who = "all cameras" if len(box.cut) == len(scan.rig) else ", ".join(box.cut)
        said.append(
            f"light reaches the edges of the images of {who}: what they do not see "
            "of it is not in the box, so look at the pictures"
        )
    return grid, scale, said


def rig_of(contents: Contents, request: Request) -> tuple[Rig, bool, dict[str, list[str]]]:
    """Return the rig, whether it is the folder's rig.yaml as it is, and what to say of it."""
    folder = contents.folder
    named = request.rig
    others: list[str] = []
    if named is None:
        path, form, others = find_rig(folder)
    else:
        path = next((p for p in (folder / named, Path(named)) if p.exists()), Path(named))
        form = "preset" if not path.exists() and named in preset_names() else ""
    said: list[str] = []
    rig = _loaded(contents, path, request.length_unit, said)
    form = form or formats.sniff(path)
    is_kept = path == folder / RIG_FILE and request.length_unit is None
    inside = path.relative_to(folder) if path.is_relative_to(folder) else path
    where = "the folder itself" if path == folder else inside
    how = "named" if named is not None else "found"
    said.insert(0, f"{len(rig)} cameras from {where} ({form}), {how}")
    if others:
        said.append(f"not used: {', '.join(others)}; --rig takes one of them")
    if rig.length_unit == UNKNOWN:
        said.append(
            "assumed: lengths in one unknown unit, as the file names none: --length-unit says it"
        )
    names = {name: name for name in rig.names if name not in request.drop}
    for name in (*request.rename, *request.drop):
        if name in request.rename or not patterns_of(contents.light, [name]):
            rig[name]  # raises where there is none
    names |= {old: new for old, new in request.rename.items() if old in names}
    if list(names) != list(rig.names) or list(names.values()) != list(rig.names):
        gone = [name for name in rig.names if name not in names]
        rig, is_kept = with_cameras(rig, names), False
        said += [f"cameras left out, as asked: {', '.join(gone)}"] if gone else []
    alike = renamed_as_images(contents, rig) if request.pattern is None else {}
    if alike:
        rig, is_kept = with_cameras(rig, alike), False
        each = ", ".join(f"{old} is {new}" for old, new in alike.items())
        said.append(
            f"assumed: names of cameras that differ in writing alone mean the same: {each}"
        )
    if not len(rig):
        raise ValueError(f"{path}: cameras: found none, expected at least one")
    if any(camera.status == "nominal" for camera in rig):
        said.append("nominal: no calibration; errors of several pixels are expected")
    return rig, is_kept, {"rig": said}


def _loaded(contents: Contents, path: Path, unit: str | None, said: list[str]) -> Rig:
    """Return the rig of a file; one without image sizes has that of the images if it is one."""
    try:
        return load(path, length_unit=unit)
    except ValueError as error:
        if ": image_size: missing" not in str(error):
            raise
        sizes = list(sizes_of(contents.folder / one for one in contents.light))
        if len(sizes) != 1:
            raise
        said.append("assumed: image sizes, of which the file has none, are those of images")
        return load(path, length_unit=unit, image_size=sizes[0])
