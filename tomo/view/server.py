"""A server of viser that this machine alone reaches, and whose page asks no other for anything."""

from __future__ import annotations

import contextlib
import io
import logging
import math
import re
import socket
from collections.abc import Iterator
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING

from numpy.typing import NDArray

from tomo.view.world import World

if TYPE_CHECKING:
    import viser

    from tomo.draw.frame import Up

HOST = "127.0.0.1"
PORT = 8080
"""Where the search for a free port begins."""

FIELD_OF_VIEW = 0.7
"""Upright angle of the page's eye in radians; more distorts what is near the border."""

ORIGINS = (None, re.compile(r"https?://(127\.0\.0\.1|localhost|\[::1\])(:\d+)?"))
"""Whose pages may connect: those of this machine, by any port, as a tunnel may have another, and
programs, which send no origin. A page from elsewhere would read volumes without being seen."""

_PORTS = 1000  # tried, one after the other


def free_port(first: int = PORT) -> int:
    """Return the first port from ``first`` on that nobody listens at.

    Raises
    ------
    ValueError
        If there is none among a thousand, or ``first`` is no port.
    """
    if not 1 <= first <= 65535:
        raise ValueError(f"port: found {first}, expected a number from 1 to 65535")
    for port in range(first, min(first + _PORTS, 65536)):
        with socket.socket() as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with contextlib.suppress(OSError):
                tried.bind((HOST, port))
                return port
    raise ValueError(f"port: found none free from {first} on, expected one")


def local_server(port: int, title: str) -> viser.ViserServer:
    """Start the server at a free port; its page shares nothing and fetches nothing.

    Raises
    ------
    ValueError
        If viser is not installed.
    """
    try:
        import viser
    except ImportError:
        raise ValueError("view: viser is not installed; pip install 'flametomo[viewer]'") from None

    class LocalServer(viser.ViserServer):
        """A server without viser's public addresses, whatever a page asks for."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            """Refuse: the page stays on this machine."""
            return None

    # a browser that opens a connection and thinks better of it is no news
    logging.getLogger("websockets.server").addHandler(logging.NullHandler())
    with _quiet(viser), _own_pages_only():
        server = LocalServer(host=HOST, port=port, label=title, verbose=False)
    server.gui.configure_theme(
        control_width="medium", show_logo=False, show_share_button=False, dark_mode=True
    )
    server.scene.configure_environment_map(None)
    server.scene.configure_default_lights(enabled=False)
    return server


def silent() -> contextlib.AbstractContextManager:
    """Keep viser's words from stdout, which is for results."""
    return contextlib.redirect_stdout(io.StringIO())


@contextlib.contextmanager
def _quiet(viser: ModuleType) -> Iterator[None]:
    """Start a server without its banner, and without a build of its page from sources.

    viser builds its page anew, with packages from the network, where the times of its files
    say that the sources are newer; an archive that was unpacked in another order looks so.
    """
    builder = getattr(viser._viser, "_client_autobuild", None)
    build = getattr(builder, "ensure_client_is_built", None)
    if builder is not None and build is not None:
        builder.ensure_client_is_built = lambda: None
    try:
        with silent():
            yield
    finally:
        if builder is not None and build is not None:
            builder.ensure_client_is_built = build


@contextlib.contextmanager
def _own_pages_only() -> Iterator[None]:
    """Start a server that pages of other origins cannot connect to.

    viser has no setting for it and calls ``serve`` of websockets by its public name, which has
    one: for the start, that name stands for ``serve`` with these origins.
    """
    from websockets.asyncio import server

    plain = server.serve
    server.serve = partial(plain, origins=ORIGINS)  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        server.serve = plain  # type: ignore[misc]


def add_lights(server: viser.ViserServer, up: Up) -> None:
    """Add two lights: viser's own are four, and each costs every pixel where nothing helps it.

    The sky lights from above and the ground from below; the other shines over the first eye's
    shoulder.
    """
    from tomo.draw.frame import EYE

    towards = up.eye_direction(EYE[0] - 35, EYE[1] + 25)
    scene = server.scene
    white, ground = (255, 255, 255), (110, 110, 120)
    scene.add_light_hemisphere("/light/sky", sky_color=white, ground_color=ground, intensity=1.1)
    position = tuple(towards.tolist())
    scene.add_light_directional("/light/sun", color=white, intensity=2.6, position=position)


def eye_on(world: World, up: Up, radius: float) -> tuple[NDArray, float]:
    """Return where the page's eye sees all within a radius of the middle, and how far it sees.

    Parameters
    ----------
    world : World
    up : Up
    radius : float
        In the page's units.

    Returns
    -------
    position : (3,) float64
        A little from above, looking at the middle.
    far : float
        Beyond everything that is drawn.
    """
    from tomo.draw.frame import EYE

    distance = 1.1 * radius / math.sin(FIELD_OF_VIEW / 2)
    return distance * up.eye_direction(*EYE), 4.0 * (distance + world.reach)


def first_look(server: viser.ViserServer, world: World, up: Up, radius: float) -> None:
    """Place the eye of every page that opens so that all within a radius is in sight."""
    position, far = eye_on(world, up, radius)
    server.scene.set_up_direction(tuple(up.vector))
    camera = server.initial_camera
    camera.fov = FIELD_OF_VIEW
    camera.position, camera.look_at = tuple(position.tolist()), (0.0, 0.0, 0.0)
    camera.near, camera.far = 1e-3 * far, far
