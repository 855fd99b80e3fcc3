"""RTK's SART, conjugate gradients and TV (itk-rtk) on the same rays, those of pixels' centres.

RTK takes any pose of source and flat detector; its projector is Joseph's, forward and back. TV is
its regularised conjugate gradients: in turn some steps, no negative value, and TV denoising.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.emission.course import Course, Volume
from studies.emission.scenes import Seen

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


def run(course: Course, seen: Seen, *, name: str, sweeps: Sequence[int], **how: Any) -> None:
    """Run a filter by so many iterations at a time, each on from the volume before.

    Conjugate gradients begin anew each time: theirs are one number a run.
    """
    toolkit, volume = Toolkit(seen), np.zeros(seen.grid.shape, np.float32)
    count = "MainLoop_iterations" if name == TV else "NumberOfIterations"
    for number in sweeps:
        volume = toolkit.solved(name, volume, **{count: number}, **how)
        if course.judge(volume):
            break
