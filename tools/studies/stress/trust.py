"""The condition report: its standard deviations, its resolution and its warnings, against fact."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from phantoms import GaussianBlobs
from rigs import Rig, arc
from studies.common.study import Request
from studies.stress.resolution import resolution_rows
from studies.stress.row import Row, relative_error
from studies.stress.trust_scenes import SHAPE, TrustScene, seen_by, trust_scene
from tomo.simulation import simulate_images
from tomo.uncertainty import Assessment, assess, half_widths

WITHIN = 1.5
SHARE = 0.8  # fraction of the voxels whose standard deviations agree within `WITHIN`
QUICK_SHARE = 0.6
"""With 12 repeats on either side, two perfect estimates scatter by 30 % and agree for 82 %."""

REPEATS, QUICK_REPEATS = 30, 12  # noisy sets that the deviations are checked against
ESTIMATES, QUICK_ESTIMATES = 100, 20
"""Repeats of the one set that they are estimated from; half of them calibrate the others."""

QUICK_SHAPE = (30, 70, 30)  # half the height: half the voxels, of the same width
BLOB = 0.5  # voxels, the standard deviation of the small bright blob
RESOLVED = 0.2
FAN = 30.0


def run(request: Request) -> Iterator[Row]:
    """Yield the rows of this part."""
    quick = request.size != "full"
    repeats, estimates = (QUICK_REPEATS, QUICK_ESTIMATES) if quick else (REPEATS, ESTIMATES)
    flames = ("jet",) if quick else ("jet", "turbulent")
    layouts = (11,) if quick else (33, 11)
    seed, shape = request.seed + 1, QUICK_SHAPE if quick else SHAPE
    cases = list(product(flames, layouts, ("gaussian", "poisson")))
    noises, fractions, resolved = [], [], []
    said = "standard deviations: {0[0]}, {0[1]} views, {0[2]}".format
    for flame, views, noise in request.each(cases, said):
        scene = trust_scene(flame, views, noise, seed, shape)
        found = assessed(scene, estimates)
        noises.append((scene.name, abs(noise_ratio(scene, found) - 1)))
        compared = list(deviation_rows(scene, found, repeats))
        yield from compared
        fractions.append((compared[1].figure, len(found.deviations.values)))
        if (flame, views, noise) == (flames[-1], layouts[0], "gaussian"):
            resolved.append(resolution_row(scene, found))
    voxels = sum(count for _, count in fractions)
    stress = f"standard deviations within {WITHIN}, all voxels not carved"
    over = f"{len(cases)} scenes together, {voxels} voxels"
    figure = sum(fraction * count for fraction, count in fractions) / voxels
    bound = QUICK_SHARE if quick else SHARE
    yield Row(stress, over, figure, bound, "of the voxels", at_least=True)
    over = f"{len(cases)} scenes, gaussian and poisson"
    yield Row.of_worst("noise found in the images", over, noises, 0.15, "off the truth")
    yield from resolved
    yield from resolution_rows(quick)
    yield from warning_rows(trust_scene("jet", layouts[0], "clean", seed, shape))


def assessed(scene: TrustScene, repeats: int) -> Assessment:
    """Return the condition of a scene, from its noisy images alone."""
    problem, how = scene.problem, {"repeats": repeats, "seed": scene.seed}
    return assess(problem.system, problem.measured, scene.volume, scene.solve, **how)


def agreeing(found: NDArray, reference: NDArray, voxels: NDArray[np.bool_]) -> float:
    """Return the share of voxels whose two standard deviations agree within `WITHIN`."""
    a, b = np.asarray(found, np.float64)[voxels], np.asarray(reference, np.float64)[voxels]
    return float(np.mean((a <= WITHIN * b) & (b <= WITHIN * a)))


def noise_ratio(scene: TrustScene, found: Assessment) -> float:
    """Return the noise found over the true one, root mean squares."""
    return float(np.linalg.norm(found.deviations.noise) / np.linalg.norm(scene.true_noise()))


def deviation_rows(scene: TrustScene, found: Assessment, repeats: int) -> Iterator[Row]:
    """Compare standard deviations with those of new noisy sets."""
    bound = SHARE if repeats >= REPEATS else QUICK_SHARE
    emitting = found.coverage.emitting
    everywhere = np.ones_like(emitting)
    values = found.deviations.values
    reference, other = (scene.repeated(repeats, batch) for batch in (1, 2))
    few = "" if repeats >= REPEATS else f"{repeats} repeats scatter by a fifth; "
    for what, voxels in (("voxels that emit", emitting), ("all voxels not carved", everywhere)):
        limit = agreeing(other, reference, voxels)
        note = f"{few}two times {repeats} noisy sets agree with each other for {limit:.0%}"
        share = agreeing(values, reference, voxels)
        if share < bound and voxels is everywhere:
            note += (
                "; the rest are voxels without emission: held at zero in most sets, they spread "
                "in few, and how firmly they are held hangs on the noise of the one set there is"
            )
        stress = f"standard deviations within {WITHIN}, {what}"
        over = f"{scene.name}, {found.deviations.repeats} repeats against {repeats} noisy sets"
        yield Row(stress, over, share, bound, "of the voxels", at_least=True, note=note)


def resolution_row(scene: TrustScene, found: Assessment) -> Row:
    """Compare the stated resolution with the width of small bright blobs in the scene.

    The width stated is that of a spot of one voxel; a blob is as much wider as its means over the
    voxels are wider than one voxel, in squares.
    """
    system, grid = scene.problem.system, scene.clean.grid
    active = system.projector.active
    before = scene.solve(scene.problem.measured)
    bright = np.flatnonzero(before > 0.3 * before.max())
    widths, own = [], []
    for unknown in bright[np.linspace(0, len(bright) - 1, 5).astype(int)[1:-1]]:
        flat = int(unknown if active.index is None else active.index[unknown])
        place = tuple(int(index) for index in np.unravel_index(flat, grid.shape))
        point = tuple(float(axis[index]) for axis, index in zip(grid.axes(), place, strict=True))
        blob = GaussianBlobs((point,), (BLOB * min(grid.spacing),), (1.0,))
        seen = simulate_images(scene.clean.rig, blob, grid, refine=2, supersample=3)
        light = system.flatten(list(seen.images.values()))
        light = light * (0.5 * float(before.max()) / float(seen.truth.max()))
        change = scene.solve((scene.problem.measured + light).astype(np.float32)) - before
        response = active.expand(change.astype(np.float64)).reshape(grid.shape)
        widths.append(half_widths(response, place))
        own.append(half_widths(seen.truth.astype(np.float64), place))
    blob, spot = np.median(own, axis=0), np.median(found.resolution.widths, axis=0)
    stated = np.sqrt(spot**2 + blob**2 - 1)
    measured = np.median(widths, axis=0)
    stress = "resolution stated against the width of a bright blob"
    over = f"{scene.name}, blob of {blob[0]:.1f} voxels at 3 places"
    note = f"stated {_text(stated)}, measured {_text(measured)} voxels along x, y, z"
    return Row(stress, over, relative_error(stated, measured), RESOLVED, "relative", note=note)


def warning_rows(scene: TrustScene) -> Iterator[Row]:
    """Count warnings that fail to come, or come for nothing."""
    rig = scene.clean.rig
    cases = (
        ("2 views", rig[0:9:8], True),
        (f"5 views in a fan of {FAN:g} degrees", fan_like(rig), True),
        (f"{len(rig)} views", rig, False),
    )
    for what, cameras, expected in cases:
        found = assessed(scene if cameras is rig else seen_by(scene, cameras), 2).coverage.resolved
        warned = found is not None and found.is_coarse
        stress = "warning that is missing" if expected else "warning for nothing"
        note = "few directions" if warned else ""
        over = f"{what} of {scene.name}"
        yield Row(stress, over, int(warned != expected), 0, "faults", note=note)


def fan_like(rig: Rig) -> Rig:
    """Return five cameras like the first in a fan of `FAN` degrees, looking at the origin."""
    camera = rig[0]
    distance = float(np.linalg.norm(camera.position))
    focal = float(camera.camera_matrix[0, 0])
    return arc(5, FAN, distance, image_size=camera.image_size, footprint=distance / focal)


def _text(widths: NDArray[np.float64]) -> str:
    return " x ".join(f"{width:.2f}" for width in widths)
