"""Pixels that are no measurement: not finite, masked, saturated, dead."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from _stress.row import Row, faults_of_refusing, relative_error, worst_of
from _stress.values_scene import Scene, run
from tomo import Scan
from tomo.hull import carve
from tomo.metrics import nrmse
from tomo.pipeline import reconstruct
from tomo.scan import Corrections
from tomo.simulation.simulate import SimulatedScan

WILD: Mapping[str, float] = {"NaN": np.nan, "+inf": np.inf, "-inf": -np.inf}
UNDER_A_MASK = {**WILD, "1e30": 1e30, "-1e30": -1e30, "0": 0.0}
PLACE = (20, 12)
_APART = np.zeros((40, 24), bool)
_APART[6:-6:3, 5:-5:3] = True  # no two beside each other
SATURATED = (0.9, 0.5)
"""Of the brightest pixel: what is above is cut."""
CORE = "the core is on no usable ray: what is not measured cannot be known"
DEAD = 5
"""Pixels of each image that are always zero, or always full."""

Change = Callable[[NDArray[np.float32], np.random.Generator], NDArray[np.float32]]


def pixel_rows(seen: Scene) -> Iterator[Row]:
    """Yield the rows of wrong pixels."""
    yield from _refused(seen)
    yield _spoiled(seen)
    with tempfile.TemporaryDirectory() as folder:
        yield from _through_files(seen.simulated, Path(folder))


def _refused(seen: Scene) -> Iterator[Row]:
    """From arrays, a pixel that is not finite is refused; carving takes it for unusable."""

    def wild(value: float) -> NDArray[np.float32]:
        measured = seen.measured.copy()
        measured[len(measured) // 2] = value
        return measured

    faults = faults_of_refusing(
        (f"{name}, {what}", lambda m=method, p=projector, v=value: run(m, p, wild(v)))
        for name, method, projector in seen.cases()
        for what, value in WILD.items()
    )
    yield Row.of_faults(
        "one NaN or infinite pixel in an array is refused, every classic method",
        ", ".join(WILD),
        faults,
    )
    images = list(seen.simulated.images.values())
    masks = [np.ones(image.shape, bool) for image in images]
    masks[0][PLACE] = False
    expected = carve(tuple(seen.simulated.rig), images, masks, seen.grid).active.mask
    figures = []
    for what, value in WILD.items():
        spoiled = [images[0].copy(), *images[1:]]
        spoiled[0][PLACE] = value
        active = carve(tuple(seen.simulated.rig), spoiled, None, seen.grid).active.mask
        figures.append((what, float(np.count_nonzero(active != expected))))
    worst, where = worst_of(figures)
    yield Row(
        "carving with one NaN or infinite pixel against one masked",
        ", ".join(WILD),
        worst,
        0,
        "voxels that differ",
        note=where,
    )


def _spoiled(seen: Scene) -> Row:
    """Back-project one pixel that is not finite: what it does not see stays as it was."""
    figures = []
    pixel = int(np.argmax(seen.stored.row_sums))
    for form, projector in (("stored", seen.stored), ("on the fly", seen.on_the_fly)):
        alone = np.zeros(len(seen.measured))
        alone[pixel] = 1.0
        meets = projector.T @ alone > 0
        clean = projector.T @ np.where(alone > 0, 0, seen.measured).astype(np.float32)
        for what, value in WILD.items():
            measured = seen.measured.copy()
            measured[pixel] = value
            found = projector.T @ measured
            wrong = np.count_nonzero(np.isfinite(found[meets]))
            wrong += np.count_nonzero(found[~meets] != clean[~meets])
            figures.append((f"{form}, {what}", float(wrong)))
    worst, where = worst_of(figures)
    return Row(
        "back-projection of one NaN or infinite pixel spoils what it sees alone",
        ", ".join(WILD),
        worst,
        0,
        "voxels",
        note=where,
    )


def _through_files(simulated: SimulatedScan, folder: Path) -> Iterator[Row]:
    def scan_of(name: str, change: Change, corrections: Corrections | None = None) -> Scan:
        random = np.random.default_rng(0)
        images = {n: change(image.copy(), random) for n, image in simulated.images.items()}
        changed = replace(simulated, images=MappingProxyType(images))
        scan = Scan.load(changed.save(folder / name))
        return scan if corrections is None else replace(scan, corrections=corrections)

    def wild(value: float) -> Change:
        def change(image: NDArray, _random: np.random.Generator) -> NDArray:
            image[PLACE] = value
            return image

        return change

    scans = {what: scan_of(what, wild(value)) for what, value in UNDER_A_MASK.items()}
    faults = faults_of_refusing(
        (what, lambda what=what: reconstruct(scans[what])) for what in WILD
    )
    yield Row.of_faults(
        "one NaN or infinite pixel in a file without a mask is refused", ", ".join(WILD), faults
    )
    usable = np.ones(next(iter(simulated.images.values())).shape, np.uint8)
    usable[PLACE] = 0
    mask = folder / "mask.png"
    _write(mask, usable)
    volumes = {
        what: _volume(replace(scan, corrections=Corrections(mask=mask)))
        for what, scan in scans.items()
    }
    worst, where = worst_of(
        (what, relative_error(volume, volumes["0"])) for what, volume in volumes.items()
    )
    yield Row(
        "what lies under a mask, default method",
        ", ".join(UNDER_A_MASK),
        worst,
        0.0,
        "relative change of the volume",
        note=where,
    )
    clean = nrmse(_volume(scan_of("clean", lambda image, _: image)), simulated.truth)
    top = max(float(image.max()) for image in simulated.images.values())

    def dead(level: float) -> Change:
        def change(image: NDArray, random: np.random.Generator) -> NDArray:
            at = random.choice(np.argwhere(_APART), DEAD, replace=False)
            image[*at.T] = level
            return image

        return change

    for level in SATURATED:
        limit = np.float32(level * top)
        scan = scan_of(f"cut {level}", lambda image, _, limit=limit: np.minimum(image, limit))
        told = reconstruct(replace(scan, corrections=Corrections(saturation=0.999 * limit)))
        yield Row(
            "saturated pixels, told by `saturation`, default method",
            f"above {level:.0%} of the brightest",
            nrmse(told.reconstruction.volume, simulated.truth) / clean,
            1.25,
            "times the clean error",
            note="" if level > 0.5 else CORE,
        )
    warned = any("seen by no camera" in warning for warning in told.warnings)
    yield Row(
        "a core that is saturated in every view is warned of",
        f"above {level:.0%} of the brightest",
        float(not warned),
        0,
        "faults",
    )
    for what, level in (("dead", 0.0), ("hot, 1e6 times the brightest", 1e6 * top)):
        worse = nrmse(_volume(scan_of(what[:4].strip(","), dead(level))), simulated.truth)
        yield Row(
            f"single pixels {what}, no mask, default method",
            f"{DEAD} of {_APART.size} in every image",
            worse / clean,
            1.5,
            "times the clean error",
        )


def _volume(scan: Scan) -> NDArray[np.float32]:
    return reconstruct(scan, uncertainty=0).reconstruction.volume


def _write(path: Path, mask: NDArray[np.uint8]) -> None:
    from tomo.io import write_image

    write_image(path, mask)
