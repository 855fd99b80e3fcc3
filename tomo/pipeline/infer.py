"""Stage 3, infer: what is wrong with cameras, images and gas, found beside a coarse volume."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike
from rigs.progress import Progress
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.hull import carve
from tomo.inference.finding import Finding
from tomo.inference.fit import Fit
from tomo.inference.infer import Inference, infer
from tomo.inference.misplaced import TURNS, find_misplaced
from tomo.inference.solve import first_fit
from tomo.inference.steps import distrust, fraction_outside
from tomo.inference.unusable import doubles, is_dark
from tomo.model import (
    Absorbing,
    Background,
    Blur,
    Corrections,
    FallOff,
    Gain,
    Observation,
    Pose,
)
from tomo.model.effect import Effect
from tomo.operators import Absorption, extinction_of
from tomo.operators.view_gains import Gains
from tomo.pipeline.advice import dark_levels, line_for_dark, line_for_gains
from tomo.pipeline.methods import AUTO, method_named
from tomo.pipeline.options import OFF, Options
from tomo.pipeline.screen import ScreenedScan, parted
from tomo.pipeline.stage import Record, as_warning, timed
from tomo.scan import Scan
from tomo.scan.downsample import coarsening

SEGMENTS = 600_000
"""Segments, about, of the coarse copy. More take longer; fewer hide what thin flames tell."""

RAYS = 2
"""Rays along each side of a pixel of that copy, where it is coarse, or so small that they cost
little: of one ray each, pixels sample thin flames unevenly, which looks like gains."""

COARSEST = 16
"""Voxels along the grid's longest edge, and pixels along an image's shortest, of that copy."""

FEWEST_VIEWS = 3
"""Views that effects need at least: whatever is wrong, some volume reproduces two."""

UNKNOWN_GAIN = 1.0
"""Prior standard deviation of the gains' logarithms where their fit is asked for: that of `Gain`
pulls gains of 4 down by a hundredth."""

LIT = 0.05
"""Fraction of the brightest light from which a pixel is lit."""

QUARTER = 4
"""One in so many views may be dark where there is light, behind a frame: more must find a voxel
dark before it is taken for empty."""


def given_absorption(scan: Scan, options: Options) -> Absorption:
    """Return the absorption that is known: the option's, and that of gas in the rig's scene."""
    return Absorption(medium=options.absorption or 0.0, extinction=extinction_of(scan.rig))


def effects_of(options: Options, known: Absorption, factor: int) -> tuple[Effect, ...]:
    """Return the effects that options let loose, for pixels ``factor`` times as wide."""
    found: list[Effect] = []
    default = method_named(options.method).name == AUTO
    if options.fit_gain or (options.screen and options.fit_gain is None):
        found += [Gain(UNKNOWN_GAIN) if options.fit_gain else Gain(), Background()]
    if options.screen and default:
        found.append(FallOff())
        if not options.blur and options.aperture_rays == 1:
            found.append(Blur(Blur.sigma / factor**2))
    if options.fit_absorption or (options.fit_absorption is None and default):
        given = known.extinction is not None
        if options.absorption is None and not given:
            found.append(Absorbing(own=False))
        if options.fit_absorption or not given:
            found.append(Absorbing(own=True))
    if options.align and options.refine_cameras in (None, ("none",)):  # else that moves cameras
        found.append(Pose(Pose.sigma / factor))
    return tuple(found)


def infer_effects(
    screened: ScreenedScan,
    whole: Scan,
    grid: VoxelGrid,
    options: Options,
    progress: Progress | None = None,
) -> ScreenedScan:
    """Return the images that take part, corrected by what exceeds its null.

    Parameters
    ----------
    screened : ScreenedScan
    whole : Scan
        All cameras, those held out too.
    grid : VoxelGrid
    options : Options
    progress : callable, optional
    """
    with timed() as stage:
        if options.screen:
            screened = _without_unusable(screened, whole)
        known = given_absorption(screened.scan, options)
        with as_warning("effects of cameras and gas: not looked for", stage.warnings):
            names = screened.scan.rig.names  # looked at by name: the rig's order changes no bit
            found = _inferred(_ordered(screened, sorted(names)), grid, options, known)
            screened = _ordered(found, names)
        stage.warnings += [one.sentence for one in screened.findings]
        screened = replace(screened, findings=(*screened.findings, *_overexposed(screened)))
        stage.warnings += _lines_for_scan(screened, whole, options)
    record = Record(
        screened.record.seconds + stage.record.seconds,
        (*screened.record.warnings, *stage.record.warnings),
    )
    return replace(screened, record=record)


def _overexposed(screened: ScreenedScan) -> list[Finding]:
    """Return the cameras whose brightest pixels are cut off; a warning of the pixels says so."""
    cut = screened.pixels.saturated if screened.pixels else {}
    return [Finding("saturation", name, level) for name, level in cut.items()]


def _lines_for_scan(screened: ScreenedScan, whole: Scan, options: Options) -> list[str]:
    """Return the lines of a scan.yaml that correct gains and dark levels."""
    names, gains, lines = screened.scan.rig.names, screened.gains, []
    if gains is not None and not options.fit_gain:
        line = line_for_gains(gains, names, whole.corrections)
        lines += [f"gains: to have them in the scan, write into scan.yaml: {line}"] if line else []
    levels = dark_levels(screened.pixels, gains, names)
    dark = line_for_dark(levels, whole.rig.names, whole, fitted=gains is not None)
    return lines + ([dark] if dark else [])


def _without_unusable(screened: ScreenedScan, whole: Scan) -> ScreenedScan:
    """Return the scan without images that say nothing, if enough others are left."""
    names, found = screened.scan.rig.names, []
    for name, image, mask, noise in zip(
        names, screened.images, screened.masks, screened.noise, strict=True
    ):
        if is_dark(image, mask, noise):
            found.append(Finding("dark", name))
    for first, second in doubles(screened.images):
        found += [
            Finding("order", names[a], other=names[b])
            for a, b in ((first, second), (second, first))
        ]
    gone = tuple(dict.fromkeys(one.camera for one in found if one.camera))
    if not found or len(names) - len(gone) < FEWEST_VIEWS:
        return screened
    return _left_out(replace(screened, findings=tuple(found)), whole, gone)


def _left_out(screened: ScreenedScan, whole: Scan, gone: Sequence[str]) -> ScreenedScan:
    """Return the scan without some more cameras."""
    rest = replace(screened, apart=None, apart_images=[], apart_masks=[])
    kept = parted(rest, screened.scan, gone)
    if screened.apart is not None and kept.apart is not None:
        names = [*screened.apart.rig.names, *kept.apart.rig.names]
        both = dict(zip(names, [*screened.apart_images, *kept.apart_images], strict=True))
        masks = dict(zip(names, [*screened.apart_masks, *kept.apart_masks], strict=True))
        apart = whole.only(*names)
        kept = replace(
            kept,
            apart=apart,
            apart_images=[both[name] for name in apart.rig.names],
            apart_masks=[masks[name] for name in apart.rig.names],
        )
    return replace(kept, excluded=(*screened.excluded, *gone))


def _ordered(screened: ScreenedScan, names: Sequence[str]) -> ScreenedScan:
    """Return the views that take part in another order."""
    order = [screened.scan.rig.names.index(name) for name in names]
    rig, gains = screened.scan.rig, screened.gains
    if gains is not None:
        gains = replace(
            gains,
            **{
                name: getattr(gains, name)[order]
                for name in ("gain", "offset", "gain_error", "offset_error")
            },
            reference=None if gains.reference is None else gains.reference[order],
        )
    return replace(
        screened,
        scan=replace(screened.scan, rig=replace(rig, cameras=tuple(rig[n] for n in names))),
        images=[screened.images[n] for n in order],
        masks=[screened.masks[n] for n in order],
        noise=tuple(screened.noise[n] for n in order),
        gains=gains,
    )


def _inferred(
    screened: ScreenedScan, grid: VoxelGrid, options: Options, known: Absorption
) -> ScreenedScan:
    """Return the images corrected by what was found on a coarse copy."""
    scan = screened.scan
    factor = coarsening(scan.rig, grid, SEGMENTS, COARSEST)
    single = coarsening(scan.rig, grid, SEGMENTS // RAYS**2, COARSEST)
    rays = RAYS if factor > 1 or single == 1 else 1
    effects = effects_of(options, known, factor)
    lit = [bool((i[m] > 0).any()) for i, m in zip(screened.images, screened.masks, strict=True)]
    if len(scan.rig) < FEWEST_VIEWS or sum(lit) < FEWEST_VIEWS or not effects:
        return screened
    observation = Observation(
        scan.rig, tuple(screened.images), tuple(screened.masks), screened.noise, grid, known,
        scan.sets_scale,
    )  # fmt: skip
    levels = _own_levels(screened, effects)
    coarse = Background().applied(observation.coarser(factor, rays).in_sight, levels[:, None])
    if not coarse.brightest > 0:
        return screened
    power = math.frexp(coarse.brightest)[1]
    coarse = coarse.in_powers_of_two(power)
    active = _not_dark(coarse, options)
    first = first_fit(coarse, active)
    if options.screen:
        moved = _in_place(screened, coarse, first, active)
        if moved is not None:
            return _inferred(moved, grid, options, known)
    found = infer([coarse], effects, active, _asked(options, effects), options.screen, [first])
    corrections = _corrections(found, observation, factor, power, levels)
    seen = corrections.applied(observation)
    return replace(
        screened,
        scan=replace(scan, rig=seen.rig),
        images=list(seen.images),
        masks=list(seen.masks),
        noise=seen.noise,
        corrections=corrections,
        findings=(*screened.findings, *_findings(found, corrections, observation)),
        gains=_gains(found, corrections, observation, power),
        emission=_emission(found, grid, power) if corrections.absorption.emission else None,
    )


def _in_place(
    screened: ScreenedScan, coarse: Observation, first: Fit, active: ActiveVoxels | None
) -> ScreenedScan | None:
    """Return the images with one that was turned over, or another camera's, in its place."""
    found = find_misplaced(coarse, distrust([first], LIT * coarse.brightest), active)
    if found is None or len(screened.findings) >= len(coarse.rig):
        return None
    names, images, masks = coarse.rig.names, list(screened.images), list(screened.masks)
    noise, view, other = list(screened.noise), found.view, found.other
    if other is None:
        turn = TURNS[found.turned]
        images[view], masks[view] = turn(images[view]).copy(), turn(masks[view]).copy()
        said = [Finding("mirrored", names[view], other=found.turned)]
    else:
        images[view], images[other] = images[other], images[view]
        masks[view], masks[other] = masks[other], masks[view]
        noise[view], noise[other] = noise[other], noise[view]
        pairs = ((view, other), (other, view))
        said = [Finding("order", names[a], other=names[b]) for a, b in pairs]
    return replace(
        screened, images=images, masks=masks, noise=tuple(noise),
        findings=(*screened.findings, *said),
    )  # fmt: skip


