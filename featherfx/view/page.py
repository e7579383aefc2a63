"""The page as one HTML text: with all frames in it, or with frames that a server gives it."""

from __future__ import annotations

import base64
import contextlib
import gzip
import hmac
import html
import json
import re
import secrets
import socket
import sys
import threading
from collections.abc import Callable, Collection, Iterator, Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import chain
from pathlib import Path
from typing import Any

from featherfx.errors import InputError, Problem
from featherfx.files.atomic_write import into, standing, write_all
from featherfx.phases import counted
from featherfx.usd.types import OutputError
from featherfx.usd.write.output import find_file_problems
from featherfx.view.played import Played, packed

_FOLDER = Path(__file__).parent
_SCRIPTS = ("software.js", "shown.js", "page.js")
_ALL = 1 << 62  # points
_KEPT_BYTES = 400_000_000  # of frames that a page keeps in memory
# of the names of what belongs to one and another cache
PREFIXES = ("", "second-")


def header_of(first: Played, second: Played | None = None) -> dict[str, Any]:
    """Describe a cache, or two that are compared, for the viewer. alike: points of one are those
    of the other."""
    header = first.header()
    if second is not None:
        header["second"] = second.header() | {"keptBytes": _KEPT_BYTES}
        header["alike"] = first.constant_shape == second.constant_shape
        told = [header["told"], header["second"]["told"]]
        if not header["alike"]:
            told.append("other feathers or another resolution, so there is no difference")
        header["told"] = "; ".join(filter(None, told))
    return header


def page(
    header: dict[str, Any], title: str, data: Iterator[tuple[str, bytes]] | None = None
) -> Iterator[str]:
    """A page, piece by piece. data: names and contents of what is in it; None: it asks its
    server."""
    nonce = secrets.token_urlsafe(16)
    header = header | {"embedded": data is not None, "keptBytes": _KEPT_BYTES}
    values = {
        "NONCE": nonce,
        "CONNECT": "'none'" if data is not None else "'self'",
        "TITLE": html.escape(title),
        "HEADER": packed(header),
        "THREE": _text("three.min.js"),
        "SCRIPT": "".join(_text(name) for name in [*["live.js"] * ("live" in header), *_SCRIPTS]),
    }
    before, after = _text("page.html").split("@DATA@")
    yield _filled(before, values)
    for name, content in data or ():
        text = base64.b64encode(gzip.compress(content, 6, mtime=0)).decode()
        yield f'<script nonce="{nonce}" type="text/plain" id="data-{name}">{text}</script>\n'
    yield _filled(after, values)


