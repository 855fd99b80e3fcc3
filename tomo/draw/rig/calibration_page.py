"""The page of a calibration: its assessment, then the evidence; it loads no other file."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigs.camera_protocol import has_lens
from rigs.files.text import write_text
from rigs.scene.scene_camera import own_camera
from tomo.draw.figures import png_bytes
from tomo.draw.page import embedded, render
from tomo.draw.rig.calibration_figures import (
    ImageOf,
    draw_coverage,
    draw_depths,
    draw_residuals,
    draw_worst,
)
from tomo.draw.rig.rig_scene import grid_of, rig_scene, up_of
from tomo.draw.rig.surroundings import calibration_targets
from tomo.draw.stage import stage
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from rigs.calibrate import Calibration

_LEVELS = {"good": "green", "doubtful": "amber", "poor": "red"}

Columns = Sequence[tuple[str, Callable[[int], Any]]]
"""The titles of a table's columns, and what gives a row's entry."""


def write_calibration_page(
    path: str | os.PathLike,
    calibration: Calibration,
    *,
    title: str = "Calibration",
    image_of: ImageOf | None = None,
    details: Mapping[str, Any] | None = None,
) -> None:
    """Write the page.

    Parameters
    ----------
    path : path-like
        ``calibration.html``.
    image_of : callable, optional
        Returns a camera's grey image of a frame, ``(rows, columns)``, or None; called for the
        images that fit worst. By default they are those of the calibration; without any they are
        not shown.
    details : mapping, optional
        What the calibration was made from, in words.
    """
    grid = grid_of(calibration.rig) or _evaluated_box(calibration)
    if image_of is None and calibration.images is not None:
        image_of = _reader(calibration.images)
    figures = {
        "residuals": draw_residuals(calibration),
        "worst": None if image_of is None else draw_worst(calibration, image_of),
        "coverage": draw_coverage(calibration),
        "depths": draw_depths(calibration, grid),
    }
    rig = calibration.rig
    scene = rig_scene(rig, grid).without("field of view", "arrows", "arrow names", "stems")
    text = render(
        "calibration.html",
        title=title,
        about=f"{len(rig)} cameras in {rig.length_unit}.",
        verdict=_verdict(calibration),
        headline=_headline(calibration),
        world=rig.world_frame,
        cameras=_cameras(calibration),
        lenses=_lenses(calibration),
        frames=_frames(calibration),
        pictures={name: one and embedded(png_bytes(one)) for name, one in figures.items()},
        stage=stage(scene + calibration_targets(calibration), up=up_of(rig), grid=grid),
        details=[(key, str(value)) for key, value in (details or {}).items()],
    )
    write_text(path, text)


def _reader(images: Mapping[str, Mapping[str, Any]]) -> ImageOf:
    """Return what reads a camera's image of a frame."""
    from rigs.calibrate.detect.image_sets import read_source

    def image_of(camera: str, frame: str) -> NDArray:
        return read_source(images[camera][frame])

    return image_of


def _evaluated_box(calibration: Calibration) -> VoxelGrid | None:
    """Return the box of the points where ray-miss was evaluated; None where they have none."""
    points = calibration.quality.points
    if not len(points) or not (np.ptp(points, axis=0) > 0).all():
        return None
    return VoxelGrid.from_bounds((1, 1, 1), points.min(axis=0), points.max(axis=0))


def _verdict(calibration: Calibration) -> dict[str, Any]:
    """Return the assessment, and below it the findings and the notes."""
    first = calibration.assessment.split("\n")[0]
    word, _, rest = first.partition(": ")
    lines = [rest if word in _LEVELS else first, *calibration.findings, *calibration.notes]
    return {
        "level": _LEVELS.get(word, "amber"),
        "badge": word.capitalize() if word in _LEVELS else "Not known",
        "means": "",
        "reasons": lines,
        "next": (),
    }


def _headline(calibration: Calibration) -> list[tuple[str, str, str]]:
    """Return the page's first figures: (value, name, what it means)."""
    quality, unit = calibration.quality, calibration.rig.length_unit
    rows = []
    if math.isfinite(quality.predicted_ray_miss):
        miss = quality.predicted_ray_miss
        fraction = miss / float(np.nanmedian(quality.footprint))
        rows.append((f"{miss:.2g} {unit}", "predicted ray-miss", f"{fraction:.2g} of a pixel"))
    if math.isfinite(quality.cross_ray_miss):
        words = f"between halves of the frames; {quality.cross_expected:.2g} expected"
        rows.append((f"{quality.cross_ray_miss:.2g} {unit}", "cross-validated", words))
    used = calibration.used
    rms = math.sqrt((calibration.residuals[used] ** 2).sum(axis=1).mean())
    frames = int(np.isfinite(quality.frame_rms).sum())
    return [
        *rows,
        (f"{rms:.3g} px", "RMS residual", f"noise of a coordinate {calibration.noise:.2g} px"),
        (f"{len(calibration.rig)}", "cameras", f"{calibration.gauge} was held"),
        (f"{frames}", "frames", f"of {len(quality.frame_rms)} with images"),
        (f"{int(used.sum())}", "points used", f"{int((~used).sum())} left out"),
    ]


