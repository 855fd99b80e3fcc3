"""Stage 3, infer: what is wrong with cameras, images and gas, found beside a coarse volume."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from rigs.progress import Progress
from tomo.grid import VoxelGrid
from tomo.inference.finding import together
from tomo.inference.infer import FEWEST_VIEWS, Inference, infer, light_error
from tomo.inference.limits import detection_limits
from tomo.inference.solve import first_fits
from tomo.inference.steps import mean_volume
from tomo.model import (
    Absorber,
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
from tomo.pipeline.check_options import methods_of
from tomo.pipeline.coarse import CoarseCopy, factor_of
from tomo.pipeline.findings import findings_of, findings_of_pixels, with_lines
from tomo.pipeline.limits import Limits
from tomo.pipeline.load import LoadedScan
from tomo.pipeline.methods import method_named
from tomo.pipeline.options import OFF, Options
from tomo.pipeline.place import device_of_inference
from tomo.pipeline.refine import Refinement, priors_of
from tomo.pipeline.screen import (
    ScreenedScan,
    images_of,
    noise_of_frames,
    with_image_in_place,
    without_unusable,
)
from tomo.pipeline.stage import as_warning, timed
from tomo.scan import Scan
from tomo.selection.folds import FEW_VIEWS

UNKNOWN_GAIN = 1.0
"""Prior standard deviation of the gains' logarithms where their fit is asked for: that of `Gain`
pulls gains of 4 down by a hundredth."""


def given_absorption(scan: Scan, options: Options) -> Absorption:
    """Return the absorption that is known: the option's, and that of gas in the rig's scene."""
    return Absorption(medium=options.absorption or 0.0, extinction=extinction_of(scan.rig))


def effects_of(
    options: Options,
    known: Absorption,
    grid: VoxelGrid,
    factor: int,
    views: int,
    poses: Mapping[str, float] = MappingProxyType({}),
) -> tuple[Effect, ...]:
    """Return the effects that options let loose, for pixels ``factor`` times as wide.

    A field of gas has hundreds of nodes, which few ``views`` do not tell. ``poses`` are standard
    deviations of cameras that are refined, in pixels as recorded.
    """
    found: list[Effect] = []
    default = method_named(options.method).starts_from_default
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
            found += [Absorber(grid)] if views > FEW_VIEWS else []
        if options.fit_absorption or not given:
            found.append(Absorbing(own=True))
    if options.aligns or poses:
        found.append(Pose(Pose.sigma if options.aligns else 0.0, poses))
    return tuple(found)


def infer_effects(
    screened: ScreenedScan,
    whole: Scan,
    grid: VoxelGrid,
    options: Options,
    loaded: Sequence[LoadedScan] = (),
    cameras: Sequence[str] = (),
    progress: Progress | None = None,
) -> ScreenedScan:
    """Return the images that take part, corrected by what exceeds its null.

    ``whole`` has the held-out cameras too, ``cameras`` are to be refined. Effects are inferred
    from the ``loaded`` frames together, not from their mean, which has little fine structure.
    """
    with timed() as stage:
        if options.screen:
            screened = without_unusable(screened, whole, grid)
        with as_warning("effects of cameras and gas: not looked for", stage.warnings):
            screened = _inferred(screened, loaded, grid, options, cameras, progress)
        pixels, said = screened.pixels, screened.findings
        said = (*said, *findings_of_pixels(pixels, screened.images, said))
        findings = with_lines(said, pixels, screened.gains, screened.scan.rig.names, whole)
        stage.warnings += [one.sentence for one in together(findings)]
        refinement = screened.refinement
        if refinement is not None and refinement.asked:
            stage.warnings.append(refinement.sentence(len(loaded)))
        screened = replace(screened, findings=findings)
    return replace(screened, record=screened.record + stage.record)


def _inferred(
    screened: ScreenedScan,
    loaded: Sequence[LoadedScan],
    grid: VoxelGrid,
    options: Options,
    cameras: Sequence[str],
    progress: Progress | None,
) -> ScreenedScan:
    """Return the images corrected by what was found on a coarse copy of the frames."""
    scan, known = screened.scan, given_absorption(screened.scan, options)
    factor = factor_of(scan.rig, grid)
    whole = Observation(
        scan.rig, tuple(screened.images), tuple(screened.masks), screened.noise, grid, known,
        scan.sets_scale, device=device_of_inference(scan.rig, grid, options, methods_of(options)),
    )  # fmt: skip
    names = sorted(scan.rig.names)  # looked at by name: the rig's order changes no bit
    priors = priors_of([name for name in names if name in cameras], whole)
    effects = effects_of(options, known, grid, factor, len(names), priors)
    if len(scan.rig) < FEWEST_VIEWS or not effects:
        return screened
    frames, carving = [whole], options.skip and options.carving != OFF
    if len(loaded) > 1:
        each = [images_of(one, screened) for one in loaded]
        noise = noise_of_frames(each)
        frames = [replace(whole, images=tuple(one.images), noise=noise) for one in each]
    levels = _own_levels(screened, names, effects)
    copy = CoarseCopy.of([one.ordered(names) for one in frames], levels, factor, carving=carving)
    if copy is None:
        dark = Refinement(scan.rig, scan.rig, tuple(priors), True, grid, priors, {})
        return replace(screened, refinement=dark) if priors else screened
    first = first_fits(copy.frames, copy.active)
    if options.screen:
        moved = with_image_in_place(screened, copy, first)
        if moved is not None:
            return _inferred(moved, loaded, grid, options, cameras, progress)
    asked, own = _asked(options, effects), np.array([name in priors for name in names])
    refine = {e.name: own for e in effects if own.any() and e.name in ("pose", "gain")}
    found = infer(
        copy.frames, effects, copy.active, asked, options.screen, first, refine, progress
    )
    corrections = _corrections(found, copy, whole)
    seen = corrections.applied(whole)
    return replace(
        screened,
        scan=replace(scan, rig=seen.rig),
        images=list(seen.images),
        masks=list(seen.masks),
        noise=seen.noise,
        corrections=corrections,
        findings=(*screened.findings, *findings_of(found, copy, corrections, whole, scan.shrink)),
        gains=_gains(found, corrections, whole, copy.power),
        refinement=_refinement(found, corrections, whole, seen, priors),
        emission=_emission(found, copy, grid) if corrections.absorption.emission else None,
        limits=Limits.of(detection_limits(found), copy.frames[0]) if options.uncertainty else None,
        light_error=light_error(found) if options.uncertainty else 0.0,
    )


def _own_levels(
    screened: ScreenedScan, names: Sequence[str], effects: Sequence[Effect]
) -> NDArray[np.float64]:
    """Return the levels that single images show, where backgrounds are let loose, ``(views,)``."""
    pixels = screened.pixels
    if pixels is None or not any(effect.name == Background.name for effect in effects):
        return np.zeros(len(names))
    return np.array([pixels.background.get(name, 0.0) for name in names])


def _asked(options: Options, effects: Sequence[Effect]) -> list[str]:
    """Return the effects that options ask for, whatever their score."""
    names = ["gain", "background"] if options.fit_gain else []
    names += ["medium", "self-absorption"] if options.fit_absorption else []
    return [effect.name for effect in effects if effect.name in names]


def _corrections(found: Inference, copy: CoarseCopy, whole: Observation) -> Corrections:
    """Return what was found on the copy for images as they are."""
    names, fit, untrusted = copy.frames[0].rig.names, found.state.fits[0], {}
    lost = fit.system.images((~fit.usable).astype(np.float32))
    for view in np.flatnonzero(found.state.hidden):
        shape = whole.masks[whole.rig.names.index(names[view])].shape
        part = found.state.takes_part(int(view))
        gone = copy.enlarged(lost[view] > 0, shape) if part else np.ones(shape, bool)
        untrusted[names[view]] = gone
    seen = replace(fit.observation.in_powers_of_two(-copy.power), grid=whole.grid)
    for effect in found.effects:
        if effect.field_of is not None and found.state.values[effect.name].any():
            seen = effect.applied(seen, found.state.values[effect.name])  # on these voxels
    return Corrections(
        tuple(names),
        whole.grid,
        found.effects,
        copy.recorded(found.state.values),
        seen.absorption,
        untrusted,
    )


def _refinement(
    found: Inference,
    corrections: Corrections,
    given: Observation,
    seen: Observation,
    priors: Mapping[str, float],
) -> Refinement | None:
    """Return what was found of cameras that were asked for, or that a film has moved."""
    gains = {}
    if "gain" in corrections.values:
        values = np.exp(corrections.values["gain"][:, 0]).tolist()
        gains = dict(zip(corrections.names, values, strict=True))
    moved = {one.name for one, other in zip(given.rig, seen.rig, strict=True) if one != other}
    cameras = tuple(name for name in given.rig.names if name in moved or name in priors)
    if not (priors or (cameras and len(found.state.fits) > 1)):
        return None
    known = {name: priors.get(name, Pose.sigma) for name in cameras}
    return Refinement(
        given.rig, seen.rig, cameras, bool(priors), given.grid, known, gains, found.left_out
    )


def _emission(found: Inference, copy: CoarseCopy, grid: VoxelGrid) -> NDArray[np.float32]:
    """Return the found emission, the mean of the frames, in the voxels of a grid of its box."""
    from scipy.ndimage import zoom

    coarse = mean_volume(found.state.fits)
    ratio = np.divide(grid.shape, coarse.shape)
    return np.ldexp(zoom(coarse, ratio, order=1, mode="nearest", grid_mode=True), copy.power)


def _gains(
    found: Inference, corrections: Corrections, observation: Observation, power: int
) -> Gains | None:
    """Return the gains and backgrounds that images were corrected by."""
    free = found.state.free
    if "gain" not in free:
        return None
    rows = [corrections.names.index(name) for name in observation.rig.names]
    gain, level = (corrections.values[n][rows, 0] for n in ("gain", "background"))
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
    )
