"""The window of the camera that was chosen: its image beside that of the volume, and numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tomo.view.comparison import Comparison

if TYPE_CHECKING:
    import viser

_WIDEST = 700  # pixels of the page


class CameraPanel:
    """A window in the page, at its lower left until somebody moves it.

    Parameters
    ----------
    gui : viser.GuiApi
    """

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui = gui
        self._parts: tuple[Any, Any, Any] | None = None

    def __repr__(self) -> str:
        return f"<CameraPanel: {'closed' if self._parts is None else 'open'}>"

    def show(self, found: Comparison, colours: str) -> None:
        """Show a camera's images in the colours of a colour map, and their numbers."""
        picture, words = found.picture(colours), found.words()
        if self._parts is None:
            panel = self._gui.add_panel()
            with panel.add_tab("Camera"):
                image, text = (
                    self._gui.add_image(picture, format="png"),
                    self._gui.add_markdown(words),
                )
            panel.float(x=12, y=-12, width=min(picture.shape[1] + 40, _WIDEST))
            self._parts = panel, image, text
            return
        panel, image, text = self._parts
        panel.visible, image.image, text.content = True, picture, words

    def hide(self) -> None:
        """Close the window."""
        if self._parts is not None:
            self._parts[0].visible = False
