"""The viewer: layers and controls of a page, kept up to date by one thread."""

from __future__ import annotations

import threading
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tomo.view.camera_panel import CameraPanel
from tomo.view.colours import photographs
from tomo.view.comparison import Comparison, compare
from tomo.view.content import Content
from tomo.view.controls import CAMERAS, VOLUME, Controls, add_controls
from tomo.view.rig_layer import SHOWN, RigLayer
from tomo.view.server import (
    HOST,
    PORT,
    add_lights,
    eye_on,
    first_look,
    free_port,
    local_server,
    silent,
)
from tomo.view.volume_layer import COARSE, FINE, NO_PICTURE, OUTER_OPACITY, VolumeLayer
from tomo.view.worker import Worker
from tomo.view.world import World

if TYPE_CHECKING:
    import viser

_IN_SYMBOL = 160  # pixels of an image in a camera's symbol
SHOWN_FIRST = {**SHOWN, "names": False}
"""Layers of the rig that are shown at first; the others are."""

REST = 0.6
"""Seconds without a move after which all is drawn. Lower: hesitating while one turns stutters."""


class Viewer:
    """A page on this machine that shows some content until it is stopped.

    Parameters
    ----------
    content : Content
    port : int
        The first free one from here on is taken.

    Attributes
    ----------
    url : str
    server : viser.ViserServer
    controls : Controls
    worker : Worker
    comparison : Comparison, optional
        What is shown of the chosen camera.

    Raises
    ------
    ValueError
        If viser is not installed, no port is free, or the first frame cannot be read.
    """

    def __init__(self, content: Content, port: int = PORT) -> None:
        self.content, self._world = content, World.of(content)
        self._peak = content.frames.scale() if content.frames else 1.0
        number = free_port(port)
        self.server = local_server(number, f"flametomo: {content.title}")
        self.url = f"http://{HOST}:{self.server.get_port()}"
        near = content.frames is not None or content.rig is None
        add_lights(self.server, content.up)
        first_look(self.server, self._world, content.up, self._radius(VOLUME if near else CAMERAS))
        self.worker = Worker(self._say)
        self.comparison: Comparison | None = None
        self._panel = CameraPanel(self.server.gui)
        self._moved: dict[int, float] = {}
        self._pictured: set[int] = set()
        self._ends = threading.Event()
        self._rig = RigLayer(self.server, self._world, content, self.choose)
        self._volume: VolumeLayer | None = None
        if content.frames is not None and content.grid is not None:
            self._volume = VolumeLayer(self.server, self._world, content.grid)
        self.controls = add_controls(self.server.gui, content, self._rig.names, SHOWN_FIRST)
        self._connect(self.controls)
        self.server.on_client_connect(self._welcome)
        self.refresh()
        for job in (self._play, self._watch):
            threading.Thread(target=job, daemon=True).start()

    def __repr__(self) -> str:
        return f"<Viewer of {self.content.title!r} at {self.url}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the page, where the notebook runs on this machine."""
        frame = 'style="width:100%;height:600px;border:0"'
        return f'<a href="{self.url}">{self.url}</a><br><iframe src="{self.url}" {frame}></iframe>'

    @property
    def place(self) -> int:
        """The place of the frame that is shown."""
        return 0 if self.controls.place is None else int(self.controls.place.value)

    def stop(self) -> None:
        """Stop the server and its threads."""
        self._ends.set()
        self.worker.stop()
        with silent():
            self.server.stop()

    def choose(self, camera: str) -> None:
        """Show a camera's measured image beside that of the volume."""
        if self.controls.camera is not None:
            self.controls.camera.value = camera
            self.worker.ask("camera", self._compare)

    def refresh(self) -> None:
        """Draw everything anew: another frame is shown."""
        ask = self.worker.ask
        ask("words", self._words)
        if self.content.frames is not None:
            self._refresh_volume()
        if self.content.scan is not None:
            ask("camera", self._compare)
            ask("images", self._images)

    def _refresh_volume(self, *_: object) -> None:
        self.worker.ask("surfaces", self._surfaces)
        for axis in range(3):
            self.worker.ask(f"plane {axis}", partial(self._plane, axis))
        self._look_again()

    def _connect(self, controls: Controls) -> None:
        """Let each control ask for what it changes."""

        def on(handle: Any, kind: str, job: Any) -> None:
            if handle is not None:
                handle.on_update(lambda _: self.worker.ask(kind, job))

        for handle in (controls.threshold, controls.inner, controls.with_surface):
            on(handle, "surfaces", self._surfaces)
        for axis, handles in enumerate(controls.planes):
            for handle in handles:
                on(handle, f"plane {axis}", partial(self._plane, axis))
        for handle in (controls.colours, controls.span):
            if handle is not None:
                handle.on_update(self._recolour)
        if controls.along is not None:
            controls.along.on_update(lambda _: self._look_again())
        if controls.look_at is not None:
            controls.look_at.on_click(self._turn_to)
        if controls.place is not None:
            controls.place.on_update(lambda _: self.refresh())
        on(controls.camera, "camera", self._compare)
        for layer, handle in controls.layers.items():
            on(handle, f"layer {layer}", partial(self._layer, layer))

    def _radius(self, look: str) -> float:
        return 1.0 if look == VOLUME else max(1.0, self._world.reach)

    def _turn_to(self, event: Any) -> None:
        """Move the eye of the page whose button was pressed."""
        camera = event.client.camera
        position, _ = eye_on(self._world, self.content.up, self._radius(event.target.value))
        with event.client.atomic():
            camera.position, camera.look_at = position, np.zeros(3)
            camera.up_direction = self.content.up.vector

    def _recolour(self, _: object) -> None:
        self._refresh_volume()
        if self.controls.camera is not None:
            self.worker.ask("camera", self._compare)

    def _layer(self, layer: str) -> None:
        self._rig.show(layer, self.controls.layers[layer].value)

    @property
    def _drawn(self) -> VolumeLayer:
        """What draws the volume; only contents with one ask for it."""
        assert self._volume is not None
        return self._volume

    @property
    def _data(self) -> NDArray[np.float32]:
        """The volume that is shown; only contents with one ask for it."""
        assert self.content.frames is not None
        return self.content.frames.volume(self.place)

    def _words(self) -> None:
        content, lines = self.content, []
        if content.n_frames > 1:
            lines.append(f"**{content.names[self.place]}**")
        if content.frames is not None and content.grid is not None:
            unit = f" {content.value_unit}" if content.value_unit else ""
            shape = " x ".join(str(n) for n in content.grid.shape)
            lines.append(f"{shape} voxels; 100 % is {self._peak:.4g}{unit}")
        elif content.rig is not None:
            lines.append(f"{len(content.rig)} cameras")
        self.controls.words.content = "  \n".join(lines)

    def _surfaces(self) -> None:
        controls, volume = self.controls, self._data
        scale = controls.scale(self._peak)
        levels = {"outer": (controls.threshold.value, OUTER_OPACITY)}
        if controls.inner.value > controls.threshold.value:
            levels["inner"] = controls.inner.value, 1.0
        with self.server.atomic():
            for name in ("outer", "inner"):
                if name not in levels or not controls.with_surface.value:
                    self._drawn.hide_surface(name)
                    continue
                percent, opacity = levels[name]
                level = percent / 100 * self._peak
                self._drawn.show_surface(name, volume, level, scale, opacity)

    def _plane(self, axis: int) -> None:
        is_shown, at = self.controls.planes[axis]
        if at.visible != is_shown.value:
            at.visible = is_shown.value
        if is_shown.value:
            self._drawn.show_plane(self._data, axis, at.value, self.controls.scale(self._peak))
        else:
            self._drawn.hide_plane(axis)

    def _images(self) -> None:
        self._rig.show_images(photographs(self.content.images(self.place), _IN_SYMBOL))

    def _welcome(self, client: viser.ClientHandle) -> None:
        if self._volume is not None:
            client.camera.on_update(lambda _: self._move(client))
            self._look(client)

    def _look_again(self) -> None:
        for client in self.server.get_clients().values():
            self._look(client)

    def _move(self, client: viser.ClientHandle) -> None:
        """Draw less while a page's eye moves."""
        self._moved[client.client_id] = time.monotonic()
        if self.controls.coarse.value:
            self.worker.ask("turn", partial(self._drawn.turn, True))
        self._look(client, COARSE)

    def _watch(self) -> None:
        """Draw all once the eyes that moved have rested for a while."""
        while self._volume is not None and not self._ends.wait(REST / 2):
            before = time.monotonic() - REST
            rested = [one for one, moved in list(self._moved.items()) if moved < before]
            for number in rested:
                del self._moved[number]
                client = self.server.get_clients().get(number)
                if client is not None:
                    self._look(client)
            if rested and not self._moved:
                self.worker.ask("turn", partial(self._volume.turn, False))

    def _look(self, client: viser.ClientHandle, rows: int = FINE) -> None:
        """Ask for the picture along a page's line of sight; a new page has none to take away."""
        if self.controls.along.value != NO_PICTURE or client.client_id in self._pictured:
            self.worker.ask(f"look {client.client_id}", partial(self._picture, client, rows))

    def _picture(self, client: viser.ClientHandle, rows: int) -> None:
        how = self.controls.along.value
        if how == NO_PICTURE:
            client.scene.set_background_image(None)
            self._pictured.discard(client.client_id)
            return
        scale = self.controls.scale(self._peak)
        picture = self._drawn.picture_for(client.camera, self._data, how, scale, rows)
        client.scene.set_background_image(picture, format="jpeg", jpeg_quality=90)
        self._pictured.add(client.client_id)

    def _compare(self) -> None:
        content, camera = self.content, self.controls.camera.value
        if content.scan is None or camera not in content.scan.rig.names:
            self.comparison = None
            self._panel.hide()
            return
        recorded = content.residual(camera, self.place) if content.residual else None
        volume = self._data if content.frames else None
        moment = content.moments[self.place]
        seen = volume, content.grid, content.model, recorded
        found = compare(content.scan, moment, camera, *seen)
        colours = self.controls.colours.value if self.controls.colours else "gray"
        self._panel.show(found, colours)
        self.comparison = found

    def _play(self) -> None:
        """Show the next frame while the film runs, when the one before is drawn."""
        controls = self.controls
        while controls.place is not None and not self._ends.wait(1 / controls.speed.value):
            if controls.playing.value and self.worker.is_idle:
                controls.place.value = (self.place + 1) % self.content.n_frames
                self.refresh()

    def _say(self, error: Exception) -> None:
        """Show what went wrong in the page: the rest of it goes on."""
        text = " ".join(str(error).split()) or type(error).__name__
        for client in self.server.get_clients().values():
            client.add_notification("Not shown", text, color="red")
