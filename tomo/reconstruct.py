"""From a scan to a volume: load, trace, solve, and judge the result."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo import metrics
from tomo.grid import VoxelGrid
from tomo.io import is_integer_image, read_volume
from tomo.linear_system import LinearSystem
from tomo.methods import AUTO, Method, method_named
from tomo.outcome import Outcome, View, peak_memory, quality
from tomo.projector import Projector
from tomo.rays import Rays
from tomo.reconstruction import Reconstruction
from tomo.scan import Images, Masks, Scan
from tomo.solve.stopping import choose_by_held_out_views, solve_as_chosen
from tomo.trace import trace

logger = logging.getLogger(__name__)

Progress = Callable[[int, int, str], None]
"""Called as ``progress(done, total, where)``."""


def reconstruct(
    scan: Scan,
    grid: VoxelGrid | None = None,
    *,
    method: str = AUTO,
    frame: str | None = None,
    hold_out: Sequence[str] = (),
    iterations: int | None = None,
    compare: Sequence[tuple[str, int | None]] = (),
    tracer: str = "march",
    skip: bool = True,
    supersample: int = 1,
    device: str = "cpu",
    seed: int = 0,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Reconstruct the emission in every voxel from one frame of a scan.

    Parameters
    ----------
    scan : Scan
    grid : VoxelGrid, optional
        The scan's own when None.
    method : str
        ``auto`` chooses between the classic methods, and how smooth and how long, by predicting
        views left out; or the name of one, see `tomo.methods.method_names`.
    frame : str, optional
        The first when None.
    hold_out : sequence of str
        Cameras that are only predicted and judged; nothing else sees their images.
    iterations : int, optional
        The method's own default when None; ``auto`` then chooses.
    compare : sequence of (method, iterations)
        Further methods to run on the same rays, for the report.
    tracer : {"march", "raycast", "reference"}
    skip : bool
        Whether to leave out what cannot matter: pixels whose rays miss the grid.
    supersample : int
        Rays along each side of a pixel.
    device : str
        For WERNet: cpu, cuda ...
    seed : int
        Of everything random.
    time_limit : float, optional
        Seconds after which the solver stops at its current iteration.
    progress : callable, optional
        ``progress(done, total, where)``.

    Raises
    ------
    ValueError
        One line that names what is wrong with the input.
    """
    started = time.perf_counter()
    main = method_named(method)
    others = [(method_named(name), count) for name, count in compare]
    _refuse_auto(others)
    grid = grid if grid is not None else scan.grid
    if grid is None:
        raise ValueError(f"{scan.source}: grid: found none, expected one here or in the scan")
    training = scan.without(*hold_out) if hold_out else scan
    training_images, training_masks = training.read(frame)
    judged = scan.only(*hold_out) if hold_out else None
    held_out_images, held_out_masks = judged.read(frame) if judged else ([], [])
    loaded = time.perf_counter()

    first_use = _warm_up(tracer)
    tracing = time.perf_counter()
    system = LinearSystem.from_rig(
        training.rig,
        grid,
        masks=training_masks,
        tracer=tracer,
        skip=skip,
        supersample=supersample,
        midpoints=main.needs_midpoints or any(m.needs_midpoints for m, _ in others),
        progress=progress,
    )
    traced = time.perf_counter()

    measured = system.flatten(training_images)
    truth, warnings = _read_truth(scan, grid)
    run = _Run(system.projector, measured, truth, device, seed, time_limit, progress)
    found = run.solve(main, iterations)
    solved = time.perf_counter()
    comparisons = tuple(run.solve(other, count) for other, count in others)
    compared = time.perf_counter()

    views = _views(system, found.volume, training_images, training_masks)
    views += _held_out_views(judged, found, held_out_images, held_out_masks, tracer, supersample)
    order = {name: place for place, name in enumerate(scan.rig.names)}
    segments, column_sums = system.projector.segments, system.projector.column_sums
    unseen = int(np.count_nonzero(column_sums == 0))
    if unseen:
        share = unseen / grid.size
        warnings.append(
            f"{share:.1%} of the voxels are seen by no camera: their zero says nothing"
        )
    settings = {
        "method": method,
        "frame": scan.frame(frame).name,
        "hold_out": list(hold_out),
        "iterations": iterations,
        "tracer": tracer,
        "skip": skip,
        "supersample": supersample,
        "scale": scan.shrink,
        "device": device,
        "seed": seed,
        "time_limit": time_limit,
        "grid": {"shape": grid.shape, "spacing": grid.spacing, "center": grid.center},
    }
    return Outcome(
        reconstruction=replace(found, peak_memory=peak_memory()),
        rig=scan.rig,
        views=tuple(sorted(views, key=lambda view: order[view.name])),
        data_range=_data_range(scan, frame, [*training_images, *held_out_images]),
        truth=truth,
        comparisons=comparisons,
        counts={
            "rays": system.projector.shape[0],
            "segments": len(segments),
            "voxels": grid.size,
            "active_voxels": grid.size - unseen,
        },
        seconds={
            "load": loaded - started,
            "trace": traced - tracing,
            "solve": solved - traced,
            "compare": compared - solved,
            "total": time.perf_counter() - started,
        },
        first_use_seconds=first_use,
        warnings=tuple(warnings),
        settings=settings,
        cosine_distances=run.cosine_distances,
    )


