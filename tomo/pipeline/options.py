"""Options: everything that a user can ask of a reconstruction, each declared once.

The docstring, the command line's ``--help`` and report.json's ``settings`` are made from the
declarations below: a new option is one more field.
"""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass
from typing import Any, Self

from tomo.pipeline.checks import (
    Check,
    choice,
    comparisons,
    names,
    number,
    path,
    switch,
    text,
    whole,
)
from tomo.pipeline.methods import AUTO, method_names

OFF = "off"
BASES = ("voxel", "linear")
UNSEEN = (ZERO, NOT_A_NUMBER) = ("zero", "nan")
TRACERS = ("march", "raycast", "reference")
PROJECTORS = (AUTO, "stored", "on-the-fly")


def _option(
    default: Any, help: str, check: Check, *, expert: bool = False, metavar: str | None = None
) -> Any:
    """Declare an option: its default, its documentation, its check, and who needs it."""
    metadata = {"help": help, "check": check, "expert": expert, "metavar": metavar}
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Options:
    """Everything that a user can ask of a reconstruction.

    A value is checked where it is declared, and a ValueError names the option, what was found and
    what was expected. Numbers may be given as text, names as one text with commas.
    """

    method: str = _option(
        AUTO,
        "The reconstruction method. auto chooses how smooth and how long by predicting pixels "
        "that it leaves out.",
        choice(*method_names()),
        metavar="METHOD",
    )
    frame: str | None = _option(
        None,
        "The frame to reconstruct; the first one by default. The end of its name is enough where "
        "only one frame ends like that: 90 finds frame_090.",
        text(optional=True),
        metavar="FRAME",
    )
    frames: str | None = _option(
        None,
        "The frames of a film to reconstruct into a store, as a slice of their numbers like "
        "0:1000:2, : for all, or names with commas. One frame, --frame, is reconstructed by "
        "default.",
        text(optional=True),
        metavar="A:B:C",
    )
    key_frames: int = _option(
        5,
        "With frames: how many of them, spread evenly, settle for all what is wrong with pixels, "
        "cameras and gains, and how smooth volumes are.",
        whole(1, 1000, "1000"),
        expert=True,
        metavar="N",
    )
    refine_frames: int = _option(
        4,
        "With frames: from how many of them, spread evenly, cameras are refined together; as many "
        "others judge.",
        whole(1, 100, "100"),
        expert=True,
        metavar="N",
    )
    choose_each: bool = _option(
        False,
        "With frames: whether each block of frames chooses by itself how smooth volumes are.",
        switch(),
        expert=True,
    )
    skip_bad: bool = _option(
        False,
        "With frames: whether a frame that cannot be read or decoded is left out, and named, "
        "instead of ending the run.",
        switch(),
    )
    temporal: float | str = _option(
        AUTO,
        "With frames: how much neighbouring frames count. auto chooses by predicting views "
        "that are left out, off keeps every frame for itself, a number is the standard deviation "
        "of Gaussian weights in frames.",
        number(above=0, words=(AUTO, OFF)),
        metavar="STRENGTH",
    )
    hold_out: tuple[str, ...] = _option(
        (),
        "Cameras that are predicted from the volume and compared with their images, and that take "
        "part in nothing else.",
        names(),
        metavar="CAMERA",
    )
    iterations: int | None = _option(
        None,
        "How many iterations the method runs; its own number by default. auto chooses the number.",
        whole(0, optional=True),
        metavar="N",
    )
    basis: str = _option(
        AUTO,
        "The unknowns. voxel: emission is constant in each voxel. linear: it runs linearly "
        "between the voxels' centres, and the volume holds the voxels' means. auto: linear where "
        "that is possible.",
        choice(AUTO, *BASES),
        metavar="BASIS",
    )
    blur: float = _option(
        0.0,
        "Diameter of the discs that a lens out of focus makes of points, at the grid's centre and "
        "in the rig's length unit. 0: everything is in focus.",
        number(0),
        metavar="DIAMETER",
    )
    supersample: int = _option(
        1, "K x K rays are traced for each pixel.", whole(1, 64), metavar="K"
    )
    aperture_rays: int = _option(
        1,
        "N rays of each pixel, in all, start all over the lens' aperture and cross in the plane "
        "in focus: depth of field is modelled by the f-number, focal length and focus distance of "
        "each camera's optics in the rig. 1: lenses are pinholes.",
        whole(1, 4096, "4096"),
        metavar="N",
    )
    fresnel: bool | None = _option(
        None,
        "Whether the glass of the rig's scene takes the fraction of light that it reflects; by "
        "default as the scene says.",
        switch(optional=True),
        expert=True,
    )
    refine_cameras: tuple[str, ...] | None = _option(
        None,
        "Cameras whose poses are refined from the images; kept only where held-out rays are "
        "predicted better. all: every camera; nominal: those that the rig calls nominal; none. By "
        "default all with frames, if there are enough, and none with one frame.",
        names(optional=True),
        metavar="CAMERAS",
    )
    fit_gain: bool | None = _option(
        None,
        "Whether each camera's gain and background are fitted and corrected; by default, with "
        "method auto, where they explain the images clearly better.",
        switch(optional=True),
    )
    fit_absorption: bool | None = _option(
        None,
        "Whether absorption is fitted and corrected, by the emitting gas itself or by a medium "
        "that fills the grid; by default, with method auto, where it explains the images clearly "
        "better.",
        switch(optional=True),
    )
    absorption: float | None = _option(
        None,
        "Absorption of a medium that fills the grid, per length unit, where it is known: "
        "exp(-K s) of the light is left after a way s. It is corrected as given, and none is "
        "fitted.",
        number(0, optional=True),
        metavar="K",
    )
    learn: bool = _option(
        True,
        "Whether weights are learned in place of segment lengths, with method auto, where "
        "these leave the images unexplained and the weights predict left-out pixels better.",
        switch(),
    )
    uncertainty: int | str = _option(
        AUTO,
        "How many times the solve is repeated with new noise for the standard deviation of each "
        "voxel; 30 repeats map it, 0 is none. auto: a few, for the figures of the whole volume, "
        "after method auto alone.",
        whole(0, words=(AUTO,), but=(1,), expected="auto, 0, or 2 repeats or more"),
        metavar="N",
    )
    seed: int = _option(
        0, "The seed of everything random.", whole(0, 2**63 - 1, "2^63 - 1"), metavar="N"
    )
    compare: tuple[str, ...] = _option(
        (),
        "Further methods to run on the same rays, for the report: METHOD or METHOD:ITERATIONS.",
        comparisons(tuple(name for name in method_names() if name != AUTO)),
        expert=True,
        metavar="METHOD[:N]",
    )
    time_limit: float | None = _option(
        None,
        "Seconds after which each solver stops at its current iteration, but not before its "
        "first. Choosing the method and the repeats for the uncertainty come on top.",
        number(above=0, optional=True),
        expert=True,
        metavar="SECONDS",
    )
    skip: bool = _option(
        True,
        "Whether pixels whose rays miss the grid, and voxels that dark pixels prove empty, are "
        "left out of the system.",
        switch(),
        expert=True,
    )
    carving: float | str = _option(
        AUTO,
        "How voxels are found empty: a margin in pixels around a voxel that must be dark, auto to "
        "find the margin from the images, or off to keep every voxel.",
        number(0, words=(AUTO, OFF)),
        expert=True,
        metavar="MARGIN",
    )
    screen: bool = _option(
        True,
        "Whether bad pixels, and cameras that the others contradict, are looked for and corrected "
        "or excluded. A held-out camera never is.",
        switch(),
        expert=True,
    )
    align: bool = _option(
        True,
        "Whether images are shifted where they clearly disagree with the rig. A held-out camera "
        "is never shifted.",
        switch(),
        expert=True,
    )
    refine_prior: float | None = _option(
        None,
        "How far refined cameras may be from the rig's, as a standard deviation in pixels; from "
        "the calibration and the cameras' status by default.",
        number(above=0, optional=True),
        expert=True,
        metavar="PIXELS",
    )
    pixel_weights: bool = _option(
        True,
        "Whether pixels are weighted by their noise where it differs, as that of photons does. "
        "Applies to auto and to wernet, which starts from it.",
        switch(),
        expert=True,
    )
    unseen: str = _option(
        ZERO,
        "The value of voxels that no usable ray crosses.",
        choice(*UNSEEN),
        expert=True,
        metavar="VALUE",
    )
    tracer: str = _option(
        TRACERS[0],
        "The ray tracer of a stored matrix.",
        choice(*TRACERS),
        expert=True,
        metavar="TRACER",
    )
    projector: str = _option(
        AUTO,
        "Whether the matrix is stored, which is fastest, or computed on-the-fly, which takes "
        "little memory. auto: stored where it fits in memory.",
        choice(*PROJECTORS),
        expert=True,
        metavar="FORM",
    )
    device: str = _option(
        "cpu",
        "Where wernet and wernet-paper train, like cpu or cuda. Classic solves run on the CPU.",
        text(),
        expert=True,
        metavar="DEVICE",
    )
    encoder: str | None = _option(
        None,
        "The encoder file that wernet or wernet-paper starts from; a new one by default.",
        path(),
        expert=True,
        metavar="FILE",
    )
    freeze_encoder: bool = _option(
        False,
        "Whether the encoder is used as it is, without training.",
        switch(),
        expert=True,
    )
    save_encoder: str | None = _option(
        None,
        "A file to write the trained encoder of wernet or wernet-paper to.",
        path(),
        expert=True,
        metavar="FILE",
    )
    checkpoint: str | None = _option(
        None,
        "A file in which wernet keeps the state of its training; the command's default is "
        "checkpoint.pt in the output folder.",
        path(),
        expert=True,
        metavar="FILE",
    )
    resume: bool = _option(
        False,
        "Whether wernet goes on from the checkpoint where there is one.",
        switch(),
        expert=True,
    )

    def __post_init__(self) -> None:
        """Check every value, and keep it in the type of its declaration."""
        for option in dataclasses.fields(self):
            value = getattr(self, option.name)
            check = option.metadata["check"]
            try:
                object.__setattr__(self, option.name, check.convert(value))
            except (TypeError, ValueError, OverflowError):
                raise ValueError(
                    f"{option.name}: found {value!r}, expected {check.expected}"
                ) from None

    @property
    def rays(self) -> dict[str, int]:
        """How many rays a pixel has, as `tomo.LinearSystem.from_rig` takes it."""
        return {"supersample": self.supersample, "aperture_rays": self.aperture_rays}

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Self:
        """Return the options of a mapping such as report.json's ``settings``.

        Raises
        ------
        ValueError
            If a name is unknown, or a value is not allowed.
        """
        known = [option.name for option in dataclasses.fields(cls)]
        for name in values:
            if name not in known:
                raise ValueError(f"options: found {name!r}, expected one of {', '.join(known)}")
        return cls(**values)

    def to_mapping(self) -> dict[str, Any]:
        """Return every option by name, as JSON holds them; `from_mapping` takes it back."""
        values = {option.name: getattr(self, option.name) for option in dataclasses.fields(self)}
        return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}


def described(option: Field) -> str:
    """Return what an option means, its choices and its default, as documentation shows it."""
    said = option.metadata["help"]
    choices = option.metadata["check"].choices
    if choices:
        said += f" One of {', '.join(choices)}."
    if option.default is MISSING or option.default in (None, ()):
        return said
    return f"{said} Default: {option.default}."


def _parameters(options: type) -> str:
    """Return the numpy-style list of the options, made from their declarations."""
    lines = ["", "", "Parameters", "----------"]
    for option in dataclasses.fields(options):
        lines.append(f"{option.name} : {option.type}")
        lines += textwrap.wrap(described(option), 91, initial_indent="    ",
                               subsequent_indent="    ")  # fmt: skip
    return "\n".join(f"    {line}".rstrip() for line in lines) + "\n    "


if Options.__doc__:  # python -OO has none
    Options.__doc__ = Options.__doc__.rstrip() + _parameters(Options)