def _cameras(calibration: Calibration) -> tuple:
    """Return the table of cameras; those named in findings are marked."""
    quality, used = calibration.quality, calibration.used
    owner, unit = calibration.observations.camera, calibration.rig.length_unit
    names = calibration.rig.names
    columns: Columns = (
        ("Camera", lambda n: names[n]),
        ("RMS (px)", lambda n: _text(quality.camera_rms[n])),
        (f"ray-miss ({unit})", lambda n: _text(quality.camera_ray_miss[n], 2)),
        ("images", lambda n: int(np.isfinite(quality.image_rms[n]).sum())),
        ("points used", lambda n: int((used & (owner == n)).sum())),
        ("left out", lambda n: int((~used & (owner == n)).sum())),
        ("image covered", lambda n: f"{quality.image_coverage[n]:.0%}"),
        (f"depths ({unit})", lambda n: " to ".join(map(_text, quality.depth_range[n]))),
        (f"pixel ({unit})", lambda n: _text(quality.footprint[n])),
        ("taken later by (frames)", lambda n: _offset(calibration, n)),
    )
    blamed = [n for n, name in enumerate(names) if _blamed(calibration, f"camera {name}")]
    return *_table(columns, len(names)), blamed, _shares(quality.camera_rms)


def _lenses(calibration: Calibration) -> tuple:
    """Return the table of lenses."""
    cameras = [own_camera(camera) for camera in calibration.rig]
    lenses = [camera for camera in cameras if has_lens(camera)]  # all: `calibrate` finds lenses
    matrices = [lens.camera_matrix for lens in lenses]
    focal_error = calibration.quality.focal_error
    terms = [", ".join(f"{one:.4g}" for one in lens.distortion.coefficients) for lens in lenses]
    columns: Columns = (
        ("Camera", lambda n: lenses[n].name),
        ("image", lambda n: "{} x {}".format(*lenses[n].image_size)),
        ("fx (px)", lambda n: f"{matrices[n][0, 0]:.2f}"),
        ("fy (px)", lambda n: f"{matrices[n][1, 1]:.2f}"),
        ("uncertain by", lambda n: f"{100 * focal_error[n]:.2g} %"),
        ("cx (px)", lambda n: f"{matrices[n][0, 2]:.2f}"),
        ("cy (px)", lambda n: f"{matrices[n][1, 2]:.2f}"),
        ("terms", lambda n: calibration.terms[n]),
        ("distortion", lambda n: f"{lenses[n].distortion.model} {terms[n]}"),
    )
    return *_table(columns, len(lenses)), (), (), (7, 8)


def _frames(calibration: Calibration) -> tuple:
    """Return the table of frames; those named in findings are marked."""
    quality, observations, used = calibration.quality, calibration.observations, calibration.used

    def worst(n: int) -> str:
        images = quality.image_rms[:, n]
        if not np.isfinite(images).any():
            return "no pose"
        camera = int(np.nanargmax(images))
        return f"{observations.cameras[camera]}, {_text(images[camera])} px"

    columns: Columns = (
        ("Frame", lambda n: observations.frames[n]),
        ("RMS (px)", lambda n: _text(quality.frame_rms[n])),
        ("cameras", lambda n: int(np.isfinite(quality.image_rms[:, n]).sum())),
        ("points used", lambda n: int((used & (observations.frame == n)).sum())),
        ("left out", lambda n: int((~used & (observations.frame == n)).sum())),
        ("largest in", worst),
    )
    names = observations.frames
    blamed = [n for n, name in enumerate(names) if _blamed(calibration, f"frame {name}")]
    return *_table(columns, len(names)), blamed, _shares(quality.frame_rms), (5,)


def _table(columns: Columns, count: int) -> tuple[list[str], list[list[str]]]:
    """Return a table's titles and rows."""
    rows = [[str(entry(n)) for _, entry in columns] for n in range(count)]
    return [title for title, _ in columns], rows


def _offset(calibration: Calibration, camera: int) -> str:
    """Return when a camera took its images, in frames; a dash where no film shows it."""
    step = calibration.synchrony
    if step is None or not math.isfinite(step.error[camera]):
        return "–"
    return f"{step.offset[camera]:+.3f} ± {step.error[camera]:.1g}"


def _blamed(calibration: Calibration, what: str) -> bool:
    """Return whether a finding begins with this camera or frame."""
    return any(finding.startswith((f"{what}:", f"{what},")) for finding in calibration.findings)


def _shares(values: NDArray) -> list[float]:
    """Return the lengths of bars in per cent of the longest."""
    known = np.nan_to_num(values, nan=0.0, posinf=0.0)
    return (100 * known / (known.max(initial=0.0) or 1.0)).tolist()


def _text(value: float, digits: int = 3) -> str:
    """Return a number to some digits; a dash where there is none."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    decimals = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:.{decimals}f}" if decimals < 8 else f"{value:.{digits}g}"
