"""Scaling: other units of length or intensity change the volume by their factor, nothing else.

Emission is per unit of length: with all lengths times k and the images as they are, it is 1/k of
what it was.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from studies.common.scans import reconstructed
from studies.common.study import Request, Tables
from studies.stress.row import COLUMNS, Row, measured, relative_error, worst_of
from studies.stress.scaling_scene import EXACT, FACTORS, RANGE, Scaled
from studies.stress.scene import BY_PIXEL, scene, solved
from tomo import solvers
from tomo.operators.operator import ProjectionOperator
from tomo.pipeline import Reconstruction
from tomo.selection import choose_by_left_out_pixels

__all__ = ["COLUMNS", "run"]


def run(request: Request) -> Tables:
    """Measure the rows of this part."""
    return measured(_rows(request))


def _rows(request: Request) -> Iterator[Row]:
    quick, progress = request.size != "full", request.progress
    factors = FACTORS[::3] if quick else FACTORS
    plain = Scaled(scene(noise=0.02).simulated)
    others = [replace(plain, lengths=factor) for factor in factors]
    others += [replace(plain, intensities=factor) for factor in factors]
    others += [replace(plain, lengths=factors[0], intensities=factors[-1])]
    parts = (
        _solvers(plain, others, quick),
        _default(plain, others),
    )
    for number, part in enumerate(parts):
        progress(number, len(parts), "scaling")
        yield from part
    progress(len(parts), len(parts), "")


def _solvers(plain: Scaled, others: Sequence[Scaled], quick: bool) -> Iterator[Row]:
    for what in ("lengths", "intensities"):
        figures = []
        for method in solvers.METHODS:
            forms = ["system"] if quick or method in BY_PIXEL else ["system", "on_the_fly"]
            for form in forms:
                expected = solved(method, _form(plain, form), plain.measured).volume
                for other in others:
                    if getattr(other, what) == 1:
                        continue
                    found = solved(method, _form(other, form), other.measured).volume
                    error = relative_error(other.unscaled(found), expected)
                    figures.append((f"{method}, {form}, {other.name}", error))
        worst, where = worst_of(figures)
        unit = "relative to scale 1"
        yield Row(f"{what}, every classic method", RANGE, worst, EXACT, unit, note=where)


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
    worst, where = worst_of(figures)
    yield Row(
        "default method, through files", RANGE, worst, EXACT, "relative to scale 1", note=where
    )
    yield Row(
        "what the default method chooses: method, width, iterations, active voxels, warnings",
        RANGE,
        len(changed),
        0,
        "changes",
        note="; ".join(changed[:3]),
    )
    residual = choose_by_left_out_pixels(plain.system.projector, plain.measured).held_out_residual
    worst, where = worst_of(
        (
            other.name,
            abs(
                choose_by_left_out_pixels(other.system.projector, other.measured).held_out_residual
                / residual
                - 1
            ),
        )
        for other in others
    )
    yield Row("residual of pixels left out", RANGE, worst, EXACT, "relative", note=where)


def _form(scaled: Scaled, form: str) -> ProjectionOperator:
    return scaled.on_the_fly if form == "on_the_fly" else scaled.system.projector


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
