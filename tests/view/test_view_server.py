"""The page's server under requests and connections that no browser makes."""

import http.client
import json
import socket
import threading
import time
from contextlib import contextmanager

import pytest

from featherfx.errors import InputError, Problem
from featherfx.view import page
from featherfx.view.page import _HOST, JSON, Server


class Trial(Server):
    """Answers like the server of a shot that is simulated, and counts errors in its threads."""

    def __init__(self):
        super().__init__()
        self.errors = []

    def content(self, name):
        return (JSON, b"{}") if name == "" else None

    def posted(self, name, content):
        if name == "refused":
            raise InputError(Problem("tune", content["key"], "is not allowed. Leave it out"))
        return {"speed": float(content["speed"]), "all": content.get("all")}

    def handle_error(self, request, client_address):
        self.errors.append(request)


@contextmanager
def running(server):
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.fixture
def server():
    with running(Trial()) as found:
        yield found


def status(server, method="GET", name="", body=None, **headers):
    connection = http.client.HTTPConnection(_HOST, server.server_port, timeout=10)
    if method == "POST":
        headers = {"Origin": f"http://{_HOST}:{server.server_port}"} | headers
    connection.request(method, f"/{server.token}/{name}", body, headers)
    found = connection.getresponse()
    content = found.read()
    connection.close()
    return found.status, content


def raw(server, content):
    """First line of the answer to these bytes."""
    with socket.create_connection((_HOST, server.server_port), timeout=10) as connection:
        connection.sendall(content)
        connection.shutdown(socket.SHUT_WR)
        found = b""
        while part := connection.recv(65536):
            found += part
    return found.partition(b"\r\n")[0]


def head(server, length):
    own = f"{_HOST}:{server.server_port}"
    return (
        f"POST /{server.token}/speed HTTP/1.1\r\nHost: {own}\r\nOrigin: http://{own}\r\n"
        f"Content-Length: {length}\r\n\r\n"
    ).encode()


BODIES = ["", "{", "[]", "[1]", "null", "3", '"speed"', "{}", '{"speed": null}', '{"speed": []}',
          '{"speed": "\\ud800"}', '{"speed": 1' + "0" * 400 + "}", "[" * 20_000,
          '{"speed": {"a": NaN}}', "\udc80", "\x00"]  # fmt: skip


@pytest.mark.parametrize("body", BODIES)
def test_what_is_not_understood_is_answered_so(server, body):
    code, _ = status(server, "POST", "speed", body.encode(errors="surrogateescape"))
    assert code == 400
    assert status(server)[0] == 200
    assert server.errors == []


@pytest.mark.parametrize("length", ["9" * 5000, "-1", "1e3", "\u0663", "", "70000", "0x10"])
def test_lengths_that_are_none_are_answered(server, length):
    answer = raw(server, head(server, length).replace("\u0663".encode(), b"\xb3"))
    assert answer.startswith((b"HTTP/1.1 413", b"HTTP/1.1 400"))
    assert server.errors == []


def test_a_text_that_cannot_be_encoded_is_told(server):
    code, content = status(server, "POST", "refused", json.dumps({"key": "\ud800"}))
    assert (code, b"is not allowed" in content) == (409, True)
    assert server.errors == []


def test_idle_connections_lock_nobody_out(server):
    idle = [socket.create_connection((_HOST, server.server_port)) for _ in range(129)]
    begin = time.monotonic()
    assert [status(server)[0] for _ in range(5)] == [200] * 5
    assert time.monotonic() - begin < 5.0
    assert len(server._connections) <= page._MAX_CONNECTIONS
    for each in idle:
        each.close()
    assert server.errors == []


def test_a_viewer_is_not_closed_for_strangers(server):
    viewer = http.client.HTTPConnection(_HOST, server.server_port, timeout=10)
    viewer.request("GET", f"/{server.token}/")
    assert viewer.getresponse().read() == b"{}"
    idle = [socket.create_connection((_HOST, server.server_port)) for _ in range(60)]
    time.sleep(0.3)
    viewer.request("GET", f"/{server.token}/")
    assert viewer.getresponse().status == 200
    for each in [viewer, *idle]:
        each.close()


def test_a_silent_connection_ends(server, monkeypatch):
    monkeypatch.setattr(page._Handler, "timeout", 0.2)
    with socket.create_connection((_HOST, server.server_port), timeout=10) as connection:
        connection.sendall(b"GET / HT")
        assert connection.recv(100) == b""
    assert server.errors == []
