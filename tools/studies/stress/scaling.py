"""Scaling: other units of length or intensity change the volume by their factor, nothing else.

Emission is per unit of length: with all lengths times k and the images as they are, it is 1/k of
what it was.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from studies.common.scans import reconstructed
from studies.common.study import Request
from studies.stress.row import Row, relative_error
from studies.stress.scene import BY_PIXEL, Scene, equations, scene, solved
from tomo import VoxelGrid, solvers
from tomo.operators.operator import ProjectionOperator
from tomo.pipeline import Reconstruction
from tomo.selection import choose_by_left_out_pixels
from tomo.simulation.simulate import SimulatedImages

FACTORS = (1e-6, 3.7e-6, 2.9e5, 1e6)
RANGE = f"x {min(FACTORS):g} to {max(FACTORS):g}"
EXACT = 1e-5


@dataclass(frozen=True, eq=False)
class Scaled:
    """A scene in other units: lengths and intensities times a factor each."""

    original: SimulatedImages
    lengths: float = 1.0
    intensities: float = 1.0

    @property
    def name(self) -> str:
        """Both factors."""
        return f"lengths x {self.lengths:g}, intensities x {self.intensities:g}"

    @property
    def emission(self) -> float:
        """What a voxel's emission has to be multiplied by."""
        return self.intensities / self.lengths

    @cached_property
    def simulated(self) -> SimulatedImages:
        """The scan in these units."""
        grid = self.original.grid
        return replace(
            self.original,
            rig=scaled_rig(self.original.rig, self.lengths),
            grid=VoxelGrid(grid.shape, np.multiply(grid.spacing, self.lengths)),
            images=MappingProxyType(
                {n: _times(image, self.intensities) for n, image in self.original.images.items()}
            ),
            truth=_times(self.original.truth, self.emission),
        )

    @cached_property
    def seen(self) -> Scene:
        """The scan and its equations."""
        return equations(self.simulated)

    def unscaled(self, volume: NDArray) -> NDArray[np.float64]:
        """Return a volume in the original's unit."""
        return volume.astype(np.float64) / self.emission


def scaled_rig(rig: Rig, factor: float) -> Rig:
    """Return a rig with all its lengths times a factor: nothing but where cameras stand."""
    return replace(rig, cameras=tuple(replace(camera, t=camera.t * factor) for camera in rig))


def _times(array: NDArray, factor: float) -> NDArray[np.float32]:
    return (factor * array.astype(np.float64)).astype(np.float32)


def run(request: Request) -> Iterator[Row]:
    """Yield the rows of this part."""
    quick = request.size != "full"
    factors = FACTORS[::3] if quick else FACTORS
    plain = Scaled(scene(noise=0.02).simulated)
    others = [replace(plain, lengths=factor) for factor in factors]
    others += [replace(plain, intensities=factor) for factor in factors]
    others += [replace(plain, lengths=factors[0], intensities=factors[-1])]
    yield from _solvers(plain, others, quick)
    yield from _default(plain, others)


def _solvers(plain: Scaled, others: Sequence[Scaled], quick: bool) -> Iterator[Row]:
    for what in ("lengths", "intensities"):
        figures = []
        for method in solvers.METHODS:
            forms = ["system"] if quick or method in BY_PIXEL else ["system", "on_the_fly"]
            for form in forms:
                expected = solved(method, _form(plain, form), plain.seen.measured).volume
                for other in others:
                    if getattr(other, what) == 1:
                        continue
                    found = solved(method, _form(other, form), other.seen.measured).volume
                    error = relative_error(other.unscaled(found), expected)
                    figures.append((f"{method}, {form}, {other.name}", error))
        stress = f"{what}, every classic method"
        yield Row.of_worst(stress, RANGE, figures, EXACT, "relative to scale 1")


def _default(plain: Scaled, others: Sequence[Scaled]) -> Iterator[Row]:
    expected = reconstructed(plain.simulated)
    chosen = _choice(expected)
    figures, changed = [], []
    for other in others:
        outcome = reconstructed(other.simulated)
        found = other.unscaled(outcome.solution.volume)
        error = relative_error(found, expected.solution.volume)
        figures.append((other.name, error))
        changed += [
            f"{name} {value} instead of {chosen[name]}, {other.name}"
            for name, value in _choice(outcome).items()
            if value != chosen[name]
        ]
    stress = "default method, through files"
    yield Row.of_worst(stress, RANGE, figures, EXACT, "relative to scale 1")
    stress = "what the default method chooses: method, width, iterations, active voxels, warnings"
    yield Row.of_faults(stress, RANGE, changed, unit="changes")
    residual = _left_out(plain)
    ratios = [(other.name, abs(_left_out(other) / residual - 1)) for other in others]
    yield Row.of_worst("residual of pixels left out", RANGE, ratios, EXACT, "relative")


def _left_out(scaled: Scaled) -> float:
    """Return the residual of pixels left out."""
    return choose_by_left_out_pixels(scaled.seen.stored, scaled.seen.measured).held_out_residual


def _form(scaled: Scaled, form: str) -> ProjectionOperator:
    return scaled.seen.on_the_fly if form == "on_the_fly" else scaled.seen.stored


def _choice(outcome: Reconstruction) -> Mapping[str, object]:
    settings = outcome.solution.settings
    return {
        "method": settings["method"],
        "width": settings["smooth_width"],
        "strength": settings.get("strength"),
        "iterations": settings["iterations"],
        "active voxels": outcome.counts["active_voxels"],
        "warnings": len(outcome.warnings),
    }
