"""Requests to the servers of pages that no page makes: odd bytes, heads, names and values.

A cache is played, and a shot is tuned, which simulates all the while. Each request is answered, or
refused with a status; no thread of a server ends in an error, and at the end both still serve.
"""

from __future__ import annotations

import http.client
import json
import random
import socket
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

from .cases import Failure, Found, nothing

SHOT = Path(__file__).resolve().parents[2] / "samples/feather_pull/shot.toml"
HOST = "127.0.0.1"
STATUSES = (200, 400, 403, 404, 408, 409, 411, 413, 414, 431, 501, 505)
# of requests that are JSON but not what a page says
MISUNDERSTOOD = {
    f"is not understood: {name}"
    for name in ("AttributeError", "IndexError", "JSONDecodeError", "KeyError", "OverflowError",
                 "RecursionError", "TypeError", "UnicodeDecodeError", "ValueError")
}  # fmt: skip
NAMES = ("", "header", "constant", "points-1", "points0-1", "points-after-0", "strain-after-1",
         "strain-1", "hooked-2", "second-constant", "points-99999999", "points-after-999999999999",
         "../../etc/passwd", "%2e%2e/x", "points-\u0663", "a" * 9000)  # fmt: skip
POSTS = ("change", "pull", "blow", "speed", "restart", "save", "x")
ODD = (None, True, -1, 0, 1, 7, 1.5, 1e-300, 1e300, -1e300, 10**400, float("nan"), float("inf"), "",
       "x", "\ud800", "\x00", [], [0], [0, 0, 1], [1e300, 0, 0], [None] * 3, [[0, 0, 1]], {},
       {"key": 1})  # fmt: skip
BYTES = (b"GET ", b"POST ", b"/", b" HTTP/1.1\r\n", b"\r\n", b"Host: ", b"Content-Length: ", b"7",
         b"9" * 5000, b"\x00", b"\xff", b"Origin: http://", b"Expect: 100-continue\r\n", b"{",
         b"Transfer-Encoding: chunked\r\n", b"A: b\r\n" * 120)  # fmt: skip


def run(cases: Sequence[int], seed: int, keep: Path | None = None) -> Iterator[Found]:
    """Outcomes of each request: its status, or closed where there is none.

    keep: takes nothing; a failure names what was sent.
    """
    errors: list[str] = []
    threading.excepthook = lambda each: errors.append(f"{each.thread}: {each.exc_value!r}")
    with tempfile.TemporaryDirectory() as name, open_servers(Path(name), errors) as servers:
        keys = [each.key for each in servers[1]._live.tuned.sliders]
        for number in cases:
            result, chance = nothing(), random.Random(f"{seed} {number}")
            sent = compose_request(chance, servers[number % 2], keys)
            status, said = send(servers[number % 2], sent)
            result.outcomes["done" if status in (200, 0) else "refused"] += 1
            odd = status == 400 and said not in MISUNDERSTOOD and said.startswith("is not underst")
            if errors or odd or (status and status not in STATUSES):
                told = f"{status} {said} {errors}: {sent[:2000]!r}"
                result.failures.append(Failure(number, told))
                errors.clear()
            result.through.append(number)
            yield result
        result = nothing()
        for each in servers:
            if send(each, request_head(each, "GET", "") + b"\r\n")[0] != 200:
                result.failures.append(Failure(-1, f"{each} serves no more"))
        if lost := [each for each in servers[1]._live._threads if not each.is_alive()]:
            result.failures.append(Failure(-1, f"the simulation has ended: {lost}"))
        yield result


@contextmanager
def open_servers(folder: Path, errors: list[str]) -> Iterator[tuple[Any, Any]]:
    """Serve a cache and a shot. errors: takes those of their threads."""
    # else the cases of all kinds would share the threads of USD
    from featherfx import bake
    from featherfx.view.live import Live, LiveServer, LiveSource, presets_of
    from featherfx.view.page import Server
    from featherfx.view.played import Played

    bake(SHOT, folder / "o.usdc", quality="draft", frames=(1, 3))
    (folder / "live").mkdir()
    source = LiveSource(SHOT, folder / "live")
    with ExitStack() as stack:
        live = stack.enter_context(Live(source, presets_of(source)))
        servers = Server(Played(folder / "o.usdc", 1 << 62)), LiveServer(live, folder / "p", True)
        for each in servers:
            each.handle_error = lambda *_: errors.append("an error of a connection")
            stack.enter_context(closing_server(each))
        yield servers


@contextmanager
def closing_server(server: Any) -> Iterator[None]:
    """Serve in a thread of its own."""
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def compose_request(chance: random.Random, server: Any, keys: Sequence[str]) -> bytes:
    """Return the bytes of a request. keys: of sliders."""
    kind = chance.random()
    if kind < 0.2:
        own = (server.token.encode(), f"{HOST}:{server.server_port}".encode())
        return b"".join(chance.choices((*BYTES, *own), k=chance.randint(1, 14)))
    if kind < 0.4:
        name = chance.choice(NAMES).encode("utf-8", "surrogateescape").decode("latin-1")
        return request_head(server, "GET", name) + b"\r\n"
    name = chance.choice(POSTS)
    body = json.dumps(compose_content(chance, keys)).encode()
    if chance.random() < 0.1:
        body = body[: chance.randint(0, len(body))]
    length = chance.choice([*[str(len(body))] * 9, "0", "-1", "1e3", "9" * 5000, "70000"])
    return request_head(server, "POST", name) + f"Content-Length: {length}\r\n\r\n".encode() + body


def compose_content(chance: random.Random, keys: Sequence[str]) -> Any:
    """Return what a page says, with odd values in some places."""

    def odd(sound: Any) -> Any:
        return sound if chance.random() < 0.6 else chance.choice(ODD)

    place = [chance.uniform(-1.0, 1.0) for _ in range(3)]
    found = {
        "key": odd(chance.choice(keys)),
        "value": odd(chance.choice([10.0 ** chance.uniform(-12.0, 12.0), "open", True, 3])),
        "feather": odd(0),
        "at": odd(place),
        "to": odd([10.0 ** chance.uniform(-3.0, 6.0) * each for each in place]),
        "direction": odd(place),
        "speed": odd(10.0 ** chance.uniform(-3.0, 3.0)),
    }
    return odd({key: value for key, value in found.items() if chance.random() < 0.9})


def request_head(server: Any, method: str, name: str) -> bytes:
    """Return the first lines of a request that a page may make."""
    own = f"{HOST}:{server.server_port}"
    line = f"{method} /{server.token}/{name} HTTP/1.1\r\nHost: {own}\r\nOrigin: http://{own}\r\n"
    return line.encode("latin-1")


def send(server: Any, content: bytes) -> tuple[int, str]:
    """Return status and beginning of the answer to these bytes; 0 where the connection is closed
    instead."""
    with closing(socket.create_connection((HOST, server.server_port), timeout=40)) as connection:
        try:
            connection.sendall(content)
            connection.shutdown(socket.SHUT_WR)
            answer = http.client.HTTPResponse(connection)
            answer.begin()
            said = answer.read()[:200].decode(errors="replace")
        except (http.client.HTTPException, OSError):  # closed meanwhile
            return 0, ""
        return answer.status, said
