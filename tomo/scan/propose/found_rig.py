"""The rig of a folder of images: found or named, with the cameras and the names of the images."""

from __future__ import annotations

from pathlib import Path

from rigs import Rig, formats, load, preset_names
from rigs.changes import with_cameras
from rigs.files.units import UNKNOWN
from rigs.recordings.naming import patterns_of
from tomo.scan.propose.camera_images import renamed_as_images, sizes_of
from tomo.scan.propose.contents import RIG_FILE, Contents, find_rig
from tomo.scan.propose.request import Request


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
