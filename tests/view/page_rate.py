"""Frames a second of the pages, in headless Chromium with its software renderer.

Run as a program: `page_rate.py view CACHE [MEGABYTES]` or `page_rate.py tune SHOT [PATTERN]`.
Prints, for ten seconds each, frames a second, and processor seconds of this process a frame.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from test_view_live import served
from test_view_page import BROWSER_OPTIONS, scripted

from featherfx.view.live import Live, LiveServer, LiveSource, presets_of
from featherfx.view.page import fitting_second
from featherfx.view.serve import Server

SECONDS = 10.0
# a loop that goes on drawing, a count of frames, and what is done meanwhile
PLAY = ("document.getElementById('play').click();", "f.drawn", "")
LIVE = ("", "f.updates", "")
DRAG = (
    "const ways = (name) => [...document.querySelectorAll(`label[data-key$=':${name}'] input`)];"
    "const drag = (name) => setInterval(() => { const way = ways(name)[0];"
    " way.value = 400 + 200 * Math.random(); way.dispatchEvent(new Event('input')); }, 30);",
    "f.updates",
    "drag('%s');",
)


def steps(begin: str, count: str, doing: str) -> str:
    return f"""(async () => {{
      const wait = (ms) => new Promise((done) => setTimeout(done, ms));
      while (!window.featherfx?.ready) await wait(50);
      const f = window.featherfx;
      {begin} {doing}
      await wait(3000);
      const first = {count}, since = performance.now();
      await fetch("said", {{ method: "POST", body: "0" }});
      await wait({1e3 * SECONDS});
      const rate = 1000 * ({count} - first) / (performance.now() - since);
      const body = JSON.stringify([rate, f.triangles, f.drawing]);
      await fetch("said", {{ method: "POST", body }});
    }})();"""


def measure(make: Callable[[], Server], what: tuple[str, str, str], title: str) -> None:
    kind = type(make())
    said: list[tuple[Any, float]] = []
    done = threading.Event()

    class Watched(kind):  # type: ignore[misc, valid-type]
        def content(self, name):
            found = super().content(name)
            return (
                (found[0], scripted(found[1].decode(), steps(*what)).encode())
                if not name
                else found
            )

        def posted(self, name, content):
            if name != "said":
                return super().posted(name, content)
            said.append((content, time.process_time()))
            if len(said) == 2:
                done.set()
            return {}

    server = make()
    server.__class__ = Watched
    with tempfile.TemporaryDirectory() as profile, served(server):
        command = [*BROWSER_OPTIONS, f"--user-data-dir={profile}", server.address]
        with subprocess.Popen(command, stdout=-3, stderr=-3) as browser:
            if not done.wait(180.0):
                print(f"{title}: no answer")
            browser.terminate()
    (_, begun), ((rate, triangles, drawing), ended) = said
    each = (ended - begun) / SECONDS / rate * 1e3
    print(
        f"{title}: {rate:.1f} a second, {each:.1f} ms each here;"
        f" {triangles} triangles, drawn in {drawing:.0f} ms"
    )


def main(what: str, file: str, more: str = "") -> None:
    if what == "view":
        played = fitting_second(Path(file), int(1e6 * float(more or 64)))
        print("; ".join(played.told()) or "whole", f"{played.points} points")
        measure(lambda: Server(played), PLAY, "playing")
        return
    with tempfile.TemporaryDirectory() as folder:
        source = LiveSource(Path(file), Path(folder), [more] if more else (), jobs=2)
        with Live(source, presets_of(source)) as live:
            make = lambda: LiveServer(live, Path(folder), overwrite=False)  # noqa: E731
            measure(make, LIVE, "left alone")
            for name in ("rachis_material.young", "leading.guides.1.angle"):
                measure(make, (*DRAG[:2], DRAG[2] % name), f"{name} dragged")


if __name__ == "__main__":
    main(*sys.argv[1:])
