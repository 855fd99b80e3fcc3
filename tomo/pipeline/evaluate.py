"""Stage 8, evaluate: the volume against the truth, and images beside their re-projections.

Nothing before this stage sees the truth. The images of held-out cameras are searched for outlier
pixels with the others, and from there on seen here alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tomo import metrics
from tomo.grid import VoxelGrid
from tomo.operators import LINEAR, STORED, LinearSystem
from tomo.operators.system import VolumeNotSeenError
from tomo.operators.view_gains import Gains
from tomo.pipeline.build import WeightedSystem
from tomo.pipeline.load import LoadedScan
from tomo.pipeline.methods import method_named
from tomo.pipeline.options import Options
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.solve import Compared, Solved, Watch, with_learned_weights
from tomo.pipeline.stage import Record, as_warning, timed
from tomo.pipeline.trace import blind_warnings, through_gas
from tomo.pipeline.view import Peak, View, quality
from tomo.rays.ray_box import pixels_that_see
from tomo.scan import Scan
from tomo.scan.images import Images, Masks
from tomo.solvers import Solution

if TYPE_CHECKING:
    from tomo.pipeline.learned_weights import LearnedWeights


@dataclass(frozen=True, eq=False)
class Reference:
    """The truth ``(nx, ny, nz)`` of a simulated scan that a volume is compared with."""

    truth: NDArray[np.float32] | None
    record: Record = Record()

    @property
    def watch(self) -> Watch | None:
        """Return what measures the distance of a volume from the truth; None without one."""
        truth = self.truth
        if truth is None:
            return None
        return lambda volume: metrics.cosine_distance(volume, truth)


@dataclass(frozen=True, eq=False)
class Evaluated:
    """The solutions with their figures, and every camera's image beside its re-projection."""

    solution: Solution
    comparisons: tuple[Solution, ...]
    views: tuple[View, ...]  # one a camera, in the rig's order
    peak: Peak
    compared: tuple[Mapping[str, Mapping[str, Any]], ...] = ()  # see `View.held_out_figures`
    learned: LearnedWeights | None = None
    record: Record = Record()


def read_reference(scan: Scan, grid: VoxelGrid, frame: str | None = None) -> Reference:
    """Read a frame's truth; one on another grid is a warning."""
    with timed() as stage:
        truth, known = None, scan.read_truth(frame)
        if known is not None:
            data, truth_grid = known
            apart = np.abs([truth_grid.lower - grid.lower, truth_grid.upper - grid.upper]).max()
            if truth_grid.shape == grid.shape and apart <= 1e-6 * min(grid.spacing):
                truth = data
            else:
                name = scan.truth.name if isinstance(scan.truth, Path) else "truth"
                stage.warnings.append(
                    f"{name}: the truth is on another grid: no quality figures. Reconstruct on "
                    "its grid (--grid, --spacing, --center) to compare"
                )
    return Reference(truth, stage.record)


def trace_apart(
    screened: ScreenedScan, system: LinearSystem, options: Options
) -> LinearSystem | None:
    """Trace the cameras that took no part; before the solve, so that nothing is solved in vain."""
    if screened.apart is None:
        return None
    learns = method_named(options.method).needs_midpoints and system.form == STORED
    in_focus = not options.blur and options.aperture_rays == 1
    try:
        return LinearSystem.from_rig(
            screened.apart.rig,
            system.projector.grid,
            masks=screened.apart_masks,
            active=system.projector.active,
            midpoints=learns and in_focus,  # else nothing is learned
            tracer=options.tracer,
            **options.rays,
            form=options.projector,
        )
    except VolumeNotSeenError as error:
        raise VolumeNotSeenError(
            f"{screened.apart.where}hold_out: nothing to compare with: {error}"
        ) from None


