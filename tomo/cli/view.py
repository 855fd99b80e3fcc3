"""``flametomo view``: a result, a film or a rig in a page that this machine serves."""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tomo.cli.console import say
from tomo.pipeline.declared import whole

if TYPE_CHECKING:
    from tomo import Scan

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
    rig: Path | None = None,
    images: Path | None = None,
    pattern: str | None = None,
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
    rig : FILE
        A rig.yaml, with --images, in place of --scan.
    images : FOLDER
        Images CAMERA/FRAME.tif, with --rig.
    port : N
        The first free port from here on is taken.
    browser :
        Open the page in a browser.
    """
    known = _scan(scan, rig, images, pattern)
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


def _scan(
    scan: Path | None, rig: Path | None, images: Path | None, pattern: str | None
) -> Scan | None:
    """Return the scan that the options name; None without."""
    from tomo import load_scan, scan_of_images

    if scan is not None and rig is None and pattern is None:
        return load_scan(scan, images)
    if rig is not None and images is not None and scan is None:
        return scan_of_images(rig, images, pattern)
    if (scan, rig, images, pattern) != (None,) * 4:
        raise ValueError("--scan: expected either a scan, or --rig and --images together")
    return None


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
