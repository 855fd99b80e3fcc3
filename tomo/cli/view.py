"""``flametomo view``: a result, a film or a rig in a page that this machine serves."""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path
from typing import Annotated

from tomo.cli.console import say
from tomo.cli.images import Images
from tomo.pipeline.declared import whole

EXAMPLES = """
flametomo view out
flametomo view out.zarr --scan scan
flametomo view rig.yaml
flametomo view out --no-browser --port 8090
"""


def view(
    shown: str,
    /,
    *,
    scan: Path | None = None,
    images: Images,
    port: Annotated[int, whole(1, 65535)] = 8080,
    browser: bool = True,
) -> None:
    """Show a volume with its cameras, a film or a rig in the browser.

    A page to turn the volume in, and to compare images with those of the volume. It comes
    from this machine alone and asks no other for anything. Ctrl-C ends it.

    Parameters
    ----------
    shown : OUT|OUT.zarr|RIG
        What reconstruct wrote, a volume file, a rig, or a scan: a rig with images.
    scan : SCAN
        The scan that the volume was made from, where it is no longer where it was.
    port : N
        The first free port from here on is taken.
    browser :
        Open the page in a browser.
    """
    known = images.scan(scan) if scan is not None or images != Images() else None
    from tomo.view import Viewer, content_of

    content = content_of(shown, known)
    viewer = Viewer(content, port)
    for note in content.notes:
        say(f"note: {note}", "yellow")
    ends = _ends()
    say(f"open {viewer.url} (Ctrl-C ends)")
    if browser and _has_display():
        import webbrowser

        webbrowser.open(viewer.url)
    while not ends.wait(0.5):
        pass
    viewer.stop()


def _has_display() -> bool:
    """Return whether a browser can be shown."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _ends() -> threading.Event:
    """Return what Ctrl-C and SIGTERM set: they end this command as they should, exit code 0."""
    ends = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ends.set())
    return ends