def evaluate(
    loaded: LoadedScan,
    screened: ScreenedScan,
    solved: Solved,
    compared: Compared,
    apart: LinearSystem | None,
    reference: Reference,
    options: Options,
    peak: Peak,
) -> Evaluated:
    """Compare the volume with the truth and its re-projections with the images."""
    views, learned = [], None
    alike: list[Mapping[str, Mapping[str, Any]]] = [{} for _ in compared.solutions]
    with timed() as stage:
        if apart is not None:
            stage.warnings += blind_warnings(apart)
        with as_warning("re-projected images: not found", stage.warnings):
            found, built = solved.solution, solved.built
            system = solved.system
            views += views_of(
                system.on_voxel_means,
                found.volume,
                screened.images,
                screened.masks,
                in_sight=pixels_in_sight(system),
            )
            views += _views_apart(apart, solved, screened, options)
            if found.weights is not None:
                from tomo.pipeline.learned_weights import LearnedWeights  # loads PyTorch

                learned = LearnedWeights.of(
                    found.weights,
                    built.system.projector,
                    system.projector,
                    found.volume,
                    found.settings["held_out_residual"],
                )
            for number, other in enumerate(compared.solutions if options.hold_out else ()):
                seen = _views_apart(apart, replace(solved, solution=other), screened, options)
                alike[number] = {
                    v.name: v.held_out_figures(peak.value) for v in seen if v.held_out
                }
        order = loaded.scan.rig.names
        solutions = [
            replace(one, quality=quality(one.volume, reference.truth))
            for one in (solved.solution, *compared.solutions)
        ]
    return Evaluated(
        solutions[0],
        tuple(solutions[1:]),
        tuple(sorted(views, key=lambda view: order.index(view.name))),
        peak,
        tuple(alike),
        learned,
        stage.record,
    )


def counted(loaded: LoadedScan, screened: ScreenedScan) -> Masks:
    """Return the pixels that a peak may be of: usable ones of cameras that were not excluded."""
    masks = screened.pixels.masks if screened.pixels else loaded.masks
    return [
        mask & (name not in screened.excluded)
        for name, mask in zip(loaded.scan.rig.names, masks, strict=True)
    ]


def views_of(
    system: LinearSystem,
    volume: NDArray[np.float32],
    images: Images,
    masks: Masks,
    gains: Gains | None = None,
    in_sight: Masks | None = None,
) -> list[View]:
    """Return each camera's image beside that of the volume; ``gains`` if images have theirs."""
    projected = system.projector @ system.projector.active.compress(volume)
    seen = system.images(projected)
    if gains is not None:  # pixels that see no active voxel show the background alone
        pairs = zip(seen, gains.gain, gains.offset, strict=True)
        seen = [(gain * image + offset).astype(np.float32) for image, gain, offset in pairs]
    sights: Sequence[NDArray[np.bool_] | None] = in_sight or [None] * len(seen)
    return [
        View(camera.name, image, reprojected, mask, in_sight=sight)
        for camera, image, reprojected, mask, sight in zip(
            system.rig, images, seen, masks, sights, strict=True
        )
    ]


def pixels_in_sight(system: LinearSystem) -> Masks:
    """Return which pixels of each camera may see the grid."""
    found = []
    for camera in system.rig:
        width, height = camera.image_size
        sight = np.zeros(height * width, bool)
        sight[pixels_that_see(camera, system.projector.grid)] = True
        found.append(sight.reshape(height, width))
    return found


def system_apart(
    apart: LinearSystem,
    built: WeightedSystem,
    volume: NDArray[np.float32] | None,
    options: Options,
) -> LinearSystem:
    """Return the equations of cameras that took no part, as those that were solved."""
    if options.blur:
        apart = apart.with_lens_blur(options.blur)
    if built.basis.name == LINEAR:
        apart = apart.with_linear_basis(options.supersample)
    return through_gas(apart, built.absorption, volume, options)


def _views_apart(
    apart: LinearSystem | None, solved: Solved, screened: ScreenedScan, options: Options
) -> list[View]:
    """Return the images that took no part beside the images that the volume would have shown."""
    if apart is None:
        return []
    system = system_apart(apart, solved.built, solved.solution.volume, options)
    system = with_learned_weights(system, solved.solution)
    found = views_of(
        system.on_voxel_means,
        solved.solution.volume,
        screened.apart_images,
        screened.apart_masks,
        in_sight=pixels_in_sight(apart),
    )
    return [
        replace(
            view,
            held_out=view.name in options.hold_out,
            excluded=view.name in screened.excluded,
        )
        for view in found
    ]