def _refuse_auto(others: Sequence[tuple[Method, int | None]]) -> None:
    if any(other.name == AUTO for other, _ in others):
        raise ValueError("compare: found auto, expected the name of one method")


def _warm_up(tracer: str) -> float:
    """Trace and project two rays through eight voxels; return how long first use took."""
    started = time.perf_counter()
    grid = VoxelGrid((2, 2, 2), 1.0)
    rays = Rays.from_lines([[-5, 0.5, 0.5], [-5, -0.5, 0.5]], [1.0, 0.0, 0.0])
    for midpoints in (False, True):
        projector = Projector(trace(rays, grid, tracer, midpoints=midpoints), grid)
    projector.T @ (projector @ np.ones(8, np.float32))
    return time.perf_counter() - started


class _Run:
    """Solves one system by one method after another, recording the distance from a truth."""

    def __init__(
        self,
        projector: Projector,
        measured: NDArray[np.float32],
        truth: NDArray[np.float32] | None,
        device: str,
        seed: int,
        time_limit: float | None,
        progress: Progress | None,
    ) -> None:
        self.projector = projector
        self.measured = measured
        self.truth = truth
        self.device = device
        self.seed = seed
        self.time_limit = math.inf if time_limit is None else time_limit
        self.progress = progress
        self.cosine_distances: dict[str, tuple[float, ...]] = {}

    def solve(self, method: Method, iterations: int | None) -> Reconstruction:
        """Run one method; its quality against the truth comes with it."""
        started = time.perf_counter()
        distances: list[float] = []

        def watch(index: int, volume: NDArray[np.float32], _residual: float) -> bool:
            if self.truth is not None:
                distances.append(metrics.cosine_distance(volume, self.truth.ravel()))
            if self.progress and total:
                self.progress(index, total, name)
            return time.perf_counter() - started > self.time_limit

        if method.name == AUTO:
            if self.device != "cpu":
                raise ValueError(f"device: found {self.device!r}, expected cpu for method auto")
            choice = choose_by_held_out_views(
                self.projector, self.measured, progress=self.progress
            )
            if iterations is not None:
                choice = replace(choice, iterations=iterations)
            name, total = choice.method, choice.iterations
            found = solve_as_chosen(self.projector, self.measured, choice, callback=watch)
            extra: dict[str, Any] = {"chosen_by": "auto", "tried": choice.tried}
        else:
            arguments = method.arguments(device=self.device, seed=self.seed, iterations=iterations)
            name, total = method.name, iterations
            found = method.solver(self.projector, self.measured, callback=watch, **arguments)
            extra = {}
        name = found.settings["method"]
        self.cosine_distances[name] = tuple(distances)
        return replace(
            found,
            settings={**found.settings, **extra},
            quality=quality(found.volume, self.truth),
            seconds={**found.seconds, "total": time.perf_counter() - started},
        )


def _read_truth(scan: Scan, grid: VoxelGrid) -> tuple[NDArray[np.float32] | None, list[str]]:
    """Return the scan's truth if it lives on the grid, and a warning if it does not."""
    if scan.truth is None:
        return None, []
    data, truth_grid, _ = read_volume(scan.truth)
    same = truth_grid.shape == grid.shape and np.allclose(
        [truth_grid.lower, truth_grid.upper], [grid.lower, grid.upper], atol=1e-6 * grid.spacing[0]
    )
    if same:
        return data, []
    return None, [f"{scan.truth.name}: the truth is on another grid: no quality figures"]


def _views(
    system: LinearSystem, volume: NDArray[np.float32], images: Images, masks: Masks
) -> list[View]:
    reprojected = system.images(system.projector @ volume.ravel())
    return [
        View(camera.name, image, seen, mask)
        for camera, image, seen, mask in zip(system.rig, images, reprojected, masks, strict=True)
    ]


def _held_out_views(
    judged: Scan | None,
    found: Reconstruction,
    images: Images,
    masks: Masks,
    tracer: str,
    supersample: int,
) -> list[View]:
    """Return the views of held-out cameras, of which every usable pixel is judged."""
    if judged is None:
        return []
    system = LinearSystem.from_rig(judged.rig, found.grid, tracer=tracer, supersample=supersample)
    views = _views(system, found.volume, images, masks)
    return [replace(view, held_out=True) for view in views]


def _data_range(scan: Scan, frame: str | None, images: Images) -> float:
    """Return 1 where integer images were scaled to 0..1, else the brightest pixel."""
    files = scan.frame(frame).images.values()
    if scan.corrections.gain is None and all(is_integer_image(path) for path in files):
        return 1.0
    return max(max(float(image.max()) for image in images), np.finfo(np.float32).tiny)
