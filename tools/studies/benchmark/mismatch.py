"""Chords against learned weights, on images that hold what chord lengths lack.

One effect at a time or all: gains that differ by 10 %, gas that absorbs (an optical depth of 2
across the box, or of 1 through the flame for its own light), 40 % of the light lost in the
corners, a blur of two voxels; pixels have an area everywhere, and images noise of 2 % of the
brightest pixel. 33 views; no solver knows the effects. "Classic" is the best of
`studies.benchmark.convergence`, stopped where it is nearest to the truth; "informed" is the best
of the least squares and of that one, so stopped, with the true weights: about what the images
allow. "wernet" is `reconstruct(method="wernet")`, which stops by itself. Seconds since the images
were in memory.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

import phantoms
from studies.benchmark.convergence import CLASSIC, INFORMED, convergence_of, in_linear_basis
from studies.benchmark.sizes import SIZES
from studies.common.flames import FlameSize, flame_rig, with_noise
from studies.common.scans import OfScan, Problem, problem, reconstructed, seconds_of
from studies.common.study import Request, Tables
from tomo import LinearSystem, Projector, Segments, VoxelGrid, metrics
from tomo.operators import LINEAR, VOXEL
from tomo.operators.operator import ProjectionOperator
from tomo.pipeline import Reconstruction
from tomo.simulation import simulate_images
from tomo.simulation.effects import Effects
from tomo.simulation.simulate import SimulatedImages

VIEWS = 33
NOISES: Mapping[str, float] = {"clean": 0.0, "2 %": 0.02}
"""Standard deviation of white noise in every pixel, over the brightest pixel."""

GAIN_SPREAD = 0.1
BOX_DEPTH = 2.0
"""Optical depth across the box, most of which the views from both sides make up for."""

FLAME_DEPTH = 1.0  # optical depth of the flame for its own light, through its brightest part
CORNER_LOSS = 0.4
APERTURE = 29.0
FOCUS_DISTANCE = 5600.0
"""A lens of 116 mm at f/4, focused 200 mm in front of the flame: a blur of 1 mm, two voxels."""

EFFECTS: Mapping[str, tuple[str, ...]] = {
    "gains": ("gain_spread",),
    "absorption": ("absorption",),
    "self-absorption": ("self_absorption",),
    "vignetting": ("vignetting",),
    "defocus": ("aperture", "focus_distance"),
    "pixel area": (),
    "gains + absorption": ("gain_spread", "absorption"),
    "all": (
        "gain_spread", "absorption", "self_absorption", "vignetting", "aperture", "focus_distance",
    ),
}  # fmt: skip
"""The fields of `Effects` that each row sets; finite pixels come with all."""


@dataclass(frozen=True, eq=False)
class MismatchScene(OfScan):
    """Images with one of `EFFECTS`, and the flame they are of."""

    effect: str
    flame: str
    noise: str
    seed: int  # of flame, gains and noise
    effects: Effects  # what the images hold
    scan: SimulatedImages

    def problem(self, *, midpoints: bool = False) -> Problem:
        """Return the equations of chords, one ray a pixel, carved as the default carves."""
        return problem(self.rig, self.grid, self.images, skip=True, midpoints=midpoints)

    def learned(self, **how: Any) -> Reconstruction:
        """Return what ``reconstruct(method="wernet", **how)`` makes of the scan's files."""
        how = {"method": "wernet", "seed": self.seed} | how
        return reconstructed(self.scan, **how)

    def weight_ratios(self, system: LinearSystem) -> NDArray[np.float64]:
        """Return the true weight of each of the system's segments over its chord: ``(S,)``."""
        projector = system.projector
        known = projector.grid, projector.active.compress(self.truth)
        gains = self.effects.gains(len(self.rig), self.seed)
        ratios = [
            self.effects.weight_ratio(camera, projector.view(view).segments, *known, gain=gain)
            for view, (camera, gain) in enumerate(zip(self.rig, gains, strict=True))
        ]
        return np.concatenate(ratios)

    def informed(self, system: LinearSystem) -> ProjectionOperator | None:
        """Return the projector of the same pixels and voxels that knows all of the effects.

        In the linear basis it knows the weights along the middle of a pixel, not of the pixel's
        area; None where a lens sees far more.
        """
        if system.projector.basis == LINEAR:
            if self.effects.aperture:
                return None
            lengths = system.projector.segments.length * self.weight_ratios(system)
            return system.projector.with_lengths(lengths.astype(np.float32))
        active = system.projector.active
        gains = self.effects.gains(len(self.rig), self.seed)
        parts = []
        for camera, pixels, gain in zip(self.rig, system.pixels, gains, strict=True):
            rays = self.effects.rays(camera, pixels)
            part = self.effects.trace(rays, self.grid, self.truth).renumbered(active.number)
            width = camera.image_size[0]
            centres = np.stack([pixels % width, pixels // width], axis=-1)
            light = (gain * self.effects.falloff(camera, centres)).astype(np.float32)
            length = part.length * np.repeat(light, np.diff(part.ptr))
            rows = scipy.sparse.csr_array(
                (length, part.voxel, part.ptr), (len(pixels), active.size)
            )
            rows.sum_duplicates()  # the rays of a lens share most of their voxels
            voxel = rows.indices.astype(part.voxel.dtype)
            parts.append(Segments(rows.indptr.astype(np.int64), voxel, rows.data))
        view_ptr = system.projector.view_ptr
        return Projector(Segments.concatenate(parts), self.grid, view_ptr, active)


def mismatch_scene(
    effect: str, flame: str, noise: str, seed: int, size: FlameSize
) -> MismatchScene:
    """Return one scene of the suite, with one of `EFFECTS` and one of `NOISES`."""
    effects, clean = _clean(effect, flame, seed, size)
    kind = "gaussian" if NOISES[noise] else "clean"
    images = with_noise(list(clean.images.values()), kind, seed, NOISES[noise])
    scan = replace(clean, images=dict(zip(clean.rig.names, images, strict=True)))
    return MismatchScene(effect, flame, noise, seed, effects, scan)


def _strengths(grid: VoxelGrid, truth: NDArray[np.float32]) -> dict[str, float]:
    """Return the value that each field of the effects has where it is set."""
    across = max(truth.sum(axis=axis).max() * grid.spacing[axis] for axis in (0, 2))
    return {
        "gain_spread": GAIN_SPREAD,
        "absorption": BOX_DEPTH / float(grid.extent[0]),
        "self_absorption": FLAME_DEPTH / float(across),
        "vignetting": CORNER_LOSS,
        "aperture": APERTURE,
        "focus_distance": FOCUS_DISTANCE,
    }


@lru_cache(maxsize=2)
def _clean(effect: str, flame: str, seed: int, size: FlameSize) -> tuple[Effects, SimulatedImages]:
    fine = _fine_volume(flame, seed, size)
    grid = VoxelGrid(size.grid_shape, size.spacing)
    strengths = _strengths(grid, grid.average(fine, size.refine))
    effects = Effects(**{name: strengths[name] for name in EFFECTS[effect]})
    scan = simulate_images(
        flame_rig(VIEWS, size.shrink),
        phantoms.SampledField(fine, grid.refined(size.refine)),
        grid,
        refine=size.refine,
        supersample=size.supersample,
        effects=effects,
        seed=seed,
    )
    return effects, scan


@lru_cache(maxsize=2)
def _fine_volume(flame: str, seed: int, size: FlameSize) -> NDArray[np.float32]:
    """Sample a flame once for all effects: that takes longest."""
    grid = VoxelGrid(size.grid_shape, size.spacing)
    field = phantoms.create(flame, seed, grid.extent, grid.center)
    return phantoms.sample(field, grid.refined(size.refine), 2)


SHOWN = "2 %"  # of `NOISES`


def run(request: Request) -> Tables:
    """Return a row an effect and flame."""
    sizes = SIZES[request.size]
    cases = itertools.product(sizes.effects or tuple(EFFECTS), sizes.flames)
    return {
        "mismatch": [
            mismatch_row(effect, flame, SHOWN, sizes.seeds[0], sizes.flame, sizes.passes)
            for effect, flame in request.each(cases, "{0[0]}, {0[1]}".format)
        ]
    }


def mismatch_row(
    effect: str, flame: str, noise: str, seed: int, size: FlameSize, passes: int
) -> dict[str, Any]:
    """Return what all methods make of one scene, see `mismatch_scene`."""
    scene = mismatch_scene(effect, flame, noise, seed, size)
    ready = scene.problem(midpoints=True)
    problems = {VOXEL: ready, LINEAR: in_linear_basis(ready)}
    classic = convergence_of(problems, scene.truth, CLASSIC, passes)
    best = min(classic, key=lambda name: classic[name].least)
    went = classic[best]
    alike = [one for one in CLASSIC if one in INFORMED or one.name == best]
    knowing = {
        basis: replace(one, system=replace(one.system, projector=projector))
        for basis, one in problems.items()
        if (projector := scene.informed(one.system)) is not None
    }
    informed = convergence_of(knowing, scene.truth, alike, passes)
    limit = min(informed.values(), key=lambda one: one.least)
    learned = scene.learned()
    distance = metrics.cosine_distance(learned.volume, scene.truth)
    return {
        "effect": effect,
        "flame": flame,
        "noise": noise,
        "seed": seed,
        "classic": best,
        "classic_pass": went.best,
        "classic_cosine_distance": went.least,
        "classic_nrmse": went.nrmses[went.best],
        "classic_seconds": went.seconds[went.best],
        "tried": [(name, one.least) for name, one in classic.items()],
        "informed_cosine_distance": limit.least,
        "informed_of_classic": limit.least / went.least,
        "wernet_cosine_distance": distance,
        "wernet_of_classic": distance / went.least,
        "wernet_nrmse": metrics.nrmse(learned.volume, scene.truth),
        "wernet_seconds": seconds_of(learned),
    }
