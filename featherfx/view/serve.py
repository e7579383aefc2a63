"""The page from a server on this machine's loopback address, for one user with a token.

Who does not know the token in the address gets nothing, nor does a page of another origin that a
browser of this machine has open: requests must name this server as their host, and as their origin
where they have one. Nothing but the page and the frames of its cache is given.
"""

from __future__ import annotations

import hmac
import re
import secrets
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from featherfx.errors import InputError, Problem
from featherfx.view.page import page
from featherfx.view.played import Played

HOST = "127.0.0.1"
_HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
_FRAME = re.compile(r"frame-(\d{1,7})")


class Server(ThreadingHTTPServer):
    """A server of one cache. address: with the token, for a browser. port: 0 for a free one.

    Raises InputError where the port is taken.
    """

    daemon_threads = True

    def __init__(self, played: Played, port: int = 0) -> None:
        self.played, self.token = played, secrets.token_urlsafe(24)
        self.reading = threading.Lock()
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            told = f"{port} cannot be used: {error.strerror or error}; leave it out for a free one"
            raise InputError(Problem("view", "port", told)) from error

    @property
    def address(self) -> str:
        return f"http://{HOST}:{self.server_port}/{self.token}/"

    def content(self, name: str) -> tuple[str, bytes] | None:
        """Type and content of what stands under a name; None where there is nothing."""
        with self.reading:
            if name == "":
                return "text/html; charset=utf-8", "".join(page(self.played)).encode()
            if name == "constant":
                return "application/octet-stream", self.played.constant()
            found = _FRAME.fullmatch(name)
            if found and int(found[1]) < len(self.played.codes):
                return "application/octet-stream", self.played.frame(int(found[1]))
        return None


class _Handler(BaseHTTPRequestHandler):
    server: Server
    server_version, sys_version = "featherfx", ""
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        own = f"{HOST}:{self.server.server_port}"
        origin = self.headers.get("Origin")
        if self.headers.get("Host") != own or origin not in (None, f"http://{own}"):
            self._answer(403, "text/plain", b"this page is for its own server only")
            return
        token, _, name = self.path.removeprefix("/").partition("/")
        if not hmac.compare_digest(token.encode(), self.server.token.encode()):
            self._answer(404, "text/plain", b"there is nothing here")
            return
        try:
            found = self.server.content(name)
        except InputError as error:
            self._answer(409, "text/plain; charset=utf-8", str(error).encode())
            return
        if found is None:
            self._answer(404, "text/plain", b"there is nothing here")
        else:
            self._answer(200, *found)

    def _answer(self, status: int, kind: str, content: bytes) -> None:
        self.send_response(status)
        for name, value in (_HEADERS | {"Content-Type": kind}).items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """The address has the token, so requests are not told."""
