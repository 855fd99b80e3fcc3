"""The viewer: a content's page, served until it is stopped."""

from __future__ import annotations

import threading
from urllib.parse import quote

from tomo.view.content import Content
from tomo.view.page import Page
from tomo.view.server import HOST, PORT, Answer, LocalServer


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

    Raises
    ------
    ValueError
        If no port is free, or the first frame cannot be read.
    """

    def __init__(self, content: Content, port: int = PORT) -> None:
        self.content, page = content, Page(content)
        answers: dict[str, Answer] = {
            "/": lambda: page.html,
            r"/volume/(\d{1,9})": lambda place: page.volume(place).tobytes(),
            r"/images/(\d{1,9})": lambda place: page.images(place).tobytes(),
            r"/compare/(\d{1,9})/(\d{1,9})": page.compared,
        }
        self._server = LocalServer(answers, port)
        self.url = f"http://{HOST}:{self._server.server_port}"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def __repr__(self) -> str:
        return f"<Viewer of {self.content.title!r} at {self.url}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the page, where the notebook runs on this machine."""
        frame = 'style="width:100%;height:600px;border:0"'
        return f'<a href="{self.url}">{self.url}</a><br><iframe src="{self.url}" {frame}></iframe>'

    def choose(self, camera: str) -> str:
        """Return the page's address with a camera's image beside that of the volume.

        Raises
        ------
        ValueError
            If no image of such a camera is known.
        """
        known = self.content.scan.rig.names if self.content.scan else ()
        if camera not in known:
            raise ValueError(f"camera: found {camera!r}, expected one of {', '.join(known)}")
        return f"{self.url}/#{quote(camera)}"

    def stop(self) -> None:
        """Stop the server."""
        self._server.shutdown()
        self._server.server_close()
