"""A server that this machine alone reaches: one page, and the answers that it asks for.

It reads no file by a name from outside: what can be asked for are numbers of frames and cameras.
"""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

HOST = "127.0.0.1"
PORT = 8080
"""Where the search for a free port begins."""

_OWN = r"(127\.0\.0\.1|localhost|\[::1\])(:\d+)?"
_HOSTS, _ORIGINS = re.compile(_OWN), re.compile(rf"https?://{_OWN}")
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'self' http://127.0.0.1:* http://localhost:*",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}

Answer = Callable[..., "bytes | str | dict[str, Any]"]


class LocalServer(ThreadingHTTPServer):
    """A server at the first free port of 127.0.0.1 from a number on.

    ``answers`` leads from a path's pattern, which a whole path has to match, to what makes the
    answer of the numbers in it: a page, bytes, or a mapping sent as JSON.

    Notes
    -----
    Programs of this machine may ask, and pages of this machine by any port, as a tunnel may have
    another. Pages from elsewhere may not: a browser names them as ``Origin``, and a name of
    theirs that leads here stands in ``Host``.
    """

    daemon_threads = True
    allow_reuse_address = False

    def __init__(self, answers: dict[str, Answer], port: int = PORT) -> None:
        if not 1 <= port <= 65535:
            raise ValueError(f"port: found {port}, expected a number from 1 to 65535")
        # one at a time: kernels use all cores, and not all kinds of threads may share them
        self.turn = threading.Lock()
        self.answers = {re.compile(pattern): answer for pattern, answer in answers.items()}
        for number in range(port, 65536):
            try:
                super().__init__((HOST, number), _Handler)
                return
            except OSError:
                continue
        raise ValueError(f"port: found none free from {port} on, expected one")

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing where a browser thinks better of a question."""


class _Handler(BaseHTTPRequestHandler):
    server: LocalServer
    server_version, sys_version = "flametomo", ""

    def do_GET(self) -> None:
        """Answer a question of the page."""
        origin = self.headers.get("Origin")
        if not _HOSTS.fullmatch(self.headers.get("Host", "")) or not (
            origin is None or _ORIGINS.fullmatch(origin)
        ):
            return self._send(403, "text/plain", b"only pages of this machine may ask")
        for pattern, answer in self.server.answers.items():
            if found := pattern.fullmatch(self.path):
                try:
                    with self.server.turn:
                        made = answer(*map(int, found.groups()))
                except IndexError:
                    break
                except Exception as error:
                    said = " ".join(str(error).split()) or type(error).__name__
                    return self._send(500, "text/plain", said.encode())
                return self._send(200, *_as_sent(made))
        return self._send(404, "text/plain", b"nothing here")

    def log_message(self, *_: object) -> None:
        """Say nothing: the standard error is for the command's own lines."""

    def _send(self, status: int, kind: str, body: bytes) -> None:
        self.send_response(status)
        for name, value in {**_HEADERS, "Content-Type": f"{kind}; charset=utf-8"}.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


def _as_sent(made: bytes | str | dict[str, Any]) -> tuple[str, bytes]:
    if isinstance(made, bytes):
        return "application/octet-stream", made
    if isinstance(made, str):
        return "text/html", made.encode()
    return "application/json", json.dumps(made).encode()