def _own_levels(screened: ScreenedScan, effects: Sequence[Effect]) -> NDArray[np.float64]:
    """Return the levels that single images show, where backgrounds are let loose, ``(views,)``."""
    names, pixels = screened.scan.rig.names, screened.pixels
    if pixels is None or not any(effect.name == Background.name for effect in effects):
        return np.zeros(len(names))
    return np.array([pixels.background.get(name, 0.0) for name in names])


def _asked(options: Options, effects: Sequence[Effect]) -> list[str]:
    """Return the effects that options ask for, whatever their score."""
    names = ["gain", "background"] if options.fit_gain else []
    names += ["medium", "self-absorption"] if options.fit_absorption else []
    return [effect.name for effect in effects if effect.name in names]


def _not_dark(coarse: Observation, options: Options) -> ActiveVoxels | None:
    """Return the voxels that dark pixels do not prove empty."""
    if not options.skip or options.carving == OFF:
        return None
    votes = 1 + len(coarse.rig) // QUARTER
    rig = tuple(coarse.rig)
    found = carve(rig, coarse.images, coarse.masks, coarse.grid, votes=votes, noise=coarse.noise)
    return found.active


def _corrections(
    found: Inference,
    observation: Observation,
    factor: int,
    power: int,
    levels: NDArray[np.float64],
) -> Corrections:
    """Return what was found for images as they are.

    It was found on the coarse copy in units of ``2**power``, less ``levels``.
    """
    values = {name: np.array(one) for name, one in found.state.values.items()}
    if "background" in values:
        values["background"] *= 2.0**power
        values["background"][:, 0] += levels / np.exp(values["gain"][:, 0])
    for name, order in (("pose", 1), ("blur", 2)):  # lengths, and squares of lengths
        if name in values:
            values[name] *= factor**order
    fit, untrusted = found.state.fits[0], {}
    lost = fit.system.images((~fit.usable).astype(np.float32))
    for name, mask, image, hidden in zip(
        observation.rig.names, observation.masks, lost, found.state.hidden, strict=True
    ):
        if hidden:
            large = np.kron(image > 0, np.ones((factor, factor), bool))
            rows, columns = (max(a, b) for a, b in zip(mask.shape, large.shape, strict=True))
            whole = np.zeros((rows, columns), bool)
            whole[: large.shape[0], : large.shape[1]] = large
            untrusted[name] = whole[: mask.shape[0], : mask.shape[1]]
    return Corrections(
        tuple(observation.rig.names),
        observation.grid,
        found.effects,
        values,
        fit.observation.in_powers_of_two(-power).absorption,
        untrusted,
    )


