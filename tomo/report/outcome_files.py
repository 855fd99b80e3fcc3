"""The output folder of a reconstruction: volumes, pictures, report.html and report.json."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

from rigs import save_rig
from rigs.files import whole_folder
from rigs.files.text import write_json
from tomo.draw.frame import UP
from tomo.draw.rig.rig_scene import up_of
from tomo.draw.rig.surroundings import target_scene
from tomo.draw.rig.visualize import RigPage
from tomo.draw.scene import Scene
from tomo.draw.stage import Shown, stage
from tomo.draw.writers import write_page
from tomo.grid.volume import Volume
from tomo.io import write_volume
from tomo.pipeline import Reconstruction
from tomo.pipeline.stage import as_warning
from tomo.report.about import About
from tomo.report.pictures import Picture, draw, write_pictures
from tomo.report.report import write_report
from tomo.report.result_figures import seen_volume

PICTURES = ("rig", "flame", "convergence", "difference", "learned", "intervals", "condition")

RIG_FILE = "refined_rig.yaml"
"""The rig with its refined cameras, where there are any; a scan's own is its ``rig.yaml``."""

PAGE, FIGURES = "report.html", "report.json"

FLAME, RIG = "flame.html", "rig.html"
"""Pages to turn the volume, and the cameras around it, in a whole window."""

VOLUME_FILES = ("volume.npz", "volume.vti", "volume.nrrd")

DEVIATION_FILES = ("standard_deviation.npz", "standard_deviation.vti", "standard_deviation.nrrd")
"""Beside them where the standard deviation of single voxels is known."""

INTERVAL_FILES = ("half_width.npz", "half_width.vti", "half_width.nrrd")
"""Beside them where the voxels' 90 % intervals are known."""

_OTHERS = (
    RIG_FILE, FLAME, RIG, *DEVIATION_FILES, *INTERVAL_FILES,
    *(f"{name}.png" for name in PICTURES),
)  # fmt: skip
"""What an outcome may have, or lack."""

PREVIEW_FILES = ("preview.npz", "preview.json", "preview.png")
"""What stands for the rest until that is there: volume, figures, picture."""


@dataclass(frozen=True)
class Drawn:
    """Pictures and pages of a reconstruction, with a line on each that could not be drawn."""

    pictures: tuple[Picture, ...] = ()
    pages: Mapping[str, bytes] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    turned: Mapping[str, Any] | None = None  # the stage of the volume on the report's page

    def __add__(self, other: Self) -> Drawn:
        """Return both, pictures in their order on the page."""
        pictures = sorted((*self.pictures, *other.pictures), key=lambda p: PICTURES.index(p.name))
        pages = {**self.pages, **other.pages}
        warnings = (*self.warnings, *other.warnings)
        return Drawn(tuple(pictures), pages, warnings, self.turned or other.turned)


def drawn(outcome: Reconstruction, known: Collection[str] = ()) -> Drawn:
    """Draw pictures and pages, but for those ``known``, by name."""
    warnings: list[str] = []
    pictures, pages, turned = draw(outcome, warnings, known), {}, None
    if FLAME not in known:
        with (
            as_warning("flame.html, rig.html: not drawn", warnings),
            TemporaryDirectory() as folder,
        ):
            turned = _write_pages(Path(folder), outcome)
            pages = {path.name: path.read_bytes() for path in Path(folder).iterdir()}
    return Drawn(pictures, pages, tuple(warnings), turned)


def write_outcome(
    folder: str | os.PathLike,
    outcome: Reconstruction,
    *,
    with_pictures: bool = True,
    command: str = "",
    known: Drawn | None = None,
) -> dict[str, Any]:
    """Write everything about a reconstruction into a folder; return what is in ``report.json``.

    Until all is written, the folder keeps what stood there before: see `rigs.files.whole_folder`.
    ``report.json`` comes last: where it stands, the rest is complete and of the same run. Where
    cameras were refined, ``refined_rig.yaml`` is the rig with them; where the standard deviation
    of single voxels is known, ``standard_deviation.npz``, ``.vti`` and ``.nrrd`` hold it, and
    ``half_width.*`` the half-widths of 90 % intervals. Pictures, rig and these volumes of an
    earlier outcome that this one does not have are removed, and so is a preview. The report's
    ``warnings`` name the pictures that could not be drawn. No picture is drawn where
    ``with_pictures`` is False, and the page has none; those ``known`` are not drawn again. The
    page names the ``command`` that was given.
    """
    report = outcome.report()
    with whole_folder(folder, last=(PAGE, FIGURES), others=(*_OTHERS, *PREVIEW_FILES)) as staging:
        _write_volumes(staging, VOLUME_FILES, outcome.volume)
        if outcome.standard_deviation is not None:
            deviation = outcome.volume.like(outcome.standard_deviation)
            _write_volumes(staging, DEVIATION_FILES, deviation)
        if outcome.half_width is not None:
            _write_volumes(staging, INTERVAL_FILES, outcome.volume.like(outcome.half_width))
        shown = known or (drawn(outcome) if with_pictures else Drawn())
        report["warnings"] += shown.warnings
        write_pictures(staging, shown.pictures)
        for name, page in shown.pages.items():
            (staging / name).write_bytes(page)
        files = sorted([*(path.name for path in staging.iterdir()), FIGURES])
        about = About(Path(folder), command, files)
        write_report(staging / PAGE, report, outcome, shown.pictures, about, shown.turned)
        if outcome.refined_rig is not None:
            save_rig(outcome.refined_rig, staging / RIG_FILE)
        write_json(staging / FIGURES, report, indent=2)
    return report


def write_volumes(folder: str | os.PathLike, outcome: Reconstruction) -> None:
    """Write the volume's files alone; an earlier outcome in the folder is removed."""
    with whole_folder(folder, last=(PAGE, FIGURES), others=_OTHERS) as staging:
        _write_volumes(staging, VOLUME_FILES, outcome.volume)


def write_with_units(path: Path, volume: Volume, *, allow_nan: bool = False) -> None:
    """Write a volume with its own grid and units; voxels may be NaN where that is allowed."""
    units = {"length_unit": volume.length_unit, "value_unit": volume.value_unit}
    write_volume(path, volume, volume.grid, **units, allow_nan=allow_nan)


def _write_volumes(folder: Path, names: Sequence[str], volume: Volume) -> None:
    for name in names:
        write_with_units(folder / name, volume, allow_nan=names == VOLUME_FILES)


def _write_pages(folder: Path, outcome: Reconstruction) -> dict[str, Any]:
    """Write the pages that show the volume, and the rig around it; return the volume's stage."""
    rig = outcome.rig
    up = up_of(rig) if len(rig) else UP
    shown = Shown((seen_volume(outcome),), up=up)
    turned = stage(Scene(length_unit=rig.length_unit), shown=shown, turning=True)
    write_page(folder / FLAME, turned, title="Reconstructed volume")
    if len(rig):
        page = RigPage(rig, outcome.volume.grid, title="Cameras and volume")
        page.write(folder / RIG, target_scene(rig), shown)
    return turned
