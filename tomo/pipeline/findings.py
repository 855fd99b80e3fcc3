"""What images say is wrong, as findings, and the corrections of the scan that some come to."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike
from tomo._compute.reductions import dot, norm
from tomo.inference.finding import Finding
from tomo.inference.fit import Fit
from tomo.inference.infer import Inference
from tomo.inference.steps import fraction_outside, mean_volume
from tomo.measurement.pixel_check import PixelCheck
from tomo.model import Absorber, Background, Blur, Corrections, Gain, Observation
from tomo.model.effect import Effect
from tomo.operators.view_gains import NOTEWORTHY, Gains
from tomo.pipeline.coarse import CoarseCopy
from tomo.scan import Scan
from tomo.scan.advice import correction_line
from tomo.scan.images import Images

MANY = 1e-3
"""Fraction of a view's pixels that are outliers, above which they are said: fewer are usual."""


def findings_of(
    found: Inference, copy: CoarseCopy, corrections: Corrections, whole: Observation, shrink: int
) -> list[Finding]:
    """Return what is said of effects let loose unasked, the gravest first, in recorded pixels."""
    said: list[Finding] = []
    for effect in found.effects:
        values = corrections.values[effect.name]
        loose = found.state.free[effect.name].any(axis=1) | (effect.name == Background.name)
        loose &= ~found.refined.get(effect.name, np.zeros(len(loose), bool))
        if (loose[:, None] & (values != 0)).any():
            said += _of_effect(effect, found, copy, values * loose[:, None], whole, shrink)
    said += _left_out(found, corrections)
    if found.state.has_outside:
        score, size = found.scores["outside"].max(), fraction_outside(found.state.fits)
        said.append(
            Finding("outside", None, size, None, "%", float(score), False, consequence=size)
        )
    return sorted(said, key=lambda one: -one.score)


def _of_effect(
    effect: Effect,
    found: Inference,
    copy: CoarseCopy,
    values: NDArray[np.float64],
    whole: Observation,
    shrink: int,
) -> Iterator[Finding]:
    """Yield an effect with ``values`` ``(views, parameters)``, lengths in pixels as recorded."""
    unit = copy.units.get(effect.name, 1.0)
    scores = found.scores.get(effect.name, np.zeros(len(values)))
    changes = _changes(effect, found.state.fits, values / unit)
    errors = unit * found.spread.get(effect.name, np.full(values.shape[1], np.nan))
    if effect.shared:
        name, percent = ("absorption", "") if effect.of_gas else (effect.name, "%")
        size, error, where = float(values[0, 0]), _known(errors[0]), None
        if isinstance(effect, Absorber):
            size, where = effect.seen_from(values[0], mean_volume(found.state.fits))
            error = None
        of_all = norm(changes) / math.sqrt(len(changes))
        yield Finding(
            name, None, size, error, percent, float(scores.max()),
            consequence=of_all, other=where,
        )  # fmt: skip
        return
    for view in np.flatnonzero(values.any(axis=1)):
        camera = whole.rig[copy.frames[0].rig.names[view]]
        name, size, error, of = _size(effect.name, values[view], errors, camera, whole)
        pixel = shrink if of == "px" else 1
        yield Finding(
            name, camera.name, float(pixel * size), _known(pixel * error), of,
            float(scores[view]), consequence=float(changes[view]),
        )  # fmt: skip


def _left_out(found: Inference, corrections: Corrections) -> Iterator[Finding]:
    """Yield the views of which pixels were left out that no effect explains."""
    for view in np.flatnonzero(found.state.hidden):
        name = corrections.names[view]
        fraction = float(corrections.untrusted[name].mean())
        if fraction > 0:
            change, score = _without_pixels(found.state.fits, int(view)), found.scores["hidden"]
            what = "scatter" if change > 0 else "hidden"
            if not found.state.takes_part(int(view)):
                what = "disagreement"
            yield Finding(
                what, name, fraction, None, "%", float(score[view]), consequence=abs(change)
            )


def findings_of_pixels(
    pixels: PixelCheck | None, images: Images, said: Sequence[Finding]
) -> list[Finding]:
    """Return what single ``images`` show, as far as nothing is ``said`` of it."""
    if pixels is None:
        return []
    known = {(one.effect, one.camera) for one in said}
    dark = {one.camera for one in said if one.effect == "dark"}
    brightest = max([float(image.max(initial=0.0)) for image in images] or [0.0]) or 1.0
    found = [Finding("saturation", name, level) for name, level in pixels.saturated.items()]
    for effect, levels in (("background", pixels.background), ("below zero", pixels.below_zero)):
        found += [
            Finding(effect, name, level / brightest, None, "%", corrected=False)
            for name, level in levels.items()
            if (effect, name) not in known and name not in dark
        ]
    fractions = {name: n / max(pixels.usable[name], 1) for name, n in pixels.outliers.items()}
    return found + [
        Finding("bad pixels", name, fraction, None, "%")
        for name, fraction in fractions.items()
        if fraction > MANY
    ]