def write_page(
    paths: Sequence[Path],
    output: str | Path,
    most_bytes: int,
    overwrite: bool,
    values: Collection[str] | None = None,
) -> list[Played]:
    """Write a cache as one HTML file that loads nothing else; it appears complete or not at all.

    paths: of one cache, or of two that are compared. most_bytes: of frames, before they are packed;
    points, then frames are left out to keep it. values: names of those that frames have besides
    points, which take most of the time; None: all.
    Raises InputError where the cache cannot be read or the output not be written.
    """
    output = Path(output)
    problems = find_file_problems([output], overwrite)
    if output.suffix != ".html":
        problems.append(Problem(str(output), "", f"suffix '{output.suffix}' is not .html"))
    if problems:
        raise OutputError(*problems)
    before = {output: standing(output)}
    shown = [fitting(each, most_bytes // len(paths), values) for each in paths]

    def data() -> Iterator[tuple[str, bytes]]:
        for played, prefix in zip(shown, PREFIXES, strict=False):
            constants, frames = played.names()
            for names in chain([constants], counted("drawing", frames, len(frames))):
                for name in names:
                    yield f"{prefix}{name}", played.content(name) or b""

    pieces = page(header_of(*shown), shown[0].path.name, data())
    write_all([(output, into(lambda file: file.writelines(map(str.encode, pieces))))], before)
    return shown


def fitting(path: Path, most_bytes: int, values: Collection[str] | None = None) -> Played:
    """A cache with as many points, then frames, as fit into bytes. values: as of Played."""
    whole = Played(path, _ALL, chosen=values)
    count = len(whole.codes)
    thin = _within(whole, most_bytes / count)
    if count * thin.frame_bytes <= most_bytes:
        return thin
    return Played(path, 1, max(int(most_bytes / thin.frame_bytes), 1), thin.bare, values)


def fitting_second(path: Path, most_bytes: int) -> Played:
    """A cache with as many points as a second of it has in bytes."""
    whole = Played(path, _ALL)
    if len(whole.codes) == 1:
        return whole
    return _within(whole, most_bytes / whole.frames_per_second)


def _within(whole: Played, most_bytes: float) -> Played:
    """A cache with as many points as fit into bytes a frame; without the body where that takes more
    than half of them."""
    if whole.frame_bytes <= most_bytes:
        return whole
    bare = whole.body_bytes > 0.5 * most_bytes
    left = most_bytes - 24 - (0 if bare else whole.body_bytes)
    return Played(whole.path, max(int(left / whole.point_bytes), 1), bare=bare, chosen=whole.chosen)


def _text(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _filled(text: str, values: dict[str, str]) -> str:
    parts = text.split("@")
    # names stand at odd places; what is filled in is not looked at again
    return "".join(part if k % 2 == 0 else values[part] for k, part in enumerate(parts))


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
_MAX_BYTES = 65_536
# s that a connection may be silent, and connections at a time: a browser keeps six
_PATIENCE, _MAX_CONNECTIONS = 30.0, 32


class Server(ThreadingHTTPServer):
    """A server of caches. address: with the token, for a browser. port: 0 for a free one.

    shown: one cache, or two that are compared. Where there are too many connections, the oldest
    that has not shown the token is closed, so that whoever has it is always served.

    Raises InputError where the port is taken.
    """

    daemon_threads = True
    request_queue_size = 2 * _MAX_CONNECTIONS

    def __init__(self, *shown: Played, port: int = 0) -> None:
        self.shown, self.token = shown, secrets.token_urlsafe(24)
        self.reading = threading.Lock()
        # open ones, oldest first, and whether they have shown the token
        self._connections: dict[Any, bool] = {}
        self._counting = threading.Lock()
        try:
            super().__init__((_HOST, port), _Handler)
        except OSError as error:
            told = f"{port} cannot be used: {error.strerror or error}. Leave it out for a free one"
            raise InputError(Problem("view", "port", told)) from error

    @property
    def address(self) -> str:
        return f"http://{_HOST}:{self.server_port}/{self.token}/"

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread of its own, unless there are too many."""
        with self._counting:
            if len(self._connections) >= _MAX_CONNECTIONS:
                strangers = [each for each, known in self._connections.items() if not known]
                oldest = strangers[0] if strangers else request
                self._connections.pop(oldest, None)
                with contextlib.suppress(OSError):
                    oldest.shutdown(socket.SHUT_RDWR)  # ends its thread
                if oldest is request:
                    self.shutdown_request(request)
                    return
            self._connections[request] = False
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """Forget a connection, and close it."""
        self._connections.pop(request, None)
        super().shutdown_request(request)

    def welcome(self, request: Any) -> None:
        """Remember that a connection has shown the token."""
        with self._counting:
            if request in self._connections:
                self._connections[request] = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A page that was closed, or is silent, is no error."""
        if not isinstance(sys.exc_info()[1], ConnectionError | TimeoutError):
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

        Raises InputError, or anything else where it is not understood.
        """
        return None


class _Handler(BaseHTTPRequestHandler):
    server: Server
    server_version, sys_version = "featherfx", ""
    protocol_version = "HTTP/1.1"
    # else a body waits until the browser, some 40 ms later, has said that the header is there
    disable_nagle_algorithm = True
    timeout = _PATIENCE

    def do_GET(self) -> None:
        name = self._allowed()
        if name is not None:
            self._reply(lambda: self.server.content(name))

    def do_POST(self) -> None:
        name = self._allowed()
        if name is None:
            return
        length = self.headers.get("Content-Length", "")
        if not re.fullmatch("[0-9]{1,9}", length) or int(length) > _MAX_BYTES:
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
            self.server.welcome(self.connection)
            return name
        self.close_connection = True
        self._answer(404, "text/plain", b"there is nothing here")
        return None

    def _reply(self, ask: Callable[[], tuple[str, bytes] | None]) -> None:
        try:
            found = ask()
        except InputError as error:
            told = str(error).encode(errors="backslashreplace")
            self._answer(409, "text/plain; charset=utf-8", told)
        except Exception as error:  # whatever a request may bring about
            self._answer(400, "text/plain", f"is not understood: {type(error).__name__}".encode())
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
