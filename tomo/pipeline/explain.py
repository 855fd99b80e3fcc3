"""Stage 6, explain: what is wrong with the images as a whole, and what is corrected of it.

Cameras' gains and backgrounds, a medium that absorbs, and gas that absorbs its own light are
heard before any of them is corrected (`tomo.screening.hypotheses`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigs.progress import Progress
from tomo.operators.view_gains import NOTEWORTHY, Gains
from tomo.pipeline.advice import dark_levels, line_for_dark, line_for_gains
from tomo.pipeline.basis import BLOCK
from tomo.pipeline.build import WeightedSystem
from tomo.pipeline.evidence import Sample, sample_of
from tomo.pipeline.methods import AUTO, method_named
from tomo.pipeline.options import Options
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.stage import Record, timed
from tomo.pipeline.trace import through_gas
from tomo.screening.causes import AbsorbingGas, CameraGains, light_of, volume_of, with_gains_fitted
from tomo.screening.hypotheses import TRANSPARENT, Cause, Explained, Fitted, Model, explain
from tomo.selection import choose_by_left_out_pixels, left_out_residual
from tomo.selfcal.gains import estimate_gains
from tomo.uncertainty.summaries import total

GAIN, MEDIUM, SELF_ABSORPTION = "gain", "medium", "self-absorption"

FEWEST_VIEWS = 3
"""Views that an explanation needs at least: whatever is wrong, some volume reproduces two."""


@dataclass(frozen=True, eq=False)
class ExplainedScan:
    """The equations with what was corrected of them.

    Attributes
    ----------
    built : WeightedSystem
        Its ``choice`` is the default's where that was needed, and nothing was corrected after it.
    report : mapping, optional
        ``report.json``'s ``explanation``; None where none was looked for.
    record : Record
    """

    built: WeightedSystem
    report: dict[str, Any] | None = None
    record: Record = Record()


def explain_images(
    built: WeightedSystem,
    screened: ScreenedScan,
    options: Options,
    progress: Progress | None = None,
) -> ExplainedScan:
    """Find what the images ask to be corrected, and correct it."""
    with timed() as stage:
        reference, how = screened.scan.sets_scale, _how(options)
        report, causes, measured = None, _causes(options, built, reference), built.measured
        views = built.system.projector.views_with_pixels
        if causes and len(views) >= FEWEST_VIEWS and (measured > 0).any():
            sample = sample_of(built.system, measured, screened.noise, options, built.absorption)
            asked = (MEDIUM, SELF_ABSORPTION) if options.fit_absorption else ()
            given = Model(sample.system, absorption=built.absorption)
            wanted = (*asked, GAIN) if screened.is_scaled else asked  # do others differ too?
            found = explain(given, causes, sample.evidence, wanted)
            corrected = _corrected(built, found, sample, options)
            if found.best is not found.as_given and not asked:
                found, corrected = _confirmed(found, built, corrected, progress)
            built = corrected
            light, undecided = _light(found.best, how), _undecided(found, how)
            report = {**found.report(), "absorption": light, "undecided": undecided}
            if light:
                stage.warnings.append(_of_absorption(light, screened.scan.rig.length_unit))
            if undecided:
                stage.warnings.append(_of_undecided(undecided))
        if options.fit_gain and built.gains is None:
            of_views = light_of(built.system, built.absorption, how)
            gains = estimate_gains(built.system, measured, reference=reference, light=of_views)
            built = with_gains(built, gains)
        if built.gains is not None and not options.fit_gain:
            stage.warnings.append(_of_gains(built.gains, screened))
        names = screened.scan.rig.names
        apart = screened.apart.rig.names if screened.apart else ()
        levels = dark_levels(screened.screening, built.gains, names)
        fitted = built.gains is not None
        dark = line_for_dark(levels, (*names, *apart), screened.scan, fitted=fitted)
        stage.warnings += [dark] if dark else []
    return ExplainedScan(built, report, stage.record)


def _how(options: Options) -> dict[str, Any]:
    """Return the tracer and the rays a pixel that equations through other gas are made with."""
    return {**options.rays, "tracer": options.tracer}


def _corrected(
    built: WeightedSystem, found: Explained, sample: Sample, options: Options
) -> WeightedSystem:
    """Return the equations corrected by the best explanation."""
    best = found.best.model
    if best.gains is not None:
        fitted = with_gains_fitted(found.best, sample.evidence.of_all_pixels, _how(options))
        built = with_gains(built, fitted.model.gains)
    if best.absorption != built.absorption:
        emission = sample.emission(found.best.volume, built.system.projector.grid)
        system = through_gas(built.system, best.absorption, emission, options)
        built = replace(built, system=system, absorption=best.absorption)
    return built


def with_gains(built: WeightedSystem, gains: Gains | None) -> WeightedSystem:
    """Return the equations with measured pixels and weights corrected by gains, if any.

    A choice that was made for the images as given is forgotten.
    """
    if gains is None:
        return built
    projector, weights = built.system.projector, built.weights
    return replace(
        built,
        measured=gains.correct(projector, built.measured),
        weights=None if weights is None else gains.correct_weights(projector, weights),
        gains=gains,
        choice=None,
    )


def _confirmed(
    found: Explained,
    given: WeightedSystem,
    corrected: WeightedSystem,
    progress: Progress | None,
) -> tuple[Explained, WeightedSystem]:
    """Return the causes found if the default, with them, predicts left-out pixels better.

    What a quick solve does not explain, the default may: its volumes are as smooth as the images
    ask for. Nothing is corrected that makes its own prediction worse.
    """
    blocks = given.system.blocks(BLOCK)
    choice = choose_by_left_out_pixels(
        given.system.projector,
        given.measured,
        blocks=blocks,
        weights=given.weights,
        progress=progress,
    )
    residual = left_out_residual(
        corrected.system.projector,
        corrected.measured,
        choice,
        blocks=blocks,
        weights=corrected.weights,
    )
    if residual < choice.held_out_residual:
        return found, corrected
    return replace(found, best=found.as_given, refused=()), replace(given, choice=choice)


def _causes(
    options: Options, built: WeightedSystem, reference: tuple[bool, ...] | None = None
) -> list[Cause]:
    """Return the causes to hear: those asked for, or all with the default method.

    An absorption that is given is none of them: no medium is looked for beside it, and where the
    gas itself is given, no self-absorption unless it is asked for.
    """
    default = method_named(options.method).name == AUTO
    causes: list[Cause] = []
    how = _how(options)
    if options.fit_gain or (options.fit_gain is None and default):
        causes.append(CameraGains(GAIN, reference, how))
    if options.fit_absorption or (options.fit_absorption is None and default):
        known = built.absorption.extinction is not None
        if options.absorption is None and not known:
            causes.append(AbsorbingGas(MEDIUM, False, how))
        if options.fit_absorption or not known:
            causes.append(AbsorbingGas(SELF_ABSORPTION, True, how))
    if options.fit_gain and not options.fit_absorption and not default:
        return []  # fitted alone, nothing to compare with
    return causes


def _undecided(found: Explained, how: dict[str, Any]) -> dict[str, Any] | None:
    """Return the absorption that explains a little and was not corrected; None without one."""
    fitted = min(found.refused, key=lambda one: one.error, default=None)
    light = None if fitted is None or _absorbs(found.best) else _light(fitted, how)
    if fitted is None or light is None:
        return None
    taken, instead = (
        total(volume_of(one.model.system, one.volume), one.model.system.projector.grid)
        for one in (found.best, fitted)
    )
    cause = fitted.model.causes[-1]
    return {"cause": cause, **light, "total": {"taken": taken, "instead": instead}}


def _light(fitted: Fitted, how: dict[str, Any]) -> dict[str, float] | None:
    """Return the coefficients, and what became of the light; None where nothing absorbs."""
    model, volume = fitted.model, fitted.volume
    if not _absorbs(fitted):
        return None
    arriving = model.system.projector @ volume
    clear = model.system.with_absorption(TRANSPARENT, **how).projector
    sent = clear @ volume
    return {
        "medium": model.absorption.medium,
        "emission": model.absorption.emission,
        "optical_depth": model.absorption.emission * float(sent.max())
        + model.absorption.medium * float(np.mean(clear.grid.extent)),
        "light_lost": 1 - float(arriving.sum() / sent.sum()),
    }


def _absorbs(fitted: Fitted) -> bool:
    return not {MEDIUM, SELF_ABSORPTION}.isdisjoint(fitted.model.causes)


def _of_absorption(light: dict[str, float], unit: str) -> str:
    depth = f"optical depth {light['optical_depth']:.2f}, {light['light_lost']:.0%} of the light"
    if light["medium"] and light["emission"]:
        what = (
            f"self-absorption ({light['emission']:.3g} per emission and {unit}) and an absorbing "
            f"medium ({light['medium']:.3g} per {unit})"
        )
    elif light["emission"]:
        what = f"self-absorption ({light['emission']:.3g} per emission and {unit})"
    else:
        what = f"an absorbing medium ({light['medium']:.3g} per {unit})"
    return (
        f"{what}: {depth} does not arrive, and was corrected. If the gas is transparent, "
        "reconstruct with --no-fit-absorption"
    )


def _of_undecided(found: dict[str, Any]) -> str:
    what = f"{found['cause']} of optical depth {found['optical_depth']:.2f}"
    taken, instead = found["total"]["taken"], found["total"]["instead"]
    return (
        f"the images do not tell whether the gas absorbs: with {what} left-out pixels are "
        f"predicted a little better, and the total emission would be {instead:.3g} instead of "
        f"{taken:.3g}. Transparent gas was taken; for the other answer reconstruct with "
        "--fit-absorption"
    )


def _of_gains(fitted: Gains, screened: ScreenedScan) -> str:
    """Return the line on gains and backgrounds, with the line of a scan.yaml for the gains."""
    gains, scan = screened.gains(fitted) or fitted, screened.scan
    largest = float(np.abs(gains.offset).max()) / gains.scale
    found = []
    if gains.disagreement > NOTEWORTHY or largest <= NOTEWORTHY:
        found.append(f"the cameras' gains differ by {gains.disagreement:.1%}")
    if largest > NOTEWORTHY:
        found.append(f"images have a background of up to {largest:.1%} of the brightest pixel")
    line = line_for_gains(gains, scan.rig.names, scan.corrections)
    advice = (
        f"To have it in the scan, write into scan.yaml: {line}"
        f"{'. It replaces those for single cameras' if screened.is_scaled else ''}"
        if line
        else "See report.json, gains, and check exposures and dark frames"
    )
    return f"{', and '.join(found)}: this was fitted and corrected. {advice}"
