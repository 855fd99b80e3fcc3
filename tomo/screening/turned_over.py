"""One camera whose image is mirrored or turned by half, found by what all images then agree on.

Where a volume does not explain its images, the camera that is wrong need not stand out: with few
views the others are bent to it. Each image is therefore turned over in turn, and a volume is made
from all: the right one makes all of them agree.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel
from tomo.screening.exchanged import SUSPECTS, explained_anew
from tomo.screening.left_out_prediction import PredictedViews
from tomo.screening.single_camera import EXPLAINS, errors_of

WAYS = {"mirrored left to right": (1, -1), "mirrored upside down": (-1, 1)} | {
    "turned by 180 degrees": (-1, -1)
}
"""In words, the steps along the rows and columns that turn an image back."""


@dataclass(frozen=True)
class TurnedOver:
    """A camera whose image is turned over.

    Attributes
    ----------
    camera : str
    words : str
        One of `WAYS`.
    left : float
        Squared error beyond noise that is left with the image turned back: of all images, or of
        the camera's own where it is held out.
    """

    camera: str
    words: str
    left: float

    @property
    def needs(self) -> str:
        """The way to mend it, in words that follow a colon."""
        if self.words.startswith("turned"):
            return (
                "let the rig say so: flametomo convert-rig rig.yaml turned.yaml --rotate "
                f"{self.camera}=180, and reconstruct with turned.yaml in its place"
            )
        across = "[:, ::-1]" if "left" in self.words else "[::-1]"
        return (
            f"mirror its images and its dark frame back, in Python image{across}: a rig cannot "
            "say it"
        )


def find_turned_over(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    noise: Sequence[NoiseModel],
    trusted: int | None = None,
) -> TurnedOver | None:
    """Return the camera whose image, turned over, agrees best with the rest; None for none.

    Parameters
    ----------
    rig : Rig
    images : sequence of (height, width) float32
        One a camera.
    masks : sequence of (height, width) bool
    grid : VoxelGrid
    noise : sequence of NoiseModel
    trusted : int, optional
        Only the first so many cameras make volumes; the others are held out, and an error of
        theirs comes before one of the cameras that were used. All when None.

    Notes
    -----
    A camera is named where the squared error falls to half, the limit for the causes of one
    camera.
    """
    shown = explained_anew(rig, images, masks, grid, noise, trusted)
    if shown is None:
        return None
    views, used, errors = shown
    others = [view for view in range(len(rig)) if views.sees(view) and view not in used]
    for suspects in (others, sorted(used, key=lambda view: -errors[view])[:SUSPECTS]):
        best = min(_tried(views, used, suspects, errors), key=lambda one: one.left, default=None)
        if best is not None and best.left < EXPLAINS:
            return best
    return None


def _tried(
    views: PredictedViews,
    used: Sequence[int],
    suspects: Sequence[int],
    errors: NDArray[np.float64],
) -> Iterator[TurnedOver]:
    """Yield what turning each suspect over leaves."""
    names = views.coarse.rig.names
    for view in suspects:
        judged = used if view in used else [view]
        for words, (down, across) in WAYS.items():
            shown = list(views.coarse.images)
            shown[view] = np.ascontiguousarray(shown[view][::down, ::across])
            other = views.with_images(shown)
            left = errors_of(other, other.volume(used))[judged].sum() / errors[judged].sum()
            yield TurnedOver(names[view], words, float(left))
