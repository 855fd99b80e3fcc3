"""Options: everything that a user can ask of a reconstruction, each declared once.

The docstring, the command line's ``--help`` and report.json's ``settings`` are made from the
declarations below: a new option is one more field.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

from tomo.pipeline.declared import (
    Declared,
    choice,
    comparisons,
    device,
    documented,
    names,
    number,
    option,
    path,
    switch,
    text,
    whole,
)
from tomo.pipeline.methods import AUTO, method_names

OFF = "off"
BASES = ("voxel", "linear")
TRACERS = ("march", "raycast", "reference")
PROJECTORS = (AUTO, "stored", "on-the-fly")

FRAMES = "Frames and films"
CAMERAS = "Cameras and lenses"
LIGHT = "Light, gas and pixels"
TRUST = "How far to trust it"
SOLVING = "Unknowns and solving"
"""Topics of the help."""


@documented
@dataclass(frozen=True)
class Options(Declared):
    """Everything that a user can ask of a reconstruction.

    A value is checked where it is declared, and a ValueError names the option, what was found and
    what was expected. Numbers may be given as text, names as one text with commas.

    The command's ``--scale N`` and ``--channel`` change the scan: ``scan.scaled(N)`` and
    `tomo.Scan.of_channel`.
    """

    method: str = option(
        AUTO,
        "The reconstruction method. auto chooses how smooth and how long by predicting pixels "
        "that it leaves out.",
        choice(*method_names()),
        metavar="METHOD",
    )
    frame: str | None = option(
        None,
        "The frame to reconstruct; the first one by default. The end of its name is enough where "
        "only one frame ends like that: 90 finds frame_090.",
        text(),
        topic=FRAMES,
        metavar="FRAME",
    )
    frames: str | None = option(
        None,
        "The frames of a film to reconstruct into a store, as a slice of their numbers like "
        "0:1000:2, : for all, or names with commas. One frame, --frame, is reconstructed by "
        "default.",
        text(),
        topic=FRAMES,
        metavar="A:B:C",
    )
    temporal: float | str = option(
        AUTO,
        "With frames: how much neighbouring frames count. auto chooses by predicting views "
        "that are left out, off keeps every frame for itself, a number is the standard deviation "
        "of Gaussian weights in frames.",
        number(above=0, words=(AUTO, OFF)),
        topic=FRAMES,
        metavar="STRENGTH",
    )
    skip_bad: bool = option(
        False,
        "With frames: whether a frame that cannot be read or decoded is left out, and named, "
        "instead of ending the run.",
        switch(),
        topic=FRAMES,
    )
    key_frames: int = option(
        5,
        "With frames: how many of them, spread evenly, settle for all what is wrong with pixels, "
        "cameras and gains, where cameras are refined to, and how smooth volumes are.",
        whole(1, 1000),
        topic=FRAMES,
    )
    refine_cameras: tuple[str, ...] | None = option(
        None,
        "Cameras whose poses, focal lengths and gains are refined from the images; kept only "
        "where left-out pixels are predicted better. all: every camera; nominal: those that the "
        "rig calls nominal. Others, by default all, are moved where images contradict the rig; "
        "none, alone or with others: no other camera is moved.",
        names(optional=True),
        topic=CAMERAS,
        metavar="CAMERAS",
    )
    supersample: int = option(
        1,
        "K x K rays are traced for each pixel.",
        whole(1, 64),
        topic=CAMERAS,
        metavar="K",
    )
    aperture_rays: int = option(
        1,
        "N rays of each pixel, in all, start all over the lens' aperture and cross in the plane "
        "in focus: depth of field is modelled by the f-number, focal length and focus distance of "
        "each camera's optics in the rig. 1: lenses are pinholes.",
        whole(1, 4096),
        topic=CAMERAS,
    )
    blur: float = option(
        0.0,
        "Diameter of the discs that a lens out of focus makes of points, at the grid's centre and "
        "in the rig's length unit. 0: everything is in focus.",
        number(0),
        topic=CAMERAS,
        metavar="DIAMETER",
    )
    screen: bool = option(
        True,
        "Whether bad pixels, and what is wrong with images and light, are looked for and "
        "corrected or left out. A held-out camera never is.",
        switch(),
        topic=LIGHT,
    )
    fit_gain: bool | None = option(
        None,
        "Whether each camera's gain and background are fitted and corrected; by default where "
        "they exceed what exact cameras make. Where refused, wernet cannot learn gains either.",
        switch(optional=True),
        topic=LIGHT,
    )
    fit_absorption: bool | None = option(
        None,
        "Whether absorption is fitted and corrected, by the emitting gas itself or by a medium "
        "that fills the grid; by default, with method auto or wernet, where it exceeds what "
        "transparent gas makes. Where refused, wernet cannot learn it either.",
        switch(optional=True),
        topic=LIGHT,
    )
    absorption: float | None = option(
        None,
        "Absorption of a medium that fills the grid, per length unit, where it is known: "
        "exp(-K s) of the light is left after a way s. It is corrected as given, and none is "
        "fitted.",
        number(0, optional=True),
        topic=LIGHT,
        metavar="K",
    )
    hold_out: tuple[str, ...] = option(
        (),
        "Cameras that are predicted from the volume and compared with their images, and that take "
        "part in nothing else.",
        names(),
        topic=TRUST,
        metavar="CAMERA",
    )
    uncertainty: int | str = option(
        AUTO,
        "How many times the solve is repeated with new noise for the standard deviation of each "
        "voxel; 30 repeats map it, 0 is none. auto: a few, for the figures of the whole volume, "
        "after method auto alone.",
        whole(0, words=(AUTO,), but=(1,), expected="auto, 0, or 2 repeats or more"),
        topic=TRUST,
    )
    peak: float | None = option(
        None,
        "What PSNR and SSIM take for the largest value of images, in their unit: 1 is the full "
        "scale of integers. By default the scan's, else the brightest measured pixel.",
        number(above=0, optional=True),
        topic=TRUST,
        metavar="VALUE",
    )
    compare: tuple[str, ...] = option(
        (),
        "Further methods to run on the same rays, for the report: METHOD or METHOD:ITERATIONS.",
        comparisons(tuple(name for name in method_names() if name != AUTO)),
        topic=TRUST,
        metavar="METHOD[:N]",
    )
    iterations: int | None = option(
        None,
        "How many iterations the method runs; its own number by default. auto chooses the number.",
        whole(0, optional=True),
        topic=SOLVING,
    )
    time_limit: float | None = option(
        None,
        "Seconds after which each solver stops at its current iteration, but not before its "
        "first. Choosing the method and the repeats for the uncertainty come on top.",
        number(above=0, optional=True),
        topic=SOLVING,
        metavar="SECONDS",
    )
    seed: int = option(
        0,
        "The seed of everything random.",
        whole(0, 2**63 - 1),
        topic=SOLVING,
    )
    basis: str = option(
        AUTO,
        "The unknowns. voxel: emission is constant in each voxel. linear: it runs linearly "
        "between the voxels' centres, and the volume holds the voxels' means. auto: linear where "
        "that is possible.",
        choice(AUTO, *BASES),
        topic=SOLVING,
        metavar="BASIS",
    )
    skip: bool = option(
        True,
        "Whether pixels whose rays miss the grid, and voxels that dark pixels prove empty, are "
        "left out of the system.",
        switch(),
        topic=SOLVING,
    )
    carving: float | str = option(
        AUTO,
        "How voxels are found empty: a margin in pixels around a voxel that must be dark, auto to "
        "find the margin from the images, or off to keep every voxel.",
        number(0, words=(AUTO, OFF)),
        topic=SOLVING,
        metavar="MARGIN",
    )
    projector: str = option(
        AUTO,
        "Whether the matrix is stored, which is fastest, or computed on-the-fly, which takes "
        "little memory. auto: stored where it fits in memory.",
        choice(*PROJECTORS),
        topic=SOLVING,
        metavar="FORM",
    )
    tracer: str = option(
        TRACERS[0],
        "The ray tracer of a stored matrix.",
        choice(*TRACERS),
        topic=SOLVING,
        metavar="TRACER",
    )
    device: str = option(
        "cpu",
        "Where images are projected, and where wernet and wernet-paper train: cpu, cuda, or "
        "cuda:N, the device of that number. auto: a device where there is one and the problem is "
        "large, else the CPU. art, mart and wernet go through the matrix's entries on the CPU.",
        device(),
        topic=SOLVING,
        metavar="DEVICE",
    )
    wernet_settings: str | None = option(
        None,
        "Network and training of wernet or wernet-paper: a YAML file with fields of "
        "WernetSettings or PaperSettings, and of LearningFiles: the encoder to start from or to "
        "write, the checkpoint to go on from. Or one of those that come along: paper, paper-text, "
        "the paper's own figures.",
        path(),
        topic=SOLVING,
    )

    @classmethod
    def quick(cls, **asked: Any) -> Self:
        """Return the options of a preview: solved as the scan stands, in seconds.

        What is wrong with pixels, cameras and gas is not looked for, and nothing is said of the
        uncertainty. A preview also has larger pixels and voxels, see `tomo.preview`.

        Examples
        --------
        >>> Options.quick(frame="7").uncertainty
        0
        """
        quick = {
            "screen": False,
            "refine_cameras": ("none",),
            "fit_gain": False,
            "fit_absorption": False,
        }
        return cls.from_mapping({**quick, "uncertainty": 0, **asked})

    @property
    def rays(self) -> dict[str, int]:
        """How many rays a pixel has, as `tomo.LinearSystem.from_rig` takes it."""
        return {"supersample": self.supersample, "aperture_rays": self.aperture_rays}

    @property
    def aligns(self) -> bool:
        """Whether cameras that are not to be refined are moved where images contradict them."""
        return "none" not in (self.refine_cameras or ())

    @property
    def refused(self) -> tuple[str, ...]:
        """The effects that are not to be corrected, nor learned: asked off, or known."""
        known = self.fit_absorption is False or self.absorption is not None
        return ("gain",) * (self.fit_gain is False) + ("absorption",) * known
