"""Lenses out of focus: projected through the disc, and asked for a disc that is not there."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from studies.stress.row import Row, worst_of
from studies.stress.scene import jet_by, ring, solved
from tomo import LinearSystem, dot_test, solvers
from tomo.pipeline.methods import method_named

VIEWS = 9
NOISE = 0.1
ITERATIONS = 30
PIXELS_ACROSS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Diameters of the discs; the images are 24 x 40 pixels."""


def focus_rows(quick: bool) -> Iterator[Row]:
    """Yield the rows of discs from half a pixel to two thirds of an image."""
    widths = PIXELS_ACROSS[::3] if quick else PIXELS_ACROSS
    seen = jet_by(ring(VIEWS), noise=NOISE, seed=1)
    pixel = float(np.median(seen.rig.footprint(seen.grid.center)))
    images = list(seen.images.values())
    methods = [name for name in solvers.METHODS if method_named(name).through_lenses]
    adjoints: dict[type, list[tuple[str, float]]] = {np.float64: [], np.float32: []}
    brightest = []
    for form in ("stored", "on-the-fly"):
        sharp = LinearSystem.from_rig(seen.rig, seen.grid, form=form)
        measured = sharp.flatten(images)
        for width in widths:
            system = sharp.with_lens_blur(width * pixel)
            for dtype, figures in adjoints.items():
                error = dot_test(system.projector, dtype=dtype)
                figures.append((f"{width:g} pixels, {form}", error))
            for method in methods if form == "stored" else ():
                found = solved(method, system.projector, measured, ITERATIONS)
                figure = found.volume.max() / seen.truth.max()
                brightest.append((f"{method}, {width:g} pixels", figure))
    over = f"discs of {widths[0]:g} to {widths[-1]:g} pixels, stored and on the fly"
    for (dtype, figures), bound in zip(adjoints.items(), (1e-12, 1e-6), strict=True):
        worst, where = worst_of(figures)
        name = f"out of focus: back-projection against the transpose, {np.dtype(dtype).name}"
        yield Row(name, over, worst, bound, "relative", note=where)
    worst, where = worst_of(brightest)
    yield Row(
        "asked for discs, images in focus: brightest voxel, methods that take one",
        f"discs of {widths[0]:g} to {widths[-1]:g} pixels, {VIEWS} views, {NOISE:.0%} noise, "
        f"{ITERATIONS} iterations",
        worst,
        20.0,
        "times the truth's",
        note=where,
    )
