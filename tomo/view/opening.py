"""Content from what is on disk: an outcome, a store of frames, a volume, a rig or a scan."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rigs import Rig, load_rig
from tomo.draw.volume.visualize import volume_of
from tomo.grid import Volume, VoxelGrid
from tomo.io import VolumeFilm, read_volume
from tomo.pipeline import Reconstruction
from tomo.report.outcome_files import FIGURES, RIG_FILE, VOLUME_FILES
from tomo.scan import Scan
from tomo.scan.files import scan_again
from tomo.series.store import SeriesStore
from tomo.series.verdict import SeriesTable
from tomo.view.content import Content, Frames, Model

HOW = "--scan SCAN, or --rig and --images, name it"


def content_of_outcome(folder: Path, scan: Scan | None = None) -> Content:
    """Return the content of a folder that ``flametomo reconstruct -o FOLDER`` wrote.

    The scan is the one that ``report.json`` names when None.

    Raises
    ------
    ValueError
        If a file is damaged, or the scan has not the frame or the cameras of the outcome.
    FileNotFoundError
        If there is no volume.
    """
    report = _report(folder / FIGURES)
    volume = volume_of(folder / VOLUME_FILES[0])
    refined = load_rig(folder / RIG_FILE) if (folder / RIG_FILE).is_file() else None
    return _content_of_report(folder.name, volume, report, refined, None, scan, folder)


def content_of_result(result: Reconstruction, scan: Scan | None = None) -> Content:
    """Return the content of a reconstruction in memory, and the scan it came from."""
    own, refined = volume_of(result), result.refined_rig
    return _content_of_report(
        "reconstruction", own, result.report(), refined, result.rig, scan, Path()
    )


def _content_of_report(
    title: str,
    volume: Volume,
    report: Mapping[str, Any],
    refined: Rig | None,
    rig: Rig | None,
    scan: Scan | None,
    folder: Path,
) -> Content:
    """Return the content of a volume and its report; ``rig`` is shown where no scan is known."""
    about = report.get("scan") or {}
    notes: list[str] = []
    scan = scan or _found_scan(about, folder, notes)
    rig = refined or rig
    if scan is not None:
        scan = _as_reconstructed(scan, refined, about)
        rig = scan.rig
        _check_lengths(scan, volume.length_unit, folder)
    views = report.get("views") or {}
    name = about.get("frame")
    moments = () if scan is None else (scan.frame(name).name,)
    return Content(
        title,
        rig,
        volume.grid,
        Frames(moments or (name or "volume",), lambda place: volume),
        scan,
        moments,
        volume.value_unit,
        volume.length_unit,
        Model.of(report.get("basis"), report.get("gains")),
        lambda camera, place: (views.get(camera) or {}).get("relative_residual"),
        tuple(notes),
    )


def content_of_film(path: Path, scan: Scan | None = None) -> Content:
    """Return the content of a store that ``flametomo reconstruct --frames`` wrote, or of a film.

    Raises
    ------
    ValueError
        If it is no store or has no complete frame, or the scan does not have its frames.
    """
    if VolumeFilm.is_at(path):
        film = VolumeFilm(path)
        frames = Frames(tuple(f"frame {n}" for n in range(film.n_frames)), film.read)
        if scan is not None:
            _check_lengths(scan, film.length_unit, path)
            if len(scan.frames) != film.n_frames:
                found = f"found {len(scan.frames)}, expected {film.n_frames}, those of {path}"
                raise ValueError(f"{scan.where}frames: {found}")
        return Content(
            path.stem, scan and scan.rig, film.grid, frames, scan,
            scan.frame_names if scan else (), length_unit=film.length_unit,
        )  # fmt: skip
    store = SeriesStore(path)
    about = store.attributes
    store.check_present(range(store.n_frames))
    places = np.flatnonzero(store.complete)
    if not len(places):
        raise ValueError(f"{path}: frames: found none that is complete, expected one")
    notes: list[str] = []
    scan = scan or _found_scan(about, path.parent, notes)
    corrected = _stored_rig(about.get("corrected_rig"), path, notes)
    rig = corrected or _stored_rig(about.get("rig"), path, notes)
    names = (about.get("scan") or {}).get("frames")
    moments: tuple[str, ...] = ()
    if scan is not None:
        settings = about.get("scan") or {}
        scan = _as_reconstructed(scan, corrected, settings | (settings.get("corrections") or {}))
        rig = scan.rig
        _check_lengths(scan, about["length_unit"], path)
        moments = tuple(
            scan.frame(names[place] if names else None).name for place in places.tolist()
        )
    if left := store.n_frames - len(places):
        notes.append(f"{left} of {store.n_frames} frames are not complete and not shown")
    plan = about.get("plan") or {}
    table = SeriesTable.of(store)
    shown = tuple(table.label(place) for place in places.tolist())
    residuals = table.columns["view_residual"]
    columns = {name: column for column, name in enumerate(about["cameras"])}

    def residual(camera: str, place: int) -> float | None:
        column = columns.get(camera)
        found = np.nan if column is None else float(residuals[places[place], column])
        return found if np.isfinite(found) else None

    return Content(
        path.stem,
        rig,
        store.grid,
        Frames(shown, lambda place: store.volume(int(places[place]))),
        scan,
        moments,
        about["value_unit"],
        about["length_unit"],
        Model.of(plan.get("basis"), plan.get("gains")),
        residual,
        tuple(notes),
    )


def content_of_volume(path: Path, scan: Scan | None = None) -> Content:
    """Return the content of a volume file with its own grid, and of a scan that it is shown by."""
    data, voxels, unit = read_volume(path, allow_nan=True)
    if scan is not None:
        return _content_of_report(path.stem, data, {}, None, None, scan, path)
    frames, values = Frames((path.stem,), lambda place: data), data.value_unit
    return Content(path.stem, None, voxels, frames, value_unit=values, length_unit=unit)


def content_of_rig(
    title: str, rig: Rig, grid: VoxelGrid | None = None, scan: Scan | None = None
) -> Content:
    """Return the content of a rig, with the images of a scan by it where there is one."""
    if not len(rig):
        raise ValueError(f"{title}: cameras: found none, expected at least one to show")
    moments: tuple[str, ...] = ()
    if scan is not None:
        if scan.rig != rig:
            scan = _as_reconstructed(scan, rig, {})
        rig, grid = scan.rig, grid or scan.grid
        whole = (one for one in scan.frames if one.images.keys() >= set(rig.names))
        moments = tuple(one.name for one in whole)
        if not moments:
            raise ValueError(f"{scan.where}frames: found none with an image of every camera")
    return Content(title, rig, grid, scan=scan, moments=moments, length_unit=rig.length_unit)


def _report(path: Path) -> Mapping[str, Any]:
    """Return what is in a report.json."""
    try:
        report = json.loads(path.read_text("utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: not JSON: {error}") from None
    if not isinstance(report, dict):
        raise ValueError(f"{path}: found {type(report).__name__}, expected a mapping")
    return report


def _found_scan(about: Mapping[str, Any], beside: Path, notes: list[str]) -> Scan | None:
    """Return the scan that something was made from, as it says; a note where it is not there."""
    source = about.get("source")
    if not source:
        notes.append(f"measured images: the scan is not on record; {HOW}")
        return None
    places = [Path(source), *(folder / Path(source).name for folder in (beside, beside.parent))]
    there = [place for place in places if place.exists()]
    if not there:
        notes.append(f"measured images: no scan at {source} any more; {HOW}")
        return None
    try:
        return scan_again(there[0], about.get("origin") or {})
    except (ValueError, OSError) as error:
        notes.append(f"measured images: {' '.join(str(error).split())}; {HOW}")
        return None


def _as_reconstructed(scan: Scan, rig: Rig | None, about: Mapping[str, Any]) -> Scan:
    """Return a scan with the rig, the colour and the scale that were used."""
    if rig is not None:
        common = [name for name in scan.rig.names if name in rig.names]
        if not common:
            raise ValueError(
                f"{scan.where}cameras: found {', '.join(scan.rig.names)}, expected those of "
                f"the outcome, {', '.join(rig.names)}"
            )
        known = scan.only(*common)
        cameras = tuple(rig[name] for name in common)
        for camera in cameras:
            size = tuple(scan.recorded_sizes[camera.name])
            if tuple(camera.image_size) != size:
                raise ValueError(
                    f"{scan.where}camera {camera.name}: found images of {size[0]} x {size[1]} "
                    f"pixels, expected {camera.image_size[0]} x {camera.image_size[1]}, those "
                    "that the outcome was made from"
                )
        if scan.shrink == 1:
            scan = replace(known, rig=replace(rig, cameras=cameras), recorded_sizes=None)
        else:  # of a scan in memory: its sizes are those recorded already
            small = tuple(camera.shrunk(scan.shrink) for camera in cameras)
            scan = replace(known, rig=replace(rig, cameras=small))
    own = scan.corrections
    channel, bayer = about.get("channel"), about.get("bayer")
    if isinstance(channel, str) and own.channel is None:
        scan = scan.of_channel(channel, bayer if isinstance(bayer, str) else None)
    scale = about.get("scale")
    return scan.scaled(scale) if isinstance(scale, int) and scan.shrink == 1 else scan


def _check_lengths(scan: Scan, unit: str, where: Path) -> None:
    if scan.rig.length_unit != unit:
        raise ValueError(
            f"{scan.where}length_unit: found {scan.rig.length_unit!r}, expected {unit!r}, "
            f"that of {where}"
        )


def _stored_rig(stored: Mapping[str, Any] | None, path: Path, notes: list[str]) -> Rig | None:
    """Return the rig in a store's attributes; a note where it needs files beside it."""
    if not stored:
        return None
    import yaml

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rig.yaml"
        file.write_text(yaml.safe_dump(dict(stored)), "utf-8")
        try:
            return load_rig(file)
        except (ValueError, OSError) as error:
            said = " ".join(str(error).split()).replace(str(file), str(path))
            notes.append(f"cameras: {said}; {HOW}")
            return None
