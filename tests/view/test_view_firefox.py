"""The page that plays a cache in Firefox, driven by its own protocol (Marionette)."""

import json
import os
import shutil
import socket
import subprocess
import time

import pytest
from commands import invoke

FIREFOX = shutil.which("firefox") or shutil.which("firefox-esr")
PORT = 2828  # of Marionette
# loads, picks a feather, goes to the last frame, plays; what is wrong goes to errors
STEPS = """
const done = arguments[arguments.length - 1], errors = [];
console.error = (...told) => errors.push(told.join(" "));
window.addEventListener("error", (event) => errors.push(event.message));
(async () => {
  const wait = (ms) => new Promise((go) => setTimeout(go, ms));
  const over = () => window.featherfx?.ready || window.featherfx?.problem;
  for (let k = 0; k < 800 && !over(); k++) await wait(25);
  const f = window.featherfx;
  let picked = null;
  for (let y = 40; y < innerHeight - 60; y += 12)
    for (let x = 20; x < innerWidth && !picked; x += 12) picked = f.pick(x, y)?.id;
  await f.setFrame(f.frames - 1);
  const told = { problem: f.problem, picked, ids: f.feathers.map((e) => e.id), frame: f.frame };
  document.getElementById("play").click();
  const before = f.drawn;
  await wait(2000);
  done({ ...told, drawn: f.drawn - before, errors });
})().catch((error) => done({ errors: [String(error)] }));
"""


class Marionette:
    """A browser that takes commands: a length, a colon and JSON each way."""

    def __init__(self) -> None:
        end = time.monotonic() + 60.0
        while True:
            try:
                self._socket = socket.create_connection(("127.0.0.1", PORT), timeout=120.0)
                break
            except OSError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.2)
        self._file = self._socket.makefile("rb")
        self._number = 0
        self._read()

    def _read(self):
        length = b""
        while (one := self._file.read(1)) != b":":
            length += one
        return json.loads(self._file.read(int(length)))

    def call(self, name, **parameters):
        self._number += 1
        text = json.dumps([0, self._number, name, parameters]).encode()
        self._socket.sendall(b"%d:%s" % (len(text), text))
        _, _, error, result = self._read()
        assert error is None, error
        return result


@pytest.mark.nightly
@pytest.mark.skipif(FIREFOX is None, reason="no Firefox (Debian: firefox-esr)")
def test_a_file_plays_in_firefox(cache, tmp_path):
    page = tmp_path / "flaps.html"
    assert invoke("view", cache, "--html", page).exit_code == 0
    command = [FIREFOX, "--headless", "--marionette", "--no-remote", "--profile", str(tmp_path)]
    home = {**os.environ, "HOME": str(tmp_path)}
    with subprocess.Popen(command, stdout=-3, stderr=-3, env=home) as browser:
        try:
            firefox = Marionette()
            firefox.call("WebDriver:NewSession", capabilities={"alwaysMatch": {}})
            firefox.call("WebDriver:SetTimeouts", script=90_000)
            firefox.call("WebDriver:Navigate", url=page.as_uri())
            told = firefox.call(
                "WebDriver:ExecuteAsyncScript", script=STEPS, args=[], newSandbox=False
            )["value"]
        finally:
            browser.terminate()
    assert told["errors"] == []
    assert told["problem"] == ""
    assert told["picked"] in told["ids"]
    assert told["frame"] == 4
    assert told["drawn"] > 3
