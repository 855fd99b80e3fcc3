"""Stage 5, explain: what is wrong with the images as a whole, and what is corrected of it.

Cameras' gains and backgrounds, a medium that absorbs, and gas that absorbs its own light are
heard before any of them is corrected (`tomo.screening.hypotheses`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.operators import Absorption, LinearSystem
from tomo.operators.view_gains import NOTEWORTHY, Gains
from tomo.pipeline.advice import lines_for_gains
from tomo.pipeline.basis import BLOCK
from tomo.pipeline.evidence import evidence_of, smooth
from tomo.pipeline.methods import AUTO, method_named
from tomo.pipeline.options import Options
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.stage import Record, timed
from tomo.pipeline.trace import TracedScan
from tomo.scan import Scan
from tomo.screening.causes import AbsorbingGas, CameraGains, volume_of
from tomo.screening.hypotheses import TRANSPARENT, Cause, Explained, Model, explain
from tomo.selection import Choice, choose_by_left_out_pixels, left_out_residual
from tomo.selfcal.gains import estimate_gains

GAIN, MEDIUM, SELF_ABSORPTION = "gain", "medium", "self-absorption"

FEWEST_VIEWS = 3
"""Views that an explanation needs at least: whatever is wrong, some volume reproduces two."""


@dataclass(frozen=True, eq=False)
class ExplainedScan:
    """The rays and pixels with what was corrected of them.

    Attributes
    ----------
    system : LinearSystem
        In the voxel basis, through the gas that absorbs.
    measured : (pixels,) float32
        Corrected by the gains.
    gains : Gains, optional
        None where they were not corrected.
    absorption : Absorption
    report : mapping, optional
        ``report.json``'s ``explanation``; None where none was looked for.
    choice : Choice, optional
        That of the default for the images as given, pixels weighing alike, in the linear basis
        where that is possible; None where it was not needed.
    record : Record
    """

    system: LinearSystem
    measured: NDArray[np.float32]
    gains: Gains | None = None
    absorption: Absorption = TRANSPARENT
    report: dict[str, Any] | None = None
    choice: Choice | None = None
    record: Record = Record()


def explain_images(traced: TracedScan, screened: ScreenedScan, options: Options) -> ExplainedScan:
    """Find what the images ask to be corrected, and correct it."""
    with timed() as stage:
        system, measured, gains = traced.system, traced.measured, None
        absorption, report, choice = TRANSPARENT, None, None
        causes = _causes(options)
        views = np.count_nonzero(np.diff(system.projector.view_ptr))
        if causes and views >= FEWEST_VIEWS and (measured > 0).any():
            evidence, sample = evidence_of(system, measured, screened.noise, options)
            asked = (MEDIUM, SELF_ABSORPTION) if options.fit_absorption else ()
            found = explain(Model(sample), causes, evidence, asked)
            if not asked:
                found, choice = _confirmed(found, sample, traced, options)
            gains, absorption = found.best.model.gains, found.best.model.absorption
            how = {"supersample": options.supersample, "tracer": options.tracer}
            light = _light(found, how)
            report = {**found.report(), "absorption": light}
            if absorption:
                volume = volume_of(sample, found.best.volume)
                system = system.with_absorption(absorption, volume, **how)
                stage.warnings.append(_of_absorption(light, screened.scan.rig.length_unit))
        if options.fit_gain and gains is None:
            gains = estimate_gains(system.projector, measured)
        if gains is not None:
            measured, choice = gains.correct(system.projector, measured), None
            stage.warnings += [] if options.fit_gain else [_of_gains(gains, screened.scan)]
    return ExplainedScan(system, measured, gains, absorption, report, choice, stage.record)


def _confirmed(
    found: Explained, sample: LinearSystem, traced: TracedScan, options: Options
) -> tuple[Explained, Choice | None]:
    """Return the causes found if the default, with them, predicts left-out pixels better.

    What a quick solve does not explain, the default may: its volumes are as smooth as the images
    ask for. Nothing is corrected that makes its own prediction worse. The choice for the images
    as given comes second where these stay as they are.
    """
    best = found.best.model
    if not best.causes:
        return found, None
    system, measured = smooth(traced.system, options), traced.measured
    blocks = system.blocks(BLOCK)
    given = choose_by_left_out_pixels(system.projector, measured, blocks=blocks)
    if best.absorption:
        system = system.with_absorption(
            best.absorption,
            volume_of(sample, found.best.volume),
            supersample=options.supersample,
            tracer=options.tracer,
        )
    if best.gains is not None:
        measured = best.gains.correct(system.projector, measured)
    corrected = left_out_residual(system.projector, measured, given, blocks)
    if corrected < given.held_out_residual:
        return found, None
    return replace(found, best=found.as_given), given


def _causes(options: Options) -> list[Cause]:
    """Return the causes to hear: those asked for, or all with the default method."""
    default = method_named(options.method).name == AUTO
    causes: list[Cause] = []
    if options.fit_gain or (options.fit_gain is None and default):
        causes.append(CameraGains(GAIN))
    if options.fit_absorption or (options.fit_absorption is None and default):
        how = options.tracer, options.supersample
        causes.append(AbsorbingGas(MEDIUM, False, *how))
        causes.append(AbsorbingGas(SELF_ABSORPTION, True, *how))
    if options.fit_gain and not options.fit_absorption and not default:
        return []  # fitted alone, nothing to compare with
    return causes


def _light(found: Explained, how: dict[str, Any]) -> dict[str, float] | None:
    """Return the coefficients, and what became of the light; None where nothing absorbs."""
    model, volume = found.best.model, found.best.volume
    if not model.absorption:
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


def _of_gains(gains: Gains, scan: Scan) -> str:
    """Return the line on gains and backgrounds, with lines of a scan.yaml that correct them."""
    largest = float(np.abs(gains.offset).max()) / gains.scale
    found = []
    if gains.disagreement > NOTEWORTHY or largest <= NOTEWORTHY:
        found.append(f"the cameras' gains differ by {gains.disagreement:.1%}")
    if largest > NOTEWORTHY:
        found.append(f"images have a background of up to {largest:.1%} of the brightest pixel")
    lines = lines_for_gains(gains, scan.rig.names, scan.corrections)
    advice = (
        f"To have it in the scan, write into scan.yaml: {' and '.join(lines)}"
        if lines
        else "See report.json, gains, and check exposures and dark frames"
    )
    return f"{', and '.join(found)}: this was fitted and corrected. {advice}"
