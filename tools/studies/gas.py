"""The figure of docs/theory/optics_gas.md: ``python tools/studies/gas.py FILE.png``.

Paths through Luneburg's lens, and how the errors of voxels fall as they are halved.
"""

from __future__ import annotations

import sys

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from rigs.scene.gas import Crossing, IndexField, IndexVolume

WIDTH, MIDDLE = 0.3, np.array([0.1, 0.0, -0.05])


class Luneburg(IndexField):
    """``n² = 2 - r²`` in a ball of radius 1."""

    lower, upper = np.full(3, -1.1), np.full(3, 1.1)

    def index(self, points: NDArray) -> NDArray:
        """Return the index at points."""
        return np.sqrt(np.maximum(2 - (points**2).sum(axis=1), 1))

    def gradient(self, points: NDArray) -> NDArray:
        """Return its gradient."""
        inside = (points**2).sum(axis=1, keepdims=True) < 1
        return np.where(inside, -points, 0) / self.index(points)[:, None]


class Warm(IndexField):
    """A core that is nothing, with three derivatives, at the faces of [-1, 1]³."""

    lower, upper = np.full(3, -1.0), np.full(3, 1.0)

    def __init__(self, strength: float) -> None:
        self.strength = strength

    def index(self, points: NDArray) -> NDArray:
        """Return the index at points ``(..., 3)``."""
        core = np.exp(-((points - MIDDLE) ** 2).sum(axis=-1) / (2 * WIDTH**2))
        return 1 + self.strength * core * np.prod(np.cos(np.pi * points / 2) ** 4, axis=-1)

    def gradient(self, points: NDArray) -> NDArray:
        """Return its gradient."""
        slope = -(points - MIDDLE) / WIDTH**2 - 2 * np.pi * np.tan(np.pi * points / 2)
        return (self.index(points) - 1)[:, None] * slope

    def volume(self, count: int) -> IndexVolume:
        """Return it in ``count`` voxels along each side."""
        at = (np.arange(count) + 0.5) * 2 / count - 1
        points = np.stack(np.meshgrid(at, at, at, indexing="ij"), axis=-1)
        return IndexVolume(self.index(points), self.lower, 2 / count)


def errors(strength: float, counts: list[int]) -> list[float]:
    """Return the RMS error of the exit's direction over the strength, for each voxel count."""
    rng = np.random.default_rng(0)
    origins = rng.normal(size=(20, 3))
    origins *= 3 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = rng.uniform(-0.3, 0.3, (20, 3)) - origins
    exact, found = Warm(strength).cross(origins, directions), []
    for count in counts:
        own = Warm(strength).volume(count).cross(origins, directions)
        missed = np.linalg.norm(own.exit_directions - exact.exit_directions, axis=1)
        found.append(float(np.sqrt((missed**2).mean())) / strength)
    return found


def draw_lens(axes: plt.Axes, crossing: Crossing, origins: NDArray) -> None:
    """Draw paths in the plane z = 0."""
    for ray, (start, stop) in enumerate(zip(crossing.ptr[:-1], crossing.ptr[1:], strict=True)):
        far = crossing.exit_origins[ray] + 0.5 * crossing.exit_directions[ray]
        path = np.stack([origins[ray], *crossing.origins[start:stop], far])
        axes.plot(path[:, 0], path[:, 1], "C0", linewidth=0.9)
    axes.add_patch(plt.Circle((0, 0), 1, fill=False, color="0.5"))
    axes.set(aspect="equal", xlabel="x / R", ylabel="y / R", title="Luneburg's lens")


def main(path: str) -> None:
    """Draw both panels into a file."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
    heights = np.linspace(-0.95, 0.95, 15)
    origins = np.column_stack([np.full(15, -1.5), heights, np.zeros(15)])
    draw_lens(left, Luneburg().cross(origins, np.tile([1.0, 0, 0], (15, 1))), origins)
    counts = [8, 16, 32, 64, 128]
    for strength in (3e-4, 0.2):
        right.loglog(counts, errors(strength, counts), "o-", label=f"n - 1 up to {strength:g}")
    right.loglog(counts, 0.3 * (8 / np.array(counts)) ** 4, "k:", label="order 4")
    right.set(xlabel="voxels along a side", ylabel="error of the direction / (n - 1)")
    right.legend(frameon=False)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(sys.argv[1])