def _emission(found: Inference, grid: VoxelGrid, power: int) -> NDArray[np.float32]:
    """Return the found emission in the voxels of a grid of the same box."""
    from scipy.ndimage import zoom

    coarse = found.state.fits[0].means
    ratio = np.divide(grid.shape, coarse.shape)
    return np.ldexp(zoom(coarse, ratio, order=1, mode="nearest", grid_mode=True), power)


def _gains(
    found: Inference, corrections: Corrections, observation: Observation, power: int
) -> Gains | None:
    """Return the gains and backgrounds that images were corrected by."""
    free = found.state.free
    if "gain" not in free:
        return None
    gain, level = (corrections.values[n][:, 0] for n in ("gain", "background"))
    if not (free["gain"].any() or free["background"].any() or level.any()):
        return None
    errors = [
        np.broadcast_to(found.spread.get(n, math.inf), gain.shape).astype(np.float64)
        for n in ("gain", "background")
    ]
    return Gains(
        np.exp(gain),
        np.exp(gain) * level,
        np.exp(gain) * errors[0],
        np.exp(gain) * errors[1] * 2.0**power,
        observation.brightest,
        None if observation.sets_scale is None else np.array(observation.sets_scale),
    )


def _findings(
    found: Inference, corrections: Corrections, observation: Observation
) -> list[Finding]:
    """Return what is said of each effect that was let loose, the gravest first."""
    said, names, state = [], corrections.names, found.state
    for effect in found.effects:
        values = corrections.values[effect.name]
        score = found.scores.get(effect.name, np.zeros(len(names)))
        if effect.shared and values.any():
            size, most = float(values[0, 0]), float(score.max())
            if effect.of_gas:
                said.append(Finding("absorption", size=size, score=most))
            else:
                said.append(Finding(effect.name, size=size, unit="%", score=most))
        elif not effect.shared:
            free = state.free[effect.name].any(axis=1) | (effect.name == Background.name)
            for view in np.flatnonzero(free & values.any(axis=1)):
                camera = observation.rig[names[view]]
                what, size, unit = _size(effect.name, values[view], camera, observation)
                said.append(Finding(what, camera.name, size, unit=unit, score=float(score[view])))
    for view in np.flatnonzero(state.hidden):
        fraction = float(corrections.untrusted[names[view]].mean())
        if fraction > 0:
            what = "scatter" if _is_brighter(state.fits[0], int(view)) else "hidden"
            most = float(found.scores["hidden"][view])
            said.append(Finding(what, names[view], fraction, unit="%", score=most))
    if found.state.has_outside:
        most = float(found.scores["outside"].max())
        size = fraction_outside(state.fits)
        said.append(Finding("outside", size=size, unit="%", score=most, corrected=False))
    return sorted(said, key=lambda one: -one.score)


def _is_brighter(fit: Fit, view: int) -> bool:
    """Return whether the pixels left out of a view are brighter than the volume says."""
    own = slice(*fit.system.projector.view_ptr[view : view + 2])
    return float(np.sum(fit.residual[own], where=~fit.usable[own])) > 0


def _size(
    effect: str, values: NDArray[np.float64], camera: CameraLike, observation: Observation
) -> tuple[str, float, str]:
    """Return what an effect of one camera is called, its size and unit."""
    if effect == "gain":
        return effect, float(np.expm1(values[0])), "%"
    if effect == "background":
        return effect, float(values[0]) / observation.brightest, "%"
    if effect == "blur":
        return effect, float(np.sqrt(values[0])), "px"
    zoom = abs(values[3])
    if zoom > np.abs(np.delete(values, 3)).max():
        radius = min(camera.image_size) / 2
        return "magnification", float(np.expm1(values[3] / radius)), "%"
    return effect, float(np.linalg.norm(values)), "px"