def _changes(
    effect: Effect, fits: Sequence[Fit], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return what an effect changes of each view's images, relative to these, ``(views,)``."""
    changed, light = np.zeros((2, len(values)))
    for fit in fits:
        at, ptr = fit.prediction, fit.system.projector.view_ptr
        changed += _squares(at.changed_by(effect, values), ptr)
        light += _squares(at.pixels, ptr)
    return np.sqrt(changed / np.maximum(light, 1e-300))


def _squares(pixels: NDArray[np.float64], ptr: NDArray) -> NDArray[np.float64]:
    """Return the sum of squares of every view, ``(views,)``."""
    return np.array([dot(pixels[a:b], pixels[a:b]) for a, b in pairwise(ptr.tolist())])


def _without_pixels(fits: Sequence[Fit], view: int) -> float:
    """Return what pixels left out change of a view; above zero where they are brighter."""
    light = changed = predicted = 0.0
    for fit in fits:
        own = slice(*fit.system.projector.view_ptr[view : view + 2])
        lost = np.where(fit.usable[own], 0.0, fit.residual[own])
        light += float(lost.sum())
        changed += dot(lost, lost)
        predicted += norm(fit.measured[own] - fit.residual[own]) ** 2
    return math.copysign(math.sqrt(changed / max(predicted, 1e-300)), light)


def _size(
    effect: str,
    values: NDArray[np.float64],
    errors: NDArray[np.float64],
    camera: CameraLike,
    whole: Observation,
) -> tuple[str, float, float, str]:
    """Return what an effect of one camera is called, its size, its error and their unit."""
    if effect == Gain.name:
        gain = math.exp(values[0])
        return effect, gain - 1, gain * errors[0], "%"
    if effect == Background.name:
        return effect, values[0] / whole.brightest, errors[0] / whole.brightest, "%"
    if effect == Blur.name:
        size = math.sqrt(values[0])
        return effect, size, errors[0] / (2 * size), "px"
    if abs(values[3]) > np.abs(np.delete(values, 3)).max():
        radius = min(camera.image_size) / 2
        return "magnification", math.expm1(values[3] / radius), errors[3] / radius, "%"
    size = norm(values)
    return effect, size, norm(values * errors) / size, "px"


def _known(error: float) -> float | None:
    return None if math.isnan(error) else float(error)


ALIKE = 0.1
"""Relative spread of the cameras' levels up to which one number stands for all of them."""


def with_lines(
    findings: Sequence[Finding],
    pixels: PixelCheck | None,
    gains: Gains | None,
    names: Sequence[str],
    scan: Scan,
) -> tuple[Finding, ...]:
    """Return findings on gains and backgrounds with what corrects them, in the way of the scan.

    ``gains`` are those that images of ``names`` were corrected by. The whole scan's corrections
    are in the images already: lines are in its own numbers.
    """
    own: dict[str, list[str]] = {"background": [], "gain": []}
    for one in findings:
        if one.effect in own and one.camera and abs(one.size) > NOTEWORTHY:
            own[one.effect].append(one.camera)
    levels, factors = dict(pixels.background) if pixels else {}, {}
    if gains is not None:
        levels |= dict(zip(names, gains.offset.tolist(), strict=True))
        factors = dict(zip(names, (1 / gains.gain).tolist(), strict=True))
    lines = {
        "background": _line_for_dark({n: levels[n] for n in own["background"]}, scan),
        "gain": _line_for_gain({n: factors[n] for n in own["gain"]}, scan),
    }
    return tuple(replace(one, line=lines.get(one.effect), way=scan.way) for one in findings)


def _line_for_dark(levels: Mapping[str, float], scan: Scan) -> str | None:
    """Return the line that subtracts levels; None where darks are images, or units are others."""
    names, corrections = scan.rig.names, scan.corrections
    given = {name: corrections.of("dark", name) for name in names}
    known = {name: 0.0 if dark is None else dark for name, dark in given.items()}
    numbers = all(isinstance(one, int | float) for one in known.values())
    flat = any(corrections.of("flat", name) is not None for name in levels)
    if not levels or not numbers or flat or scan.radiometry is not None:
        return None
    dark = {name: float(level) for name, level in known.items() if level}
    for name in sorted(levels, key=lambda name: -levels[name]):
        factor = corrections.of("gain", name) or 1.0
        dark[name] = dark.get(name, 0.0) + levels[name] / factor
    values = np.array(list(dark.values()))
    alike = len(dark) == len(names) > 1 and np.ptp(values) <= ALIKE * abs(values.mean())
    return correction_line(scan.way, "dark", float(values.mean()) if alike else dark)


def _line_for_gain(factors: Mapping[str, float], scan: Scan) -> str | None:
    """Return the line that multiplies images by further factors."""
    given = {name: scan.corrections.of("gain", name) or 1.0 for name in factors}
    found = {name: given[name] * factor for name, factor in factors.items()}
    return correction_line(scan.way, "gain", found) if found else None
