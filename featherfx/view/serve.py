"""The page from a server on this machine's loopback address, for one user with a token.

Who does not know the token in the address gets nothing, nor does a page of another origin that a
browser of this machine has open: requests must name this server as their host, and as their origin
where they have one. Nothing but the page and the frames of its cache is given.
"""

from __future__ import annotations

import hmac
import json
import secrets
import sys
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from featherfx.errors import InputError, Problem
from featherfx.view.page import PREFIXES, header_of, page
from featherfx.view.played import Played

_HOST = "127.0.0.1"
_HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
HTML, BYTES, JSON = "text/html; charset=utf-8", "application/octet-stream", "application/json"
# of what a page may say
_MOST_BYTES = 65_536


class Server(ThreadingHTTPServer):
    """A server of caches. address: with the token, for a browser. port: 0 for a free one.

    shown: one cache, or two that are compared.

    Raises InputError where the port is taken.
    """

    daemon_threads = True

    def __init__(self, *shown: Played, port: int = 0) -> None:
        self.shown, self.token = shown, secrets.token_urlsafe(24)
        self.reading = threading.Lock()
        try:
            super().__init__((_HOST, port), _Handler)
        except OSError as error:
            told = f"{port} cannot be used: {error.strerror or error}. Leave it out for a free one"
            raise InputError(Problem("view", "port", told)) from error

    @property
    def address(self) -> str:
        return f"http://{_HOST}:{self.server_port}/{self.token}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A page that was closed is no error."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)

    def content(self, name: str) -> tuple[str, bytes] | None:
        """Type and content of what stands under a name; None where there is nothing."""
        with self.reading:
            if name == "":
                return HTML, "".join(page(header_of(*self.shown), self.shown[0].path.name)).encode()
            for played, prefix in zip(self.shown, PREFIXES, strict=False):
                if name.startswith(prefix) and (found := played.content(name[len(prefix) :])):
                    return BYTES, found
        return None

    def posted(self, name: str, content: Any) -> Any:
        """Answer a request of the viewer as JSON; None where there is no answer.

        Raises InputError, or KeyError, TypeError or ValueError where it is not understood.
        """
        return None


class _Handler(BaseHTTPRequestHandler):
    server: Server
    server_version, sys_version = "featherfx", ""
    protocol_version = "HTTP/1.1"
    # else a body waits until the browser, some 40 ms later, has said that the header is there
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        name = self._allowed()
        if name is not None:
            self._reply(lambda: self.server.content(name))

    def do_POST(self) -> None:
        name = self._allowed()
        if name is None:
            return
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > _MOST_BYTES:
            self.close_connection = True
            self._answer(413, "text/plain", b"too long")
            return
        content = self.rfile.read(int(length))

        def posted() -> tuple[str, bytes] | None:
            answer = self.server.posted(name, json.loads(content))
            return None if answer is None else (JSON, json.dumps(answer).encode())

        self._reply(posted)

    def _allowed(self) -> str | None:
        """Name of what is asked for, by who may; None after an answer to who may not. A page must
        name its origin where it says something, which a browser sees to."""
        own = f"{_HOST}:{self.server.server_port}"
        origin = self.headers.get("Origin")
        anonymous = origin is None and self.command == "GET"
        if self.headers.get("Host") != own or not (anonymous or origin == f"http://{own}"):
            self.close_connection = True
            self._answer(403, "text/plain", b"this page is for its own server only")
            return None
        token, _, name = self.path.removeprefix("/").partition("/")
        if hmac.compare_digest(token.encode(), self.server.token.encode()):
            return name
        self.close_connection = True
        self._answer(404, "text/plain", b"there is nothing here")
        return None

    def _reply(self, ask: Callable[[], tuple[str, bytes] | None]) -> None:
        try:
            found = ask()
        except InputError as error:
            self._answer(409, "text/plain; charset=utf-8", str(error).encode())
        except (KeyError, TypeError, ValueError, IndexError):
            self._answer(400, "text/plain", b"is not understood")
        else:
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
