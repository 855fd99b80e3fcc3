"""What is wrong with a camera, an image or the gas, as a value: one table makes its words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Finding:
    """One thing that images say is wrong.

    Attributes
    ----------
    effect : str
        A key of `WORDS`.
    camera : str, optional
        The camera that has it; None where all share it.
    size : float
        In ``unit``; for hidden pixels their fraction.
    error : float, optional
        What exact cameras make of the same size, one standard deviation.
    unit : str
    score : float
        How far the size exceeds what exact cameras make: 1 is the limit.
    corrected : bool
        Whether the volume was made without it.
    consequence : float, optional
        What the effect changes of the camera's image, relative to it, root mean square.
    other : str, optional
        Another camera that is concerned; how an image is turned over; where gas is.
    """

    effect: str
    camera: str | None = None
    size: float = 0.0
    error: float | None = None
    unit: str = ""
    score: float = 1.0
    corrected: bool = True
    consequence: float | None = None
    other: str | None = None

    @property
    def sentence(self) -> str:
        """What was found, what it means, and what to do."""
        what = WORDS[self.effect][0]
        who = "all cameras" if self.camera is None else f"camera {self.camera}"
        text = what.format(who=who, size=self._size, other=self.other or "in the grid")
        done = "corrected" if self.corrected else "not corrected"
        if self.effect in LEFT_OUT:
            done = "left out" if self.corrected else "it still takes part"
        return f"{text}: {done}. {self.step}"

    @property
    def step(self) -> str:
        """What to do."""
        return WORDS[self.effect][1].format(camera=self.camera, other=self.other)

    @property
    def _size(self) -> str:
        if self.unit == "%":
            return f"{100 * self.size:.1f} %"
        size = f"{self.size:.2g}" if abs(self.size) < 10 else f"{self.size:.0f}"
        unit = f" {self.unit}" if self.unit else ""
        error = "" if self.error is None else f" ± {self.error:.1g}"
        return f"{size}{error}{unit}"

    def report(self) -> dict[str, Any]:
        """Return plain values."""
        return {**asdict(self), "sentence": self.sentence, "step": self.step}


LEFT_OUT = ("hidden", "scatter", "saturation", "dark")
"""Effects that are not corrected but left out."""

WORDS: Mapping[str, tuple[str, str]] = {
    "gain": (
        "{who}: its gain is {size} off what the others say",
        "Check its exposure and aperture, or write its gain into scan.yaml (corrections: gain)",
    ),
    "background": (
        "{who}: a background of {size} of the brightest light lies on the image",
        "Subtract it, see the line on the dark level",
    ),
    "pose": (
        "{who}: its pose is off, it looks {size} beside where the rig says",
        "Calibrate it again, or run with --refine-cameras",
    ),
    "magnification": (
        "{who}: its image is magnified by {size} more than the rig says",
        "Check its focal length and focus, and calibrate it again",
    ),
    "blur": (
        "{who}: its image is blurred by {size} (standard deviation): out of focus, or in motion",
        "Check its focus, and expose shorter",
    ),
    "fall-off": (
        "{who}: images darken towards their corners, by {size} there (vignetting)",
        "Take a flat field and name it in scan.yaml (corrections: flat)",
    ),
    "absorption": (
        "gas {other} absorbs: optical depth {size}",
        "If the gas is transparent, reconstruct with --no-fit-absorption; else measure it",
    ),
    "outside": (
        "the grid cuts the flame: {size} of the light comes from outside it",
        "Enlarge the grid (--lower and --upper, or --grid), or mask or subtract that light",
    ),
    "hidden": (
        "{who}: {size} of its pixels are darker than the others say: something hides the flame",
        "Look at the image beside its re-projection, and mask what is no flame (scan.yaml, "
        "corrections: mask)",
    ),
    "scatter": (
        "{who}: {size} of its pixels are brighter than any volume explains: light is reflected or "
        "scattered, or the flame is that of another moment",
        "Look at the image beside its re-projection, and mask what is no flame (scan.yaml, "
        "corrections: mask)",
    ),
    "saturation": (
        "{who}: its image is cut off at {size}",
        "Expose camera {camera} shorter",
    ),
    "dark": (
        "{who}: its image has no light: a cap, a closed shutter, or a wrong file",
        "Check camera {camera}",
    ),
    "order": (
        "{who}: its image is that of camera {other}",
        "Check the order of the files of cameras {camera} and {other}",
    ),
    "mirrored": (
        "{who}: its image is turned over ({other})",
        "Check the orientation of camera {camera}'s images",
    ),
}
"""By effect: what was found, and what to do. Fields: ``who``, ``size``, ``camera``, ``other``."""
