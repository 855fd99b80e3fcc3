"""The findings of the stages, put together into one `Reconstruction`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigs import CameraLike, Rig
from rigs.aperture import Aperture
from tomo._compute.memory import peak_memory
from tomo.grid import VoxelGrid
from tomo.operators import STORED, LinearSystem
from tomo.pipeline.assess import Assessed
from tomo.pipeline.evaluate import Evaluated, Reference
from tomo.pipeline.load import LoadedScan
from tomo.pipeline.options import Options
from tomo.pipeline.prepare import Prepared
from tomo.pipeline.reconstruction import Reconstruction
from tomo.pipeline.solve import Compared, Solved
from tomo.pipeline.stage import Record
from tomo.rays.pixel_rays import rays_of_pixel
from tomo.scan import Scan


@dataclass(frozen=True, eq=False)
class Stages:
    """The values of all stages, in their order."""

    reference: Reference
    load: LoadedScan
    ready: Prepared
    solve: Solved
    compare: Compared
    evaluate: Evaluated
    assess: Assessed

    @property
    def records(self) -> dict[str, Record]:
        """The seconds and warnings of each, by its name in ``report.json``."""
        return {
            "load": self.reference.record + self.load.record,
            **self.ready.records,
            "solve": self.solve.record,
            "compare": self.compare.record,
            "evaluate": self.evaluate.record,
            "uncertainty": self.assess.record,
        }


def assemble(
    stages: Stages, options: Options, *, first_use: float, seconds: float
) -> Reconstruction:
    """Return the reconstruction of all stages."""
    scan, grid = stages.load.scan, stages.solve.built.system.projector.grid
    ready, built, evaluated = stages.ready, stages.solve.built, stages.evaluate
    screened, registered = ready.screened, ready.registered
    system, names = stages.solve.built.system, registered.rig.names
    pixels, gains, moved = screened.pixels, screened.gains, screened.refinement
    unseen = int(np.count_nonzero(stages.assess.unseen))
    dead = {name: asdict(lines) for name, lines in stages.load.dead_lines.items()}
    return Reconstruction(
        solution=replace(evaluated.solution, peak_memory=peak_memory()),
        rig=scan.rig,
        views=evaluated.views,
        peak=evaluated.peak,
        truth=stages.reference.truth,
        comparisons=evaluated.comparisons,
        compared=evaluated.compared,
        counts={
            "rays": system.projector.shape[0] * rays_of_pixel(**options.rays),
            "segments": system.projector.n_segments,
            "voxels": grid.size,
            "active_voxels": system.projector.active.size - unseen,
        },
        carving=registered.report(system.projector.shape[0]),
        screening={**pixels.report(), "excluded": list(screened.excluded)} if pixels else None,
        findings=screened.findings,
        detection_limits=screened.limits.report() if screened.limits else None,
        depth_of_field=depth_of_field(scan.rig, grid, options),
        refinement=moved.report() if moved else None,
        refined_rig=moved.recorded_rig(scan) if moved else None,
        gains=gains.report(names) if gains else None,
        seconds={
            **{name: record.seconds for name, record in stages.records.items()},
            "choose": stages.solve.solution.seconds["choose"],
            "total": seconds,
        },
        first_use_seconds=first_use + ready.traced.first_use_seconds,
        unseen=stages.assess.unseen,
        warnings=tuple(line for one in stages.records.values() for line in one.warnings),
        options=options,
        scan={
            "frame": stages.load.frame,
            "source": None if scan.source is None else str(Path(scan.source).absolute()),
            "origin": dict(scan.origin),
            "scale": scan.shrink,
            **scan.corrections.colours,
            **({"dead_lines": dead} if dead else {}),
            "value_unit": scan.value_unit(stages.load.frame),
            **({} if scan.radiometry is None else {"radiometry": _radiometry(scan)}),
            "grid": {"shape": grid.shape, "spacing": grid.spacing, "center": grid.center},
        },
        projector=_projector(system, options.tracer) | {"device": built.place},
        basis=stages.solve.built.basis.report(),
        pixel_weights=built.weighting,
        learned=evaluated.learned,
        uncertainty=stages.assess.uncertainty,
    )


def _radiometry(scan: Scan) -> dict[str, Any]:
    """Return ``report.json``'s ``scan.radiometry``: what a count is worth, and by whom."""
    names = scan.rig.names
    return {
        "radiance_unit": scan.radiometry.unit,
        "wavelength": scan.radiometry.wavelength,
        "calibrated": list(scan.radiometry.calibrated(names)),
        "per_count": {name: scan.per_count[name] for name in names},
        "per_count_unit": f"{scan.radiometry.value_unit} {scan.rig.length_unit}",
    }


def _projector(system: LinearSystem, tracer: str) -> dict[str, Any]:
    """Return ``report.json``'s ``projector``: on the fly no tracer is used."""
    stored = system.form == STORED
    return {
        "form": system.form,
        "reason": system.reason,
        "tracer": tracer if stored else "face crossings",
    }


ENDS = ("near", "far")


def depth_of_field(rig: Rig, grid: VoxelGrid, options: Options) -> dict[str, Any] | None:
    """Return how depth of field was modelled; None where lenses were pinholes.

    ``near`` and ``far`` hold the circle of confusion at that end of the grid by camera, in the
    rig's length unit, ``near_pixels`` and ``far_pixels`` the same in pixels.
    """
    if options.aperture_rays == 1:
        return None
    rays = rays_of_pixel(**options.rays)
    found: dict[str, Any] = {"in_words": "", "rays": rays}
    blurs = {camera.name: _blur_at_ends(camera, grid) for camera in rig}
    for number, end in enumerate(ENDS):
        found[end] = {name: blur[0][number] for name, blur in blurs.items()}
        found[f"{end}_pixels"] = {name: blur[1][number] for name, blur in blurs.items()}
    widest = (
        f"up to {max(found[end].values()):.3g} {rig.length_unit} "
        f"({max(found[f'{end}_pixels'].values()):.1f} pixels) at the {end} end"
        for end in ENDS
    )
    found["in_words"] = (
        f"depth of field was modelled by {rays} rays a pixel over the lenses' apertures; their "
        f"blur discs are {' and '.join(widest)} of the grid"
    )
    return found


def _blur_at_ends(camera: CameraLike, grid: VoxelGrid) -> tuple[list[float], list[float]]:
    """Return the blur at the grid's near and far end: in lengths, and in pixels."""
    corners = np.stack(np.meshgrid(*zip(grid.lower, grid.upper, strict=True)), -1).reshape(-1, 3)
    depths = corners @ camera.R[2] + camera.t[2]
    ends = np.maximum([depths.min(), depths.max()], min(grid.spacing))  # ahead of the camera
    blur = Aperture.of(camera).blur(ends)
    return blur.tolist(), (camera.camera_matrix[0, 0] * blur / ends).tolist()
