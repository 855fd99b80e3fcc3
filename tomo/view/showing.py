"""Whatever can be shown, by its value or its path, in a page served until it is stopped."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import TypeAlias
from urllib.parse import quote

from rigs import Rig, load, preset_names
from tomo.grid import grid_of_rig
from tomo.io.volumes import readable_endings
from tomo.pipeline import Reconstruction
from tomo.report.outcome_files import FIGURES
from tomo.scan import Scan, load_scan
from tomo.scan.files import is_scan_file
from tomo.series.store import SeriesStore
from tomo.view.content import Content
from tomo.view.opening import (
    content_of_film,
    content_of_outcome,
    content_of_result,
    content_of_rig,
    content_of_volume,
)
from tomo.view.page import Page
from tomo.view.server import HOST, PORT, Answer, LocalServer

Shown: TypeAlias = Reconstruction | Rig | Scan | SeriesStore | str | os.PathLike


class Viewer:
    """A page on this machine that shows some content until it is stopped; ``url`` is its address.

    It takes the first free port from ``port`` on.
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


def show(shown: Shown, scan: Scan | None = None, *, port: int = PORT) -> Viewer:
    """Show a volume with its cameras, a film, a rig or a scan; return while the page is served.

    Parameters
    ----------
    shown : Reconstruction, Rig, Scan, SeriesStore or path
        A path is what ``flametomo view`` takes: what ``reconstruct`` wrote, a volume, a rig or a
        scan.
    scan : Scan, optional
        The scan that the volume was made from; the one on record when None.
    port : int
        The first free one from here on is taken.

    Returns
    -------
    Viewer
        Its ``url`` is the page; ``stop()`` ends it. A notebook shows the page below the cell.
    """
    return Viewer(content_of(shown, scan), port)


def content_of(shown: Shown, scan: Scan | None = None) -> Content:
    """Return what to show of a value, or by what is at the path."""
    if isinstance(shown, Reconstruction):
        return content_of_result(shown, scan)
    if isinstance(shown, SeriesStore):
        return content_of_film(shown.path, scan)
    if isinstance(shown, Scan):
        return _content_of_scan("scan" if shown.source is None else shown.source.stem, shown)
    if isinstance(shown, Rig):
        return content_of_rig("rig", shown, grid_of_rig(shown), scan)
    text, path = os.fspath(shown), Path(shown)
    if path.suffix == ".zarr":
        return content_of_film(path, scan)
    if (path / FIGURES).is_file():
        return content_of_outcome(path, scan)
    if path.is_file() and path.name.lower().endswith(readable_endings()):
        return content_of_volume(path, scan)
    is_scan = (path / "scan.yaml").is_file() or is_scan_file(path)
    if is_scan and text not in preset_names():
        return _content_of_scan(path.stem, load_scan(path) if scan is None else scan)
    rig = load(text)
    return content_of_rig(path.stem, rig, grid_of_rig(rig), scan)


def _content_of_scan(title: str, scan: Scan) -> Content:
    return content_of_rig(title, scan.rig, scan.grid or grid_of_rig(scan.rig), scan)
