"""Lenses stronger than any that was ever ground: there and back, or refused."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from _stress.row import Row, Size, worst_of
from rigs import Camera, Distortion
from rigs.camera import look_at
from tomo import Projector, dot_test
from tomo.grid import VoxelGrid
from tomo.operators.on_the_fly.projector import OnTheFlyProjector
from tomo.rays import Rays
from tomo.trace import trace

COUNTS = {"brown": 5, "rational": 8, "thin_prism": 12, "tilted": 14, "fisheye": 4}

POWERS = (0, 1, 3, 6)
"""Coefficients are up to ten to these."""

STRONG = {
    "none": Distortion(),
    "barrel": Distortion("brown", (-0.35, 0.15, 0.01, -0.02, 0)),
    "pincushion": Distortion("brown", (2.0, 1.0, 0, 0, 0)),
    "rational": Distortion("rational", (8, 5, 0.01, 0.01, 1, 9, 6, 1.5)),
    "prism": Distortion("thin_prism", (-0.3, 0.1, 0.01, 0.01, *[0] * 4, 0.05, -0.02, 0.03, 0.01)),
    "tilted by 80 degrees": Distortion("tilted", (0,) * 12 + (1.4, -0.2)),
    "fisheye": Distortion("fisheye", (0.1, 0.05, 0, 0)),
}


def lens_rows(size: Size) -> Iterator[Row]:
    """Yield how well lenses are inverted, and how rays through them are followed."""
    random = np.random.default_rng(size.seed)
    for model in COUNTS:
        there, lost, seen = [], 0, 0
        for power in POWERS:
            for _ in range(1 if size.quick else 12):
                lens = random_lens(model, power, random)
                error, missed, count = _there_and_back(lens, random)
                there.append((f"coefficients up to 1e{power}", error))
                lost, seen = lost + missed, seen + count
        figure, where = worst_of(there)
        over = "coefficients up to 1e6, 86 degrees off the axis"
        yield Row(
            f"{model} lens: directions to the image and back", over, figure, 1e-6,
            "rad", note=where,
        )  # fmt: skip
        yield Row(
            f"{model} lens: directions that have an image and are refused on the way back", over,
            lost / max(seen, 1), 1e-3, "of those seen", note=f"{lost} of {seen}",
        )  # fmt: skip
    yield _through_lenses()


def random_lens(model: str, power: float, random: np.random.Generator) -> Distortion:
    """Return a lens with coefficients from 1e-3 to ten to the ``power``, of either sign."""
    n = COUNTS[model]
    size = 10.0 ** random.uniform(-3, power, n) * (random.random(n) < 0.7)
    coefficients = random.choice([-1.0, 1.0], n) * size
    if model == "tilted":
        coefficients[12:] = random.uniform(-1.5, 1.5, 2)
    return Distortion(model, tuple(coefficients))


def _directions(n: int, random: np.random.Generator) -> NDArray[np.float64]:
    """Return directions in front of a camera, many near its axis."""
    angle = np.arccos(random.uniform(np.cos(1.5), 1, n))
    angle *= np.where(random.random(n) < 0.5, 1.0, 10.0 ** random.uniform(-5, 0, n))
    turn = random.uniform(0, 2 * np.pi, n)
    across = np.sin(angle)
    return np.stack([across * np.cos(turn), across * np.sin(turn), np.cos(angle)], axis=1)


def _there_and_back(
    lens: Distortion, random: np.random.Generator, n: int = 300
) -> tuple[float, int, int]:
    """Return the largest error of directions seen, how many have no way back, and of how many.

    Where the image hardly moves with the direction, its rounding is what can be found again.
    """
    points = _directions(n, random)
    plane, valid = lens.project(points)
    back = lens.unproject(plane[valid])
    lost = np.isnan(back[:, 0])
    if lost.all():
        return 0.0, int(lost.sum()), int(valid.sum())
    again, again_valid = lens.project(back[~lost])
    if not again_valid.all():
        return np.inf, int(lost.sum()), int(valid.sum())
    plane = plane[valid][~lost]
    image_error = np.linalg.norm(again - plane, axis=1) / (1 + np.linalg.norm(plane, axis=1))
    apart = np.linalg.norm(back - points[valid], axis=1)[~lost]
    # nearer than this a pixel of the image cannot tell directions apart, next to folds
    return (
        float(np.minimum(apart, 1).max() if image_error.max() < 1e-11 else np.inf),
        int(lost.sum()),
        int(valid.sum()),
    )


def _through_lenses() -> Row:
    """Project along the rays of strong lenses, from cameras that make them as they go."""
    grid = VoxelGrid((30, 25, 28), 1.0, (2, 3, 4))
    x = (1 + np.sin(np.linspace(0, 9, grid.size))) * np.linspace(1, 2, grid.size)
    figures = []
    for name, lens in STRONG.items():
        for distance, focal in ((0, 20.0), (3, 20.0), (60, 70.0), (1e4, 1.2e4), (1e8, 1.2e8)):
            camera = _camera(grid, lens, distance, focal)
            stored = Projector(trace(Rays.from_camera(camera), grid, dtype=np.float64), grid)
            flying = OnTheFlyProjector.from_cameras([camera], None, grid)
            images = stored @ x
            error = float(np.abs(flying @ x - images).max()) / float(images.max())
            figures.append((f"{name}, {distance:g} voxels away", error))
            figures.append((f"{name}, dot test", dot_test(flying) * 1e6))
    figure, where = worst_of(figures)
    return Row(
        "Rays through strong lenses, made at every product", "7 lenses, inside to 1e8 voxels away",
        figure, 1e-5, "of the brightest pixel", note=where,
    )  # fmt: skip


def _camera(grid: VoxelGrid, lens: Distortion, distance: float, focal: float) -> Camera:
    center = np.asarray(grid.center)
    position = center + np.array([0.6, 0.5, 0.62]) * distance
    target = center if distance else center + np.array([1, 0.3, 0.2])
    R, t = look_at(position, target)
    return Camera("camera", (64, 64), [[focal, 0, 31.5], [0, focal, 31.5], [0, 0, 1]], lens, R, t)
