"""What surrounds the solvers, in other units: carving, gains, alignment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from studies.stress.row import Row, relative_error, worst_of
from studies.stress.scaling_scene import EXACT, RANGE, Scaled
from studies.stress.scene import ring, scene_of
from tomo import solvers
from tomo.hull import Carving, carve
from tomo.selfcal.gains import Gains, fit_gains, solve_with_gains
from tomo.selfcal.shifts import Alignment, align_views

GAINS = (1.0, 1.2, 0.9)
"""Of the cameras, in turn: what gains are to be found."""
BESIDE = 2.0
"""Pixels that one camera looks beside where its rig says: what alignment is to find."""


def carving_rows(plain: Scaled, others: Sequence[Scaled]) -> Iterator[Row]:
    """Carve the same scene."""

    def carved(scaled: Scaled) -> Carving:
        return carve(tuple(scaled.simulated.rig), scaled.images, None, scaled.simulated.grid)

    expected = carved(plain)
    differing, settings = [], []
    for other in others:
        found = carved(other)
        differing.append(
            (other.name, float(np.count_nonzero(found.active.mask != expected.active.mask)))
        )
        for name, factor in (("threshold", other.intensities), ("smoothing", 1), ("margin", 1)):
            value, wanted = getattr(found, name) / factor, getattr(expected, name)
            settings.append((f"{name}, {other.name}", abs(value - wanted) / (wanted or 1)))
    worst, where = worst_of(differing)
    yield Row("carving: active voxels", RANGE, worst, 0, "that differ", note=where)
    worst, where = worst_of(settings)
    yield Row("carving: threshold, blur, margin", RANGE, worst, EXACT, "relative", note=where)


def gains_rows(plain: Scaled, others: Sequence[Scaled]) -> Iterator[Row]:
    """Fit the gains of unlike cameras, and what the volume is when they are corrected."""

    def fitted(scaled: Scaled) -> tuple[NDArray, Gains, Gains]:
        projector = scaled.system.projector
        gains = np.resize(GAINS, projector.n_views)
        measured = scaled.measured * np.repeat(gains, np.diff(projector.view_ptr))
        volume, found = solve_with_gains(
            lambda pixels: solvers.mlem(projector, pixels, iterations=6),
            projector,
            measured.astype(np.float32),
        )
        return volume.volume, found, fit_gains(projector, measured, volume.volume)

    volume, expected, again = fitted(plain)
    figures = []
    for other in others:
        found_volume, found, found_again = fitted(other)
        offset = (found.offset / other.intensities - expected.offset) / expected.scale
        figures += [
            (f"gain, {other.name}", relative_error(found.gain, expected.gain)),
            (f"gain error, {other.name}", relative_error(found.gain_error, expected.gain_error)),
            (f"fit, {other.name}", relative_error(found_again.gain, again.gain)),
            (f"offset, {other.name}", float(np.abs(offset).max())),
            (f"volume, {other.name}", relative_error(other.unscaled(found_volume), volume)),
        ]
    worst, where = worst_of(figures)
    yield Row("gains and offsets of cameras", RANGE, worst, EXACT, "relative", note=where)


def alignment_rows(plain: Scaled, others: Sequence[Scaled]) -> Iterator[Row]:
    """Find one camera that looks beside where its rig says."""
    finer = scene_of(ring(5, image_size=(48, 80), footprint=0.2)).simulated

    def aligned(scaled: Scaled) -> Alignment:
        scaled = replace(scaled, original=finer)
        first, *rest = scaled.simulated.rig
        rig = replace(scaled.simulated.rig, cameras=(first.shifted(BESIDE, 0.0), *rest))
        return align_views(rig, scaled.images, scaled.simulated.grid)

    expected = aligned(plain)
    figures, changed = [], []
    for other in others:
        found = aligned(other)
        figures.append((other.name, float(np.abs(found.shifts - expected.shifts).max())))
        if found.accepted != expected.accepted:
            changed.append(other.name)
    worst, where = worst_of(figures)
    length = float(np.linalg.norm(expected.shifts, axis=1).max())
    note = f"{where}; shifts up to {length:.2f} pixels found"
    yield Row("alignment: shifts of images", RANGE, worst, 1e-4, "pixels", note=note)
    yield Row(
        "alignment: whether shifts are made", RANGE, len(changed), 0, "changes",
        note=f"{'made' if expected.accepted else 'not made'} at scale 1",
    )  # fmt: skip
