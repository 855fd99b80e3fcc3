"""A known scene: images of a field whose truth is known, in memory as a scan; cached on disk."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache as once
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

import phantoms
from rigs import Rig
from rigs.files import atomic_path
from rigs.files.size_guard import read_arrays
from studies.scenes import cameras
from studies.scenes.exposure import (
    BRIGHTEST,
    CLEAN,
    TWELVE_BIT,
    Exposure,
    corrections,
    recorded,
    stored,
)
from studies.scenes.faults import KNOWN, Exposures, Setting
from studies.scenes.fields import KnownField
from studies.scenes.recipe import Recipe
from tomo import Scan, VoxelGrid, reconstruct

TRUTH_POINTS = 6
"""Points along each edge of a voxel whose mean is the truth; half-voxel sheets need as many."""

Arrays = dict[str, NDArray]


@dataclass(frozen=True, eq=False)
class KnownScene:
    """Images of a known field."""

    recipe: Recipe
    rig: Rig  # the cameras as a reconstruction is given them
    grid: VoxelGrid
    images: Mapping[str, NDArray]  # float32, or uint16 with a pedestal that the scan knows as dark
    # (nx, ny, nz): means of the field over the voxels, in full scales per unit of length
    truth: NDArray[np.float32]
    wrong: tuple[str, ...] = ()  # the cameras whose images the fault changed

    @property
    def at_fault(self) -> tuple[str, ...]:
        """The cameras that a report should name: none for faults of all cameras."""
        fault = KNOWN.get(self.recipe.fault)
        return self.wrong if fault is not None and fault.single else ()

    @property
    def expected(self) -> tuple[tuple[tuple[str, ...], str | None], ...]:
        """What names the fault: for each camera at fault, or None for all, the effects' names."""
        fault = KNOWN.get(self.recipe.fault)
        if fault is None:
            return ()
        own = self.rig.names[self.recipe.view]
        where = self.at_fault or (None,)
        return tuple((fault.names[0 if one in (own, None) else -1], one) for one in where)

    @property
    def mendable(self) -> bool:
        """Whether a correction may mend the fault."""
        fault = KNOWN.get(self.recipe.fault)
        return fault is None or self.recipe.size < fault.mendable

    @property
    def scan(self) -> Scan:
        """The images as a scan in memory, with the truth."""
        known = corrections(self.recipe.noise)
        return Scan.from_arrays(
            self.rig, self.images, self.grid, corrections=known, truth=self.truth
        )


def known_scene(recipe: Recipe, cache: Path | None = None) -> KnownScene:
    """Return a scene, from the folder ``cache`` where it is there; else it is made and kept."""
    rig = cameras.rig(recipe.rig, recipe.grid, recipe.seed)
    arrays = _kept(cache, recipe.key, lambda: _taken(recipe, rig, cache))
    images = MappingProxyType({name: arrays[name] for name in rig.names})
    wrong = tuple(rig.names[view] for view in arrays["_wrong"])
    return KnownScene(recipe, rig, recipe.grid, images, arrays["_truth"], wrong)


@once
def warm_up() -> None:
    """Compile or load kernels, once a process: seconds are those of a process at work."""
    for views in (6, 12):
        recipe = Recipe("settle", "tilted cone", f"ring-{views}", TWELVE_BIT, 0)
        reconstruct(known_scene(recipe).scan)


def _kept(cache: Path | None, key: str, make: Callable[[], Arrays]) -> Arrays:
    """Return arrays from the cache; else make and keep them."""
    path = None if cache is None else cache / f"{key}.npz"
    if path is not None and path.is_file():
        return read_arrays(path)
    arrays = make()
    if path is not None:
        with atomic_path(path) as temporary:
            np.savez_compressed(temporary, **arrays)
    return arrays


def _taken(recipe: Recipe, rig: Rig, cache: Path | None) -> Arrays:
    """Return the images by camera, the truth, and the numbers of the cameras at fault."""
    field = KnownField(recipe.family, recipe.seed, recipe.grid)
    plain = tuple(Exposure(camera, field) for camera in rig)
    seen = replace(recipe.faultless, noise=CLEAN)
    light = _kept(cache, f"light-{seen.key}", lambda: _light(plain))
    lights, truth = [light[camera.name] for camera in rig], light["_truth"]
    brightest = max(float(one.max()) for one in lights)
    exposures = _with_fault(recipe, plain, brightest)
    wrong = [view for view, (a, b) in enumerate(zip(plain, exposures, strict=True)) if a != b]
    for view in wrong:
        if exposures[view].sight != plain[view].sight:
            lights[view] = exposures[view].light()
    if recipe.fault and not KNOWN[recipe.fault].single:  # a lamp asks for a shorter exposure
        brightest = max(brightest, *(float(one.max()) for one in lights))
    unit, taken = BRIGHTEST / brightest, {}
    for view, (exposure, one) in enumerate(zip(exposures, lights, strict=True)):
        image = exposure.image(unit * one)
        most = exposure.saturation * image.max() if exposure.saturation < 1 else np.inf
        whose = view if exposure.taken_by is None else exposure.taken_by
        one = recorded(image, recipe.noise, (recipe.seed, whose), most)
        one = stored(one, recipe.noise, exposure.gamma, exposure.dead)
        taken[rig.names[view]] = one
    return taken | {
        "_truth": (unit * truth).astype(np.float32),
        "_wrong": np.array(wrong, np.int64),
    }


def _light(plain: Exposures) -> Arrays:
    """Return what arrives at every camera, and the means of the field over the voxels."""
    field = plain[0].field
    found = {exposure.camera.name: exposure.light() for exposure in plain}
    return found | {"_truth": phantoms.sample(field, field.grid, TRUTH_POINTS)}


def _with_fault(recipe: Recipe, plain: Exposures, brightest: float) -> Exposures:
    """Return the exposures with the recipe's fault, if it has one."""
    if not recipe.fault:
        return plain
    fault = KNOWN[recipe.fault]
    size = (fault.settle if recipe.half == "settle" else fault.report)[recipe.size]
    random = np.random.default_rng([recipe.seed, zlib.crc32(recipe.fault.encode())])
    return fault.make(plain, Setting(recipe.view, size, brightest, random))
