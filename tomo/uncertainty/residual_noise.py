"""The noise of the images, estimated from the residual."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import norm
from tomo.measurement import estimate_noise
from tomo.operators import LinearSystem

Solve = Callable[[NDArray[np.float32]], NDArray[np.float32]]
"""The chosen method, with its smoothness and iterations, as a function from the pixels
``(pixels,)`` to the unknowns ``(unknowns,)``."""

MOST_FITTED = 0.5
"""Largest fraction of the noise's standard deviation that a solve may fit. Beyond it the residual
is too small, and the images alone give the noise."""

CLEARLY = 0.8
"""Factor below the residual's noise from which on the images' own estimate is taken."""


def noise_of_images(
    system: LinearSystem,
    measured: NDArray[np.float32],
    seen: NDArray[np.float32],
    remains: float = 1.0,
) -> NDArray[np.float64]:
    """Return the standard deviation of the noise in every pixel that takes part, ``(pixels,)``.

    Each view's noise model, ``variance = read² + gain x signal``, is that of the residual's finest
    structure over the re-projected signal ``seen``, see `tomo.measurement.estimate_noise`: with
    the volume taken away, edges and fine structure of the flame are not taken for noise. The solve
    has fitted some of the noise: ``remains`` is the fraction of known noise that the same estimate
    finds in what it leaves. Where voxels are so much coarser than pixels that the re-projection's
    steps are finer structure than the images have, the images alone say less, and are believed.

    The noise of one pixel is taken to be independent of its neighbours'. Where images were
    resampled or smoothed it is not, and too little is found: two thirds of it after a blur of half
    a pixel, a quarter after one of 0.7, a tenth after one of a pixel.
    """
    noise = fine_structure(system, measured, seen, seen)
    found = noise / min(remains, 1.0) if remains > 1 - MOST_FITTED else None
    alone = fine_structure(system, measured, None, seen)
    return alone if found is None or norm(alone) < CLEARLY * norm(found) else found


def generator(seed: int, number: int) -> np.random.Generator:
    """Return one of many generators; none repeats ``default_rng(seed)``, which simulations use."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))


def fine_structure(
    system: LinearSystem,
    measured: NDArray[np.float32],
    expected: NDArray[np.float32] | None,
    signal: NDArray[np.float32],
) -> NDArray[np.float64]:
    """Return the noise of every pixel by each view's own model, at ``signal``, ``(pixels,)``."""
    sigma = np.zeros(len(measured))
    images, masks = system.images(measured), traced(system)
    known = [None] * len(images) if expected is None else system.images(expected)
    spans = pairwise(system.projector.view_ptr)
    for image, own, mask, (start, stop) in zip(images, known, masks, spans, strict=True):
        model = estimate_noise(image, mask, expected=own)
        sigma[start:stop] = np.sqrt(model.variance(signal[start:stop]))
    return sigma


def traced(system: LinearSystem) -> list[NDArray[np.bool_]]:
    """Return the pixels of each view that take part, ``(height, width)`` bool each."""
    masks = []
    for camera, kept in zip(system.rig, system.pixels, strict=True):
        width, height = camera.image_size
        mask = np.zeros(width * height, bool)
        mask[kept] = True
        masks.append(mask.reshape(height, width))
    return masks


def smoothed(
    system: LinearSystem, pixels: NDArray[np.float32], width: float
) -> NDArray[np.float32]:
    """Return pixels blurred within their images, ``(pixels,)``; untraced pixels are ignored.

    ``width`` is the Gaussian's standard deviation in pixels.
    """
    from scipy.ndimage import gaussian_filter

    blurred = []
    for image, mask in zip(system.images(pixels), traced(system), strict=True):
        weight = gaussian_filter(mask.astype(np.float32), width, mode="constant")
        total = gaussian_filter(image, width, mode="constant")
        blurred.append(np.divide(total, weight, out=np.zeros_like(total), where=weight > 1e-6))
    return system.flatten(blurred)
