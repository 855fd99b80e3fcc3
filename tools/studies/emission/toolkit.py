"""RTK's SART, conjugate gradients and TV (itk-rtk) on the same rays, those of pixels' centres.

RTK takes any pose of source and flat detector; its projector is Joseph's, forward and back. TV is
its regularised conjugate gradients: in turn some steps, no negative value, and TV denoising.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Camera
from studies.emission.course import Course, Volume
from studies.emission.scenes import Seen

BEHIND = 4.0
"""Distance of RTK's detectors over the focal length in pixels: rays end there, so the grid has to
be in front of them."""

ONE_THREAD = 1
FILTER = "ConeBeamReconstructionFilter"
SWEEPS = {
    "NumberOfIterations": (1, 1, 2, 4, 7, 10, 15, 25, 35),
    "MainLoop_iterations": (1, 1, 2, 4, 6, 6),
}
"""By what counts them, iterations between judgements; RTK goes on from the volume before."""


class Toolkit:
    """The images and cameras of a scene as RTK takes them; square pixels, no distortion."""

    def __init__(self, seen: Seen) -> None:
        import itk
        from itk import RTK as rtk  # noqa: N811

        itk.MultiThreaderBase.SetGlobalMaximumNumberOfThreads(ONE_THREAD)
        self._itk, self._rtk, self._grid = itk, rtk, seen.grid
        self._geometry = rtk.ThreeDCircularProjectionGeometry.New()
        for camera in seen.rig:
            self._geometry.AddProjection(*_pose(camera))
        height, width = seen.images.shape[1:]
        corner = BEHIND * (1 - width) / 2, BEHIND * (1 - height) / 2, 0
        self._measured = self._image(seen.images, (BEHIND, BEHIND, 1), corner)

    def solved(self, filter_name: str, start: Volume, **settings: Any) -> Volume:
        """Return the volume ``(nx, ny, nz)`` that a filter makes of ``start``."""
        kind = self._itk.Image[self._itk.F, 3]
        sart = filter_name == "SART"
        made = getattr(self._rtk, filter_name + FILTER)[(kind, kind) if sart else kind].New()
        volume = self._image(start.T, self._grid.spacing, self._grid.origin)
        if sart:
            made.SetInput(0, volume)
            made.SetInput(1, self._measured)
        else:
            made.SetInputVolume(volume)
            made.SetInputProjectionStack(self._measured)
        made.SetGeometry(self._geometry)
        made.SetForwardProjectionFilter(type(made).ForwardProjectionType_FP_JOSEPH)
        made.SetBackProjectionFilter(type(made).BackProjectionType_BP_JOSEPH)
        made.SetDisableDisplacedDetectorFilter(True)
        for name, value in settings.items():
            getattr(made, f"Set{name}")(value)
        made.Update()
        return np.array(self._itk.array_from_image(made.GetOutput()).T, np.float32)

    def _image(self, values: NDArray, spacing: Sequence[float], origin: Sequence[float]) -> Any:
        made = self._itk.image_from_array(np.ascontiguousarray(values, np.float32))
        made.SetSpacing([float(one) for one in spacing])
        made.SetOrigin([float(one) for one in origin])
        return made


def run_in_sweeps(course: Course, seen: Seen, *, filter_name: str, count: str, **how: Any) -> None:
    """Run a filter that can go on from a volume; ``count`` is its number of iterations."""
    toolkit, volume = Toolkit(seen), np.zeros(seen.grid.shape, np.float32)
    for sweeps in SWEEPS[count]:
        volume = toolkit.solved(filter_name, volume, **{count: sweeps}, **how)
        if course.judge(volume):
            break


def run_once(course: Course, seen: Seen, *, filter_name: str, **how: Any) -> None:
    """Run a filter from zeros: conjugate gradients cannot go on from a volume."""
    start = np.zeros(seen.grid.shape, np.float32)
    course.judge(Toolkit(seen).solved(filter_name, start, **how))


def _pose(camera: Camera) -> Iterable[list[float]]:
    """Return source, detector's middle, and the directions of its rows and columns."""
    K, (width, height) = camera.camera_matrix, camera.image_size
    middle = np.array([(width - 1) / 2 - K[0, 2], (height - 1) / 2 - K[1, 2], K[0, 0]])
    detector = camera.position + BEHIND * camera.R.T @ middle
    return (one.tolist() for one in (camera.position, detector, camera.R[0], camera.R[1]))
