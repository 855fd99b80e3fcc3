"""The page's controls, made of what there is to show."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from tomo.draw.scene import ColourScale
from tomo.grid import VoxelGrid
from tomo.view.colours import COLOURS
from tomo.view.content import Content
from tomo.view.rendering import INTEGRAL
from tomo.view.volume_layer import AXES, PICTURES

if TYPE_CHECKING:
    import viser

FRAMES_A_SECOND = 5
LOOKS = VOLUME, CAMERAS = "volume", "cameras"
_THRESHOLD, _INNER = 15.0, 50.0  # percent of the peak: as in pages of volumes
_PLANE_STEPS = 200


@dataclass(eq=False)
class Controls:
    """Handles of the controls, by what they do; None where there is nothing to control.

    Attributes
    ----------
    place, playing, speed
        The frame, whether the film runs, frames a second.
    words
        What is shown, in numbers.
    look_at
        Buttons that move the eye, see `LOOKS`.
    threshold, inner, with_surface
        Percent of the peak; whether the surfaces are shown.
    coarse
        Whether surfaces have few triangles while the eye moves.
    planes : list of (is shown, world coordinate)
    along
        The picture along the line of sight.
    colours, span
        The colour map; the percent of the peak at its ends.
    layers : dict
        The rig's layers.
    camera
        The camera to compare.
    """

    place: Any = None
    playing: Any = None
    speed: Any = None
    words: Any = None
    look_at: Any = None
    threshold: Any = None
    inner: Any = None
    with_surface: Any = None
    coarse: Any = None
    planes: list = field(default_factory=list)
    along: Any = None
    colours: Any = None
    span: Any = None
    layers: dict = field(default_factory=dict)
    camera: Any = None

    def scale(self, peak: float) -> ColourScale:
        """Return the chosen colour scale of a volume's values."""
        lower, upper = (peak * percent / 100 for percent in self.span.value)
        return ColourScale("", lower, max(upper, lower + 1e-6 * peak), self.colours.value)


def add_controls(
    gui: viser.GuiApi, content: Content, layers: tuple[str, ...], shown: dict[str, bool]
) -> Controls:
    """Add the controls of a content to the page."""
    made = Controls()
    if content.n_frames > 1:
        with gui.add_folder("Film" if content.frames else "Images"):
            made.place = gui.add_slider("frame", 0, content.n_frames - 1, 1, 0)
            made.playing = gui.add_checkbox("play", initial_value=False)
            made.speed = gui.add_slider("frames/s", 1, 20, 1, FRAMES_A_SECOND)
    made.words = gui.add_markdown("")
    if content.rig is not None and content.box is not None:
        made.look_at = gui.add_button_group("look at", LOOKS)
    if content.scan is not None:
        with gui.add_folder("Camera"):
            names = ("none", *content.scan.rig.names)
            hint = "a click on a camera chooses it, too"
            made.camera = gui.add_dropdown("compare", names, initial_value="none", hint=hint)
    if content.frames is not None and content.grid is not None:
        _volume_controls(gui, content.grid, content.length_unit, made)
    if layers:
        with gui.add_folder("Shown"):
            for layer in layers:
                made.layers[layer] = gui.add_checkbox(layer, shown.get(layer, True))
    for note in content.notes:
        gui.add_markdown(f"*{note}*")
    return made


def _volume_controls(gui: viser.GuiApi, grid: VoxelGrid, length_unit: str, made: Controls) -> None:
    with gui.add_folder("Volume"):
        made.with_surface = gui.add_checkbox("surfaces", False)
        hint = "percent of the peak"
        made.threshold = gui.add_slider("threshold %", 1.0, 100.0, 0.5, _THRESHOLD, hint=hint)
        made.inner = gui.add_slider("inner %", 1.0, 100.0, 0.5, _INNER, hint=hint)
        hint = "clear it where a graphics card turns all triangles smoothly"
        made.coarse = gui.add_checkbox("turn coarse", initial_value=True, hint=hint)
        for axis, letter in enumerate(AXES):
            lower, upper = float(grid.lower[axis]), float(grid.upper[axis])
            made.planes.append(
                (
                    gui.add_checkbox(f"plane {letter}", False),
                    gui.add_slider(
                        f"{letter} ({length_unit})",
                        lower,
                        upper,
                        (upper - lower) / _PLANE_STEPS,
                        float(grid.center[axis]),
                        visible=False,
                    ),
                )
            )
        made.along = gui.add_dropdown("line of sight", PICTURES, initial_value=INTEGRAL)
        made.colours = gui.add_dropdown("colours", COLOURS, initial_value=COLOURS[0])
        made.span = gui.add_multi_slider("range %", 0.0, 100.0, 0.5, (0.0, 100.0))
