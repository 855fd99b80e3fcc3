"""The answer of a series: in how many frames the volume explains the images, in one sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.pipeline.answer import EXPLAINED, HARMFUL, NOT_EXPLAINED, PARTLY, percent
from tomo.pipeline.answer import UNKNOWN_VERDICT as UNKNOWN


@dataclass(frozen=True)
class SeriesAnswer:
    """Whether the volumes of a series explain their images.

    Attributes
    ----------
    verdict : str
        That of the middle frame, ordered by how well they are explained.
    sentence : str
    explained, partly, not_explained, unknown : int
        How many frames have each verdict.
    """

    verdict: str
    sentence: str
    explained: int = 0
    partly: int = 0
    not_explained: int = 0
    unknown: int = 0


def verdict_of_frame(worst: float) -> str:
    """Return whether a frame is explained, from its worst image's residual beyond noise."""
    return NOT_EXPLAINED if worst > HARMFUL else PARTLY if worst else EXPLAINED


def answer_of_series(
    table: Mapping[str, NDArray], frames: Sequence[int], cameras: Sequence[str]
) -> SeriesAnswer:
    """Return the answer from the figures of the frames.

    Parameters
    ----------
    table : mapping
        ``view_beyond_noise`` ``(frames, cameras)``: the residual that noise does not explain, as a
        fraction of the image; NaN of dark images and of excluded cameras. ``psnr``, optional:
        where it is known, a camera was held out and does not count. ``complete`` ``(frames,)``.
    frames : sequence of int
        Their numbers in the scan.
    cameras : sequence of str
    """
    beyond, complete = np.asarray(table["view_beyond_noise"]), np.asarray(table["complete"]) == 1
    if "psnr" in table:
        beyond = np.where(np.isfinite(table["psnr"]), np.nan, beyond)
    lit = complete & np.isfinite(beyond).any(axis=1)
    count, unknown = int(complete.sum()), int((complete & ~lit).sum())
    if not lit.any():
        sentence = "Not known: no frame has an image with light to compare its volume with."
        return SeriesAnswer(UNKNOWN, sentence, unknown=unknown)
    worst = np.nanmax(beyond[lit], axis=1)
    explained = int((worst == 0).sum())
    missed = int((worst > HARMFUL).sum())
    partly = len(worst) - explained - missed
    middle = float(np.median(worst))
    verdict = verdict_of_frame(middle)
    place = np.flatnonzero(lit)[int(np.argmax(worst))]
    camera = cameras[int(np.nanargmax(beyond[place]))]
    parts = [
        f"{f'all {count}' if number == count else f'{number} of {count}'} frames {words}"
        for number, words in (
            (explained, "are explained up to their noise"),
            (partly, f"but for up to {HARMFUL:.0%} of an image"),
            (missed, f"miss more than {HARMFUL:.0%} of an image"),
            (unknown, "are dark"),
        )
        if number
    ]
    sentence = (
        f"{verdict.capitalize()}: {', '.join(parts)}; least well frame {frames[place]}, where "
        f"camera {camera} is off by {percent(worst.max())} beyond the noise (middle frame "
        f"{percent(middle)})."
    )
    return SeriesAnswer(verdict, sentence, explained, partly, missed, unknown)
