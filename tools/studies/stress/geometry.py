"""Cameras near and far, voxels of any width, bent lenses, and lenses out of focus.

Products are held against their transposes: ``|<A x, y> - <x, A^T y>|`` over the norms.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import rigs
from rigs import Camera, Distortion
from studies.common.study import Request
from studies.stress.row import Row
from studies.stress.scene import jet_by, ring, solved
from tomo import LinearSystem, VoxelGrid, dot_test, solvers
from tomo.operators.operator import ProjectionOperator
from tomo.pipeline.methods import method_named

DISTANCES = (4.0, 1e2, 1e4, 1e6, 1e8)
"""Voxels from the middle of a grid of 12 x 28 x 12; the first is inside."""

WIDTHS = (1e-9, 1e-3, 1e3, 1e9)  # widths of a voxel, in units of length
EXACT = {np.float64: 1e-12, np.float32: 1e-6}  # bounds of the error of an adjoint

LENSES = {
    "brown": ((-0.3, 0.1, 1e-3, -1e-3), (1e6, 0, 0, 0), (-1e3, 1e6, 0, 0)),
    "fisheye": ((0.1, -0.02, 0, 0), (-0.2, 0.1, 0.05, 0)),
}
ANGLE = 1e-6  # radians
FORMS = ("stored", "on-the-fly")
VIEWS = 9
NOISE = 0.1
ITERATIONS = 30
PIXELS_ACROSS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Diameters of the discs; the images are 24 x 40 pixels."""


def run(request: Request) -> Iterator[Row]:
    """Yield the rows of this part."""
    yield from product_rows()
    yield lens_row()
    yield from focus_rows(request.size != "full")


def product_rows() -> Iterator[Row]:
    """Yield the rows of adjoints, by distance of the cameras and by width of the voxels."""
    cases = {
        "cameras inside the grid to 1e8 voxels away": [(width, 1.0) for width in DISTANCES],
        "voxels of 1e-9 to 1e9 units": [(300.0, width) for width in WIDTHS],
    }
    for what, pairs in cases.items():
        figures: dict[type, list[tuple[str, float]]] = {kind: [] for kind in EXACT}
        for distance, width in pairs:
            for form in FORMS:
                product = _product(distance, width, form)
                for kind, found in figures.items():
                    found.append((f"{distance:g} voxels of {width:g}, {form}",
                                  dot_test(product, dtype=kind)))  # fmt: skip
        yield from _adjoint_rows(what, f"{len(pairs)} rigs, stored and on the fly", figures)


def _product(distance: float, width: float, form: str) -> ProjectionOperator:
    rig = ring(4, distance=distance * width, footprint=0.8 * width)
    return LinearSystem.from_rig(rig, VoxelGrid((12, 28, 12), width), form=form).projector


def _adjoint_rows(
    what: str, over: str, figures: dict[type, list[tuple[str, float]]]
) -> Iterator[Row]:
    for kind, found in figures.items():
        name = f"{what}: back-projection against the transpose, {np.dtype(kind).name}"
        yield Row.of_worst(name, over, found, EXACT[kind], "relative")


def lens_row() -> Row:
    """Send rays out of bent lenses and their points back to the image."""
    errors = []
    plain = rigs.ring(1, distance=100.0, image_size=(64, 48), footprint=1.0)[0]
    for model, many in LENSES.items():
        for coefficients in many:
            camera = replace(plain, distortion=Distortion(model, coefficients))
            errors.append((f"{model} {coefficients}", _there_and_back(camera)))
    stress = "lenses with coefficients up to 1e6: directions to the image and back"
    return Row.of_worst(stress, f"{len(errors)} lenses", errors, ANGLE, "rad")


def _there_and_back(camera: Camera) -> float:
    """Return the largest angle between a pixel's ray and that of its point's image."""
    places, directions = camera.rays()
    points = np.broadcast_to(places, directions.shape) + 50.0 * directions
    images, _, seen = camera.project(points)
    _, again = camera.rays(images[seen])
    apart = np.linalg.norm(np.cross(directions[seen], again), axis=-1)
    return float(np.max(np.arcsin(np.minimum(apart, 1)), initial=0.0))


def focus_rows(quick: bool) -> Iterator[Row]:
    """Yield the rows of discs from half a pixel to two thirds of an image."""
    widths = PIXELS_ACROSS[::3] if quick else PIXELS_ACROSS
    seen = jet_by(ring(VIEWS), noise=NOISE, seed=1)
    pixel = float(np.median(seen.rig.footprint(seen.grid.center)))
    images = list(seen.images.values())
    methods = [name for name in solvers.METHODS if method_named(name).through_lenses]
    adjoints: dict[type, list[tuple[str, float]]] = {kind: [] for kind in EXACT}
    brightest = []
    for form in FORMS:
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
    yield from _adjoint_rows("out of focus", over, adjoints)
    stress = "asked for discs, images in focus: brightest voxel, methods that take one"
    over = f"discs of {widths[0]:g} to {widths[-1]:g} pixels, {VIEWS} views, {NOISE:.0%} noise, "
    over += f"{ITERATIONS} iterations"
    yield Row.of_worst(stress, over, brightest, 20.0, "times the truth's")
