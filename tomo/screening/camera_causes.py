"""What may be wrong with one camera: candidate causes, fitted and compared on held-out pixels.

Each cause changes the image that the other cameras predict: a gain multiplies it, a pointing error
moves it, a window frame hides a part. A cause is fitted on one half of the pixels, a checkerboard
of blocks, and scored by its squared error on the other half, and the other way round. Parameters
that only follow noise do not lower that error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tomo.screening.left_out_view import Explained, Image, LeftOutView
from tomo.screening.warps import Fit, Moved, motions_of, register_motions

STEPS = 32
"""Thresholds that a saturation is looked for at, and blurs: finer ones change nothing."""

NARROWEST_BLUR, WIDEST_BLUR = 1.0, 5.0
"""Standard deviations of the blurs that are tried, in pixels. Narrower ones are in focus: pixels
and voxels blur by as much, of unlike cameras differently."""


class Cause(Protocol):
    """A candidate cause."""

    def fit(self, view: LeftOutView) -> Explained | None:
        """Return the image as this cause explains it; None where it cannot be the cause."""
        ...


def _cross(view: LeftOutView, predictions: Sequence[Image]) -> tuple[float, int]:
    """Return the held-out excess of the best of several predictions, and which is best."""
    errors = np.array([[view.excess(p, half) for half in view.halves] for p in predictions])
    chosen = errors.argmin(axis=0)
    held_out = errors[chosen[0], 1] + errors[chosen[1], 0]
    return float(held_out), int(errors.sum(axis=1).argmin())


def _linear(view: LeftOutView, base: Image, direction: Image) -> tuple[float, float]:
    """Return the amount of a direction added to a prediction, and the held-out excess."""

    def amount(where: NDArray[np.bool_]) -> float:
        along = direction[where]
        energy = float(along @ along)
        return float(along @ (view.measured - base)[where]) / energy if energy > 0 else 0.0

    first, second = view.halves
    excess = view.excess(base + amount(first) * direction, second)
    excess += view.excess(base + amount(second) * direction, first)
    return amount(view.mask), excess


@dataclass(frozen=True)
class GainCause:
    """The camera is brighter or darker than the others."""

    def fit(self, view: LeftOutView) -> Explained | None:
        """Fit one factor."""
        change, excess = _linear(view, view.predicted, view.predicted)
        words = f"gain {1 + change:.3g}"
        return Explained("gain", words, {"gain": 1 + change}, 1, excess)


@dataclass(frozen=True)
class BackgroundCause:
    """A constant was added to every pixel: a dark frame left in, or stray light."""

    def fit(self, view: LeftOutView) -> Explained | None:
        """Fit one level."""
        level, excess = _linear(view, view.predicted, np.ones_like(view.predicted))
        words = f"background of {level:.3g} beside the others'"
        return Explained("background", words, {"level": level}, 1, excess)


@dataclass(frozen=True)
class SaturationCause:
    """Bright pixels were cut off."""

    def fit(self, view: LeftOutView) -> Explained | None:
        """Find the level that cuts the prediction off best."""
        top = float(view.measured[view.mask].max(initial=0.0))
        brightest = float(view.predicted[view.mask].max(initial=0.0))
        levels = np.linspace(0.15, 1.0, STEPS) * max(top, 1e-12)
        if top >= brightest:
            return None
        excess, best = _cross(view, [np.minimum(view.predicted, level) for level in levels])
        level = float(levels[best])
        words = f"saturation at {level:.3g}"
        return Explained("saturation", words, {"level": level}, 1, excess)


@dataclass(frozen=True)
class BlurCause:
    """The lens was out of focus."""

    def fit(self, view: LeftOutView) -> Explained | None:
        """Find the width of the Gaussian blur that explains the image best."""
        widths = np.linspace(NARROWEST_BLUR, WIDEST_BLUR, STEPS)
        blurred = [gaussian_filter(view.predicted, width, mode="nearest") for width in widths]
        excess, best = _cross(view, blurred)
        width = float(widths[best])
        return Explained(
            "blur", f"blur, out of focus by {width:.1f} pixels", {"pixels": width}, 1, excess
        )


@dataclass(frozen=True)
class HiddenCause:
    """A frame hides one side of the image."""

    def fit(self, view: LeftOutView) -> Explained | None:
        """Find the side and the edge of the frame that explain the image best."""
        rows, columns = view.mask.shape
        dark = view.measured**2 - (view.measured - view.predicted) ** 2
        sums, names = [], []
        for side, axis, length in (
            ("left", 1, columns),
            ("right", 1, columns),
            ("top", 0, rows),
            ("bottom", 0, rows),
        ):
            gains = np.stack([np.where(h, dark, 0).sum(axis=1 - axis) for h in view.halves])
            if side in ("right", "bottom"):
                gains = gains[:, ::-1]
            sums += list(np.cumsum(gains, axis=1).T)
            names += [(side, n + 1) for n in range(length)]
        errors = np.array(sums)  # (edges, halves), changes by hiding so many lines
        given = [view.excess(view.predicted, half) for half in view.halves]
        chosen = errors.argmin(axis=0)
        excess = sum(given) + errors[chosen[0], 1] + errors[chosen[1], 0]
        side, lines = names[int(errors.sum(axis=1).argmin())]
        words = f"hidden part, a frame over its {side} {lines} pixels"
        return Explained("hidden", words, {side: float(lines)}, 2, float(excess))


POSE = ("turn_x", "turn_y", "turn_z", "right", "down")
"""Names of the amounts of a pose: turns in radians, shifts in pixels."""


def _of_fit(
    view: LeftOutView,
    fit: Fit,
    cause: str,
    words: str,
    names: Sequence[str],
    choices: int = 0,
) -> Explained:
    """Return what a fit with a linear neighbourhood explains, each half by the other.

    ``choices`` that were made between fits count as parameters.
    """
    first, second = view.halves
    excess = view.excess(fit.refitted(view.measured, first), second)
    excess += view.excess(fit.refitted(view.measured, second), first)
    found = dict(zip(names, fit.amounts.tolist(), strict=True))
    pose = (found.get(name, 0.0) for name in POSE)
    moves = tuple(pose) if cause == "pointing" and set(names) <= set(POSE) else None
    return Explained(cause, words, found, len(fit.amounts) + choices, excess, moves)


@dataclass(frozen=True)
class MotionCause:
    """The image is moved: the camera points elsewhere, or shows another moment.

    Attributes
    ----------
    kind : str
        One of `tomo.screening.warps.KINDS`.
    cause, words : str
    """

    kind: str
    cause: str
    words: str

    def fit(self, view: LeftOutView) -> Explained | None:
        """Fit the motions."""
        motions = motions_of(self.kind, view.mask.shape)
        fit = register_motions(view.predicted, view.measured, view.mask, motions)
        others = [f"{self.kind}_{number}" for number in range(2, len(motions))]
        names = ["right", "down", *others]
        size = fit.displacement
        return _of_fit(view, fit, self.cause, self.words.format(size=size), names)


@dataclass(frozen=True)
class PoseCause:
    """The camera stands or looks elsewhere than the rig says."""

    def fit(self, view: LeftOutView) -> Explained | None:
        """Fit the pose by re-projecting the volume."""
        if view.reproject is None or view.pose_steps is None:
            return None
        fit = Moved.by(view.reproject, view.pose_steps, view.measured, view.mask, view.predicted)
        degrees = float(np.rad2deg(np.linalg.norm(fit.amounts[:3])))
        words = f"pointing, a pose {degrees:.1f} degrees off"
        return _of_fit(view, fit, "pointing", words, POSE)


@dataclass(frozen=True)
class FlippedCause:
    """The image is turned over.

    Attributes
    ----------
    words : str
    across, down : bool
    """

    words: str
    across: bool
    down: bool

    def fit(self, view: LeftOutView) -> Explained | None:
        """Compare with the prediction turned over and shifted."""
        turned = view.predicted[:: -1 if self.down else 1, :: -1 if self.across else 1]
        motions = motions_of("shift", view.mask.shape)
        fit = register_motions(turned, view.measured, view.mask, motions)
        found = _of_fit(view, fit, "mirrored", self.words, ("right", "down"), choices=2)
        if self.across and self.down:  # no mirror: half a turn
            return _turned(found, 180)
        mirrored = {"mirrored across": float(self.across), "mirrored down": float(self.down)}
        return replace(found, parameters={**found.parameters, **mirrored})


@dataclass(frozen=True)
class TurnedCause:
    """A square image is turned by a quarter.

    Attributes
    ----------
    quarters : int
        Counterclockwise quarters that the prediction is turned by.
    """

    quarters: int

    def fit(self, view: LeftOutView) -> Explained | None:
        """Compare with the turned prediction."""
        rows, columns = view.mask.shape
        if rows != columns:
            return None
        turned = np.ascontiguousarray(np.rot90(view.predicted, self.quarters))
        fit = register_motions(turned, view.measured, view.mask, motions_of("shift", (rows, rows)))
        degrees = (360 - 90 * self.quarters) % 360
        words = f"turned by {degrees} degrees clockwise"
        found = _of_fit(view, fit, "turned", words, ("right", "down"), choices=2)
        return _turned(found, degrees)


def _turned(found: Explained, degrees: int) -> Explained:
    """Return what a turn explains, with its degrees clockwise among the parameters."""
    return replace(found, cause="turned", parameters={**found.parameters, "degrees": degrees})


@dataclass(frozen=True)
class SwappedCause:
    """The image is another camera's."""

    def fit(self, view: LeftOutView) -> Explained | None:
        """Find the camera whose prediction the image resembles most."""
        if not view.others:
            return None
        excess, best = _cross(view, list(view.others.values()))
        name = list(view.others)[best]
        return Explained(
            "swapped", f"swapped, it looks like camera {name}'s", {name: 1.0}, 1, excess
        )


CAUSES: tuple[Cause, ...] = (
    GainCause(),
    BackgroundCause(),
    SaturationCause(),
    BlurCause(),
    SwappedCause(),
    FlippedCause("mirrored left to right", across=True, down=False),
    FlippedCause("mirrored upside down", across=False, down=True),
    FlippedCause("turned by 180 degrees, mirrored both ways", across=True, down=True),
    TurnedCause(1),
    TurnedCause(3),
    HiddenCause(),
    MotionCause("shift", "pointing", "pointing, a shift of {size:.1f} pixels"),
    MotionCause("roll", "pointing", "pointing, a shift and roll of {size:.1f} pixels"),
    PoseCause(),
    MotionCause("bend", "out of step", "out of step, a flame {size:.1f} pixels away"),
)
"""The candidates, those of fewer parameters first."""
