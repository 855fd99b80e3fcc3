"""Interleaved subsets of the pixels, each of which sees all views."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo._compute.grouping import golden_ratio_sequence


def interleaved(count: int, parts: int) -> list[NDArray[np.int64]]:
    """Return ``parts`` ascending lists of the numbers below ``count``, each spread over all.

    Dealt out by the golden-ratio sequence, so that no part falls into step with the images' rows.
    """
    if not (1 <= parts <= max(count, 1) and parts % 1 == 0):
        raise ValueError(
            f"subsets: found {parts}, expected a whole number from 1 to that of pixels, {count}"
        )
    parts = int(parts)
    part = np.floor(golden_ratio_sequence(count) * parts).astype(np.int64)
    return [np.flatnonzero(part == number) for number in range(parts)]
