"""The page of a calibration: its assessment, then the evidence; it loads no other file."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigs.camera_protocol import has_lens
from rigs.files import atomic_path
from rigs.scene.scene_camera import own_camera
from tomo.draw.calibration.calibration_figures import (
    ImageOf,
    draw_coverage,
    draw_depths,
    draw_residuals,
    draw_worst,
)
from tomo.draw.calibration.calibration_scene import calibration_scene
from tomo.draw.figures import png_bytes
from tomo.draw.page import embedded, render
from tomo.draw.rig.rig_scene import grid_of, up_of
from tomo.draw.stage import stage
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from rigs.calibrate import Calibration

_PICTURES = {
    "residuals": (
        "Residuals over the images",
        "Measured less projected. Arrows that point the same way in neighbouring cells are what "
        "the lens model does not describe; arrows at random are noise.",
    ),
    "worst": (
        "Images that fit worst",
        "Points as detected and as the rig projects them, those left out included.",
    ),
    "coverage": (
        "Coverage of the images",
        "Where the target was seen. Where it was not, the lens is extrapolated.",
    ),
    "depths": (
        "Coverage of depth",
        "How far from each camera the target was: it should reach through the volume and beyond.",
    ),
}


def write_calibration_page(
    path: str | os.PathLike,
    calibration: Calibration,
    *,
    title: str = "Calibration",
    image_of: ImageOf | None = None,
    notes: Sequence[str] | None = None,
    grid: VoxelGrid | None = None,
    details: Mapping[str, Any] | None = None,
) -> None:
    """Write the page.

    Parameters
    ----------
    path : path-like
        ``calibration.html``.
    calibration : Calibration
    title : str
    image_of : callable, optional
        Returns a camera's grey image of a frame, ``(rows, columns)``, or None; called for the
        images that fit worst. By default they are those of the calibration; without any they are
        not shown.
    notes : sequence of str, optional
        What is to be said after the findings, a line each; the calibration's when None.
    grid : VoxelGrid, optional
        The voxels to show; when None those of the rig, else the box that was evaluated.
    details : mapping, optional
        What the calibration was made from, in words.
    """
    grid = grid_of(calibration.rig, grid) or _evaluated_box(calibration)
    notes = calibration.notes if notes is None else notes
    if image_of is None and calibration.images is not None:
        image_of = _reader(calibration.images)
    figures = {
        "residuals": draw_residuals(calibration),
        "worst": None if image_of is None else draw_worst(calibration, image_of),
        "coverage": draw_coverage(calibration),
        "depths": draw_depths(calibration, grid),
    }
    word, assessment = _assessment(calibration)
    scene = calibration_scene(calibration, grid)
    text = render(
        "calibration.html",
        title=title,
        word=word,
        assessment=assessment,
        findings=[*calibration.findings, *notes],
        headline=_headline(calibration),
        unit=calibration.rig.length_unit,
        world=calibration.rig.world_frame,
        cameras=_camera_rows(calibration),
        frames=_frame_rows(calibration),
        pictures={
            name: {
                "title": _PICTURES[name][0],
                "alt": _PICTURES[name][0],
                "caption": _PICTURES[name][1],
                "data": embedded(png_bytes(figure)),
            }
            for name, figure in figures.items()
            if figure is not None
        },
        stage=stage(
            scene.without("stems", "field of view", "arrows", "arrow names"),
            up=up_of(calibration.rig),
            grid=grid,
        ),
        details=[(key, str(value)) for key, value in (details or {}).items()],
    )
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


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


def _assessment(calibration: Calibration) -> tuple[str, str]:
    """Return the assessment's first word, and the rest of its first line."""
    first = calibration.assessment.split("\n")[0]
    word, colon, rest = first.partition(":")
    return (word, colon + rest) if " " not in word else ("", first)


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


def _camera_rows(calibration: Calibration) -> list[dict[str, Any]]:
    """Return one row a camera; cameras named in findings are marked."""
    quality, observations = calibration.quality, calibration.observations
    worst = _largest(quality.camera_rms)
    rows = []
    for index, camera in enumerate(map(own_camera, calibration.rig)):
        assert has_lens(camera)  # `calibrate` finds lenses
        own = observations.camera == index
        (fx, _, cx), (_, fy, cy) = camera.camera_matrix[:2]
        near, far = quality.depth_range[index]
        terms = camera.distortion.coefficients
        rows.append(
            {
                "name": camera.name,
                "blamed": _blamed(calibration, f"camera {camera.name}"),
                "rms": _text(quality.camera_rms[index]),
                "bar": _share(quality.camera_rms[index], worst),
                "ray_miss": _text(quality.camera_ray_miss[index], 2),
                "images": int(np.isfinite(quality.image_rms[index]).sum()),
                "used": int((own & calibration.used).sum()),
                "left_out": int((own & ~calibration.used).sum()),
                "coverage": f"{quality.image_coverage[index]:.0%}",
                "depths": f"{_text(near)} to {_text(far)}",
                "footprint": _text(quality.footprint[index]),
                "size": "{} x {}".format(*camera.image_size),
                "fx": f"{fx:.2f}",
                "fy": f"{fy:.2f}",
                "cx": f"{cx:.2f}",
                "cy": f"{cy:.2f}",
                "focal_error": f"{100 * quality.focal_error[index]:.2g} %",
                "offset": _offset(calibration, index),
                "terms": calibration.terms[index],
                "distortion": f"{camera.distortion.model} "
                + ", ".join(f"{value:.4g}" for value in terms),
            }
        )
    return rows


def _offset(calibration: Calibration, camera: int) -> str:
    """Return when a camera took its images, in frames; a dash where no film shows it."""
    step = calibration.synchrony
    if step is None or not math.isfinite(step.error[camera]):
        return "–"
    return f"{step.offset[camera]:+.3f} ± {step.error[camera]:.1g}"


def _frame_rows(calibration: Calibration) -> list[dict[str, Any]]:
    """Return one row a frame."""
    quality, observations = calibration.quality, calibration.observations
    worst = _largest(quality.frame_rms)
    rows = []
    for index, name in enumerate(observations.frames):
        own = observations.frame == index
        images = quality.image_rms[:, index]
        seen = np.isfinite(images)
        words = "no pose"
        if seen.any():
            camera = int(np.nanargmax(images))
            words = f"{observations.cameras[camera]}, {_text(images[camera])} px"
        rows.append(
            {
                "name": name,
                "blamed": _blamed(calibration, f"frame {name}"),
                "rms": _text(quality.frame_rms[index]),
                "bar": _share(quality.frame_rms[index], worst),
                "cameras": int(seen.sum()),
                "used": int((own & calibration.used).sum()),
                "left_out": int((own & ~calibration.used).sum()),
                "worst": words,
            }
        )
    return rows


def _blamed(calibration: Calibration, what: str) -> bool:
    """Return whether a finding begins with this camera or frame."""
    return any(finding.startswith((f"{what}:", f"{what},")) for finding in calibration.findings)


def _largest(values: np.ndarray) -> float:
    return float(np.max(values[np.isfinite(values)], initial=0.0)) or 1.0


def _share(value: float, largest: float) -> float:
    """Return the length of a bar in per cent."""
    return 100 * value / largest if math.isfinite(value) else 0.0


def _text(value: float, digits: int = 3) -> str:
    """Return a number to some digits; a dash where there is none."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    decimals = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:.{decimals}f}" if decimals < 8 else f"{value:.{digits}g}"
