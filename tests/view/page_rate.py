"""Frames a second of the pages, in headless Chromium without a graphics card.

Run as a program: `page_rate.py view CACHE [MEGABYTES]`, `page_rate.py upload CACHE [MEGABYTES]` or
`page_rate.py tune SHOT [PATTERN]`. `upload` decodes frames and hands all of their points to WebGL,
which draws nothing. Prints, for ten seconds each, frames a second, and processor time a frame of
this process and of the browser. Where other work keeps the machine busy, `chrt -r 1` before
it gives what free cores would (Linux, root).
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).parents[1]))  # as the tests have it

from test_view_live import served
from test_view_page import BROWSER_OPTIONS, scripted

from featherfx.view.live import Live, LiveServer, LiveSource, presets_of
from featherfx.view.page import Server, fitting_second

SECONDS = 10.0
TICKS = os.sysconf("SC_CLK_TCK")
# as of who has no card: a compositor of its own, which software WebGL would take the time of
PLAIN = tuple(each for each in BROWSER_OPTIONS if "swiftshader" not in each)
# a loop that goes on drawing, a count of frames, and what is done meanwhile
PLAY = ("document.getElementById('play').click();", "f.drawn", "")
UPLOAD = ("f.spare = 1e9;" + PLAY[0], *PLAY[1:])
NOTHING_DRAWN = "WebGL2RenderingContext.prototype.drawElements = () => {};"
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


def measure(
    make: Callable[[], Server],
    what: tuple[str, str, str],
    title: str,
    options: tuple[str, ...] = BROWSER_OPTIONS,
    before: str = "",
) -> tuple[float, float]:
    """Print what it takes, and return frames a second and ms of all processors a frame."""
    kind = type(make())
    said: list[tuple[Any, float, Counter[str]]] = []
    done = threading.Event()

    class Watched(kind):  # type: ignore[misc, valid-type]
        def content(self, name):
            found = super().content(name)
            if name:
                return found
            text = scripted(found[1].decode(), steps(*what))
            nonce = re.search(r'<script nonce="[^"]+">', text)[0]
            return found[0], text.replace(nonce, f"{nonce}{before}</script>{nonce}", 1).encode()

        def posted(self, name, content):
            if name != "said":
                return super().posted(name, content)
            said.append((content, time.process_time(), of_browser(profile)))
            if len(said) == 2:
                done.set()
            return {}

    server = make()
    server.__class__ = Watched
    card = "#webgl" if before else ""
    with tempfile.TemporaryDirectory() as profile, served(server):
        command = [*options, f"--user-data-dir={profile}", server.address + card]
        with subprocess.Popen(command, stdout=-3, stderr=-3) as browser:
            if not done.wait(180.0):
                print(f"{title}: no answer")
            browser.terminate()
    (_, begun, theirs), ((rate, triangles, drawing), ended, by_end) = said
    each = 1e3 / SECONDS / rate
    by_end.subtract(theirs)
    browser_told = ", ".join(f"{name} {each * by_end[name]:.1f}" for name in sorted(by_end))
    print(
        f"{title}: {rate:.1f} a second, {each * (ended - begun):.1f} ms each here;"
        f" {triangles} triangles, drawn in {drawing:.0f} ms; browser, ms each: {browser_told}"
    )
    return rate, each * (ended - begun + sum(by_end.values()))


def of_browser(profile: str) -> Counter[str]:
    """Processor seconds so far of a browser's processes by kind, where the system has /proc."""
    found: Counter[str] = Counter()
    for each in Path("/proc").glob("[0-9]*"):
        try:
            command, told = (each / "cmdline").read_bytes(), (each / "stat").read_text()
        except OSError:  # it has ended
            continue
        if profile.encode() in command:
            kind = re.search(rb"--type=([\w-]+)", command)
            ticks = told.rpartition(")")[2].split()[11:13]
            found[kind[1].decode() if kind else "browser"] += sum(map(int, ticks)) / TICKS
    return found


def main(what: str, file: str, more: str = "") -> None:
    if what in ("view", "upload"):
        played = fitting_second(Path(file), int(1e6 * float(more or 64)))
        body = f"body of {played.body.points}" if played.body else "no body"
        print("; ".join(played.told()) or "whole", f"{played.points} points, {body}")
        make = lambda: Server(played)  # noqa: E731
        if what == "view":
            measure(make, PLAY, "playing", PLAIN)
        else:
            measure(make, UPLOAD, "decoding and uploading", before=NOTHING_DRAWN)
        return
    with tempfile.TemporaryDirectory() as folder:
        source = LiveSource(Path(file), Path(folder), [more] if more else (), jobs=2)
        with Live(source, presets_of(source)) as live:
            make = lambda: LiveServer(live, Path(folder), overwrite=False)  # noqa: E731
            measure(make, LIVE, "left alone")
            for name in ("rachis_material.youngs_modulus", "leading.guides.1.angle"):
                measure(make, (*DRAG[:2], DRAG[2] % name), f"{name} dragged")


if __name__ == "__main__":
    main(*sys.argv[1:])
