"""What is done about a camera that stands out, and what its user can do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike
from tomo.grid import VoxelGrid
from tomo.screening.left_out_prediction import moved
from tomo.screening.left_out_view import Explained
from tomo.screening.single_camera import CameraFinding

LIKE_OTHERS = 2.0
"""Largest left-out error of a camera that takes part, in left-out errors of a right one: above, a
correction is not enough, and the image misleads by more than it tells."""

BELOW_CUT = 0.95
"""Fraction of a saturation level above which pixels are left out: noise takes some below it."""

FRAME_BLUR = 2
"""Pixels beside a hidden part that are left out too: lenses blur a frame's edge."""


@dataclass(frozen=True, eq=False)
class Remedy:
    """What is done about a camera.

    Attributes
    ----------
    words : str
        What was done, as a sentence; empty where nothing was.
    camera : CameraLike, optional
        The camera as the images see it.
    unusable : (height, width) bool, optional
        The pixels to leave out.
    gain, level : float
        The image is corrected to ``(image - level) / gain``.
    excluded : bool
        Whether the camera takes no part.
    """

    words: str = ""
    camera: CameraLike | None = None
    unusable: NDArray[np.bool_] | None = None
    gain: float = 1.0
    level: float = 0.0
    excluded: bool = False

    def corrected(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the image ``(height, width)`` without the camera's gain and background."""
        if self.gain == 1 and self.level == 0:
            return image
        return ((image - np.float32(self.level)) / np.float32(self.gain)).astype(np.float32)


def remedy(
    finding: CameraFinding,
    camera: CameraLike,
    image: NDArray[np.float32],
    grid: VoxelGrid,
    factor: int,
    *,
    move: bool,
    scale: bool,
) -> Remedy:
    """Return what is done about a camera.

    Parameters
    ----------
    finding : CameraFinding
    camera : CameraLike
    image : (height, width)
    grid : VoxelGrid
    factor : int
        Recorded pixels along the side of the finding's pixels.
    move, scale : bool
        Whether cameras may be moved, and images be scaled.

    Notes
    -----
    The likeliest cause is corrected where the camera is then explained like the others. Otherwise
    the camera is excluded where its left-out error is twice that of a right camera.
    """
    if finding.causes and not finding.unexplained:
        first = finding.causes[0]
        like = max(LIKE_OTHERS * finding.left_out, finding.worst)
        if finding.error_after(first) <= like:
            found = _corrected(first, camera, image, grid, factor, move=move, scale=scale)
            if found is not None:
                return found
    if finding.error > LIKE_OTHERS * finding.left_out:
        return Remedy("It is excluded", excluded=True)
    return Remedy()


def _corrected(
    cause: Explained,
    camera: CameraLike,
    image: NDArray[np.float32],
    grid: VoxelGrid,
    factor: int,
    *,
    move: bool,
    scale: bool,
) -> Remedy | None:
    """Return the correction of a cause, None where it has none."""
    found = cause.parameters
    if cause.cause == "pointing" and move and cause.pose is not None:
        pose = np.array(cause.pose) * (1, 1, 1, factor, factor)
        return Remedy("The camera was moved to agree", moved(camera, pose, grid))
    if cause.cause == "gain" and scale:
        return Remedy("Its image was divided by it", gain=found["gain"])
    if cause.cause == "background" and scale:
        return Remedy("It was subtracted", level=found["level"])
    if cause.cause == "saturation":
        return Remedy("Those pixels are left out", unusable=image >= BELOW_CUT * found["level"])
    if cause.cause == "hidden":
        return Remedy("That part is left out", unusable=_side(image.shape, found, factor))
    return None


def _side(shape: tuple[int, int], sides: Mapping[str, float], factor: int) -> NDArray[np.bool_]:
    """Return the pixels of the hidden side of an image."""
    hidden = np.zeros(shape, bool)
    for side, lines in sides.items():
        depth = int(lines) * factor + FRAME_BLUR
        along = hidden if side in ("top", "bottom") else hidden.T
        along[slice(depth) if side in ("top", "left") else slice(-depth, None)] = True
    return hidden


ADVICE: Mapping[str, Callable[[str, Explained], str]] = {
    "gain": lambda name, found: (
        f"Set in scan.yaml: corrections: {{gain: {{{name}: {1 / found.parameters['gain']:.4g}}}}}"
    ),
    "background": lambda name, found: "Correct its dark level in scan.yaml (corrections: dark)",
    "pointing": lambda name, found: f"Calibrate it again, or run with --refine-cameras {name}",
    "swapped": lambda name, found: "Check which camera's images its folder holds",
    "turned": lambda name, found: (
        "Let the rig say so: flametomo convert-rig rig.yaml turned.yaml --rotate "
        f"{name}={found.parameters['degrees']:.0f}, and reconstruct with turned.yaml in its place"
    ),
    "mirrored": lambda name, found: (
        "Mirror its images back, in Python image"
        f"{'[:, ::-1]' if found.parameters['mirrored across'] else '[::-1]'}: a rig cannot say it"
    ),
    "hidden": lambda name, found: "Give a mask of what it sees in scan.yaml: corrections: mask",
    "saturation": lambda name, found: (
        "Expose it shorter, or set in scan.yaml: corrections: "
        f"{{saturation: {{{name}: {BELOW_CUT * found.parameters['level']:.4g}}}}}"
    ),
    "blur": lambda name, found: "Focus it, or leave it out",
    "out of step": lambda name, found: "Check its trigger and the numbers of its frames",
}
"""What a user can do about each cause."""
