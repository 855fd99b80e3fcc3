"""The methods of the table: ours as they are, and peers tuned and stopped by the truth.

RTK (itk-rtk) solves for the same rays, those of pixels' centres, with any pose of source and flat
detector; its projector is Joseph's, forward and back. Its TV is its regularised conjugate
gradients: in turn some steps, no negative value, and TV denoising.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from studies.common.scans import problem
from studies.emission import learned
from studies.emission.course import Course, Found, Volume, best_of
from studies.emission.scenes import Emission, Seen
from tomo import Options, reconstruct, solvers

BEHIND = 4.0
"""Distance of RTK's detectors over the focal length in pixels: rays end there, so the grid has to
be in front of them."""

SART, CG, TV = "SART", "ConjugateGradient", "RegularizedConjugateGradient"
THREADS = 1


class Toolkit:
    """The images and cameras of a scene as RTK takes them; square pixels, no distortion."""

    def __init__(self, seen: Seen) -> None:
        import itk
        from itk import RTK as rtk  # noqa: N811

        itk.MultiThreaderBase.SetGlobalMaximumNumberOfThreads(THREADS)
        self._itk, self._rtk, self._grid = itk, rtk, seen.grid
        self._geometry = rtk.ThreeDCircularProjectionGeometry.New()
        height, width = seen.images.shape[1:]
        for camera in seen.rig:
            K, R, source = camera.camera_matrix, camera.R, camera.position
            middle = (width - 1) / 2 - K[0, 2], (height - 1) / 2 - K[1, 2], K[0, 0]
            pose = source, source + BEHIND * R.T @ middle, R[0], R[1]
            self._geometry.AddProjection(*(one.tolist() for one in pose))
        corner = BEHIND * (1 - width) / 2, BEHIND * (1 - height) / 2, 0
        self._measured = self._image(seen.images, (BEHIND, BEHIND, 1), corner)

    def solved(self, name: str, start: Volume, **settings: Any) -> Volume:
        """Return the volume ``(nx, ny, nz)`` that a filter makes of ``start``."""
        kind = self._itk.Image[self._itk.F, 3]
        filters = getattr(self._rtk, f"{name}ConeBeamReconstructionFilter")
        made = filters[(kind, kind) if name == SART else kind].New()
        inputs = self._image(start.T, self._grid.spacing, self._grid.origin), self._measured
        if name == SART:
            made.SetInput(0, inputs[0])
            made.SetInput(1, inputs[1])
        else:
            made.SetInputVolume(inputs[0])
            made.SetInputProjectionStack(inputs[1])
        made.SetGeometry(self._geometry)
        made.SetForwardProjectionFilter(type(made).ForwardProjectionType_FP_JOSEPH)
        made.SetBackProjectionFilter(type(made).BackProjectionType_BP_JOSEPH)
        made.SetDisableDisplacedDetectorFilter(True)
        for key, value in settings.items():
            getattr(made, f"Set{key}")(value)
        made.Update()
        return np.array(self._itk.array_from_image(made.GetOutput()).T, np.float32)

    def _image(self, values: NDArray, spacing: Sequence[float], origin: Sequence[float]) -> Any:
        made = self._itk.image_from_array(np.ascontiguousarray(values, np.float32))
        made.SetSpacing([float(one) for one in spacing])
        made.SetOrigin([float(one) for one in origin])
        return made


def by_rtk(course: Course, seen: Seen, *, name: str, sweeps: Sequence[int], **how: Any) -> None:
    """Run a filter by so many iterations at a time, each on from the volume before.

    Conjugate gradients begin anew each time: theirs are one number a run.
    """
    toolkit, volume = Toolkit(seen), np.zeros(seen.grid.shape, np.float32)
    count = "MainLoop_iterations" if name == TV else "NumberOfIterations"
    for number in sweeps:
        volume = toolkit.solved(name, volume, **{count: number}, **how)
        if course.judge(volume):
            break


SWEEPS = 100  # the most passes of ART and SART, as papers have them
PAPER_RAYS = 1_500_000
"""Rays that wernet-paper learns from, over all epochs: its 80 would take an hour a scene."""

FEWEST_EPOCHS = 4


@dataclass(frozen=True)
class Method:
    """What makes a `Found` of a `Seen`; ours are neither tuned nor stopped by the truth."""

    run: Callable[[Seen], Found]
    is_ours: bool = False
    applies: Callable[[Emission], bool] = lambda _emission: True


def ours(method: str, seen: Seen, iterations: int | None = None) -> Found:
    """Run a method of the project as a user has it, without intervals."""
    how: dict[str, Any] = {"method": method, "uncertainty": 0, "iterations": iterations}
    if method == "wernet-paper" and iterations is None:
        how["iterations"] = max(FEWEST_EPOCHS, round(PAPER_RAYS / seen.images.size))
    cpu, wall = time.process_time(), time.perf_counter()
    outcome = reconstruct(seen.scan, None, Options(**how))
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    solution = outcome.solution
    keys = ("method", "strength", "iterations")
    settings = {key: solution.settings[key] for key in keys if key in solution.settings}
    return Found(np.asarray(solution.volume), settings, cpu, wall)


def classic(course: Course, seen: Seen, *, method: str, **how: Any) -> None:
    """Run a solver on all pixels and voxels, judged after each sweep."""
    ready = problem(seen.rig, seen.grid, list(seen.images), skip=False)
    projector = ready.system.projector

    def judge(index: int, volume: np.ndarray, _residual: float) -> bool:
        return index > 0 and course.judge(projector.active.expand(volume))

    solver = getattr(solvers, method)
    solver(projector, ready.measured, iterations=SWEEPS, callback=judge, **how)


def abel(course: Course, seen: Seen, *, reg: Any) -> None:
    """Invert the mean of all views and both sides by Daun's method (PyAbel), row by row.

    Views are sampled in the plane through the axis that faces them: exact for level cameras far
    away. Daun et al., Appl. Opt. 45 (2006).
    """
    from abel.daun import daun_transform

    grid, step = seen.grid, seen.grid.spacing[0]
    radii = step * np.arange(int(np.hypot(grid.shape[0], grid.shape[2]) / 2) + 1)
    heights = grid.axes()[1] - grid.center[1]
    halves = []
    for camera, image in zip(seen.rig, seen.images, strict=True):
        for side in (-1, 1):
            across = side * radii[None, :, None] * camera.R[0]
            points = np.asarray(grid.center) + across + heights[:, None, None] * [0, 1, 0]
            uv = camera.project(points.reshape(-1, 3))[0]
            halves.append(map_coordinates(image, uv.T[::-1], order=1, mode="nearest"))
    mean = np.mean(halves, axis=0).reshape(len(heights), len(radii))  # (heights, radii)
    found = daun_transform(mean, reg=reg, degree=1, dr=step, basis_dir=None, verbose=False)
    x, _, z = grid.axes()
    radius = np.hypot(x[:, None] - grid.center[0], z - grid.center[2]) / step  # (nx, nz)
    rows = [np.interp(radius, np.arange(len(radii)), row, right=0) for row in found]
    course.judge(np.maximum(np.stack(rows, axis=1), 0))


def _tuned(run: Callable[..., None], **values: Sequence) -> Method:
    """Return a peer that tries all combinations of settings."""
    tried = [dict(zip(values, one, strict=True)) for one in itertools.product(*values.values())]
    return Method(partial(best_of, run=run, tried=tried))


METHODS: Mapping[str, Method] = {
    **{name: Method(partial(ours, name), is_ours=True) for name in ("auto", "mlem", "tv")},
    "art": _tuned(classic, method=("art",), relaxation=(0.01, 0.03, 0.1, 0.3, 1.0)),
    "sart": _tuned(classic, method=("sart",), relaxation=(0.03, 0.1, 0.3, 1.0, 1.5)),
    "abel": replace(
        _tuned(abel, reg=(0.0, "nonneg", *(("diff", one) for one in (1.0, 10.0, 100.0, 1000.0)))),
        applies=lambda emission: emission.is_round,
    ),
    "rtk-sart": _tuned(
        by_rtk, name=(SART,), sweeps=((1, 1, 2, 4, 7, 10, 15, 25, 35),),
        EnforcePositivity=(True,), DivisionThreshold=(0.0, 20.0), Lambda=(0.1, 0.3, 1.0),
    ),
    "rtk-cg": _tuned(
        by_rtk, name=(CG,), sweeps=((5,), (10,), (20,), (40,), (80,)),
        Gamma=(0.0, 1.0, 10.0),
    ),
    "rtk-tv": _tuned(
        by_rtk, name=(TV,), sweeps=((1, 1, 2, 4, 6, 6),), CG_iterations=(4,),
        PerformPositivity=(True,), PerformTVSpatialDenoising=(True,), TV_iterations=(10,),
        GammaTV=(1e-4, 1e-3, 1e-2, 1e-1),
    ),
    "tensor-planes": _tuned(learned.fit, rate=(0.03,), roughness=(1e-3, 1e-2)),
    "neural-field": _tuned(learned.fit, rate=(0.01,), frequency=(2.0, 4.0)),
    **{n: Method(partial(ours, n), is_ours=True) for n in ("wernet", "wernet-paper")},
}  # fmt: skip
"""The quick ones first: an interrupted run has them for all scenes."""
