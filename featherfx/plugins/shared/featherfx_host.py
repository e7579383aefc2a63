"""Shared part of the host plugins: run the featherfx command beside the host, and read its output.

The command runs in a process of its own, with its own Python and its own USD; nothing of featherfx
is imported here. It tells what it does as JSON lines. Python 3.9 and newer, standard library only.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import threading
from pathlib import Path

# written beside this file when the plugin is installed: what to call
COMMAND_FILE = "featherfx_command.json"
# of the host, and wrong for another Python
_HOST_ONLY = ("PYTHONHOME", "PYTHONPATH", "PXR_PLUGINPATH_NAME", "LD_PRELOAD")


class HostError(Exception):
    """The command failed, or is not there: what to tell the user."""


def command() -> list[str]:
    """Return the command to call: FEATHERFX_COMMAND, else what installed this plugin, else
    `featherfx`."""
    asked = os.environ.get("FEATHERFX_COMMAND")
    if asked:
        return [asked]
    file = Path(__file__).with_name(COMMAND_FILE)
    known = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else []
    if known and Path(known[0]).is_file():
        return list(known)
    found = shutil.which("featherfx")
    if found is None:
        raise HostError("featherfx was not found. Name its command in FEATHERFX_COMMAND")
    return [found]


class Run:
    """One call of the command.

    for told in run:           {"progress": ..., "phase": ..., "done": 3, "total": 24, ...}
        if host_is_cancelled():
            run.cancel()
    run.finish()               what it printed; raises HostError with what went wrong
    """

    def __init__(self, *arguments):
        environment = {k: v for k, v in os.environ.items() if k not in _HOST_ONLY}
        try:
            self._process = subprocess.Popen(
                [*command(), *map(str, arguments)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
                env=environment,
            )
        except OSError as error:
            raise HostError(f"featherfx cannot be started: {error}") from error
        self._printed: list[str] = []
        self.messages: list[str] = []
        self.is_cancelled = False
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        self._printed.append(self._process.stdout.read())

    def __iter__(self):
        for line in self._process.stderr:
            try:
                told = json.loads(line)
            except ValueError:
                told = None
            if isinstance(told, dict) and "progress" in told:
                yield told
            elif line.strip():
                self.messages.append(line.strip())

    def cancel(self):
        """Ask it to stop; what it has finished stays for the next bake to go on with."""
        if not self.is_cancelled:
            self.is_cancelled = True
            gentle = signal.SIGINT if os.name == "posix" else signal.SIGTERM
            self._process.send_signal(gentle)

    def finish(self):
        """Wait for it; what it printed. Raises HostError."""
        for _ in self:
            pass
        code = self._process.wait()
        self._reader.join()
        if self.is_cancelled:
            raise HostError("stopped; bake again to go on after the last finished frames")
        if code:
            raise HostError("\n".join(self.messages) or f"featherfx ended with {code}")
        return "".join(self._printed)


def share_done(told):
    """Return the fraction of a run that is done, 0 to 1, by its last line."""
    return min(told.get("done", 0) / max(told.get("total", 1), 1), 1.0)


def bake(shot, output, *options):
    """A run that bakes a shot, or goes on with it."""
    return Run("bake", shot, "-o", output, "--resume", "--progress", "json", *options)


def groom(file, output, *options):
    """A run that writes the feathers of a groom, or of curves in USD, at rest."""
    return Run("groom", file, "-o", output, "--progress", "json", "--overwrite", *options)


def write_groom(file, curves, kind=""):
    """A groom of the curves of a USD file; kind: a preset for those that name none."""
    lines = ["[[usd]]", f"file = {_text(os.path.abspath(curves))}"]
    if kind:
        lines.append(f"kind = {_text(kind)}")
    _write(file, f"name = {_text(_stem(file))}", *lines)


def write_shot(
    file,
    groom_file,
    *,
    frames,
    frames_per_second,
    quality,
    wind=(0.0, 0.0, 0.0),
    gust=0.0,
    skin=None,
):
    """A shot of a groom. wind: m/s, with z up (`with_z_up`). gust: of the wind, a share of it.
    skin: USD file and path of the mesh that moves the roots; None: they stand."""
    x, y, z = wind
    speed = (x * x + y * y + z * z) ** 0.5
    lines = [
        f"name = {_text(_stem(file))}",
        f"groom = {_text(os.path.abspath(groom_file))}",
        f"frames = [{int(frames[0])}, {int(frames[1])}]",
        f"frames_per_second = {float(frames_per_second)!r}",
        f"quality = {_text(quality)}",
    ]
    if speed > 0.0:
        direction = f"direction = [{x!r}, {y!r}, {z!r}]"
        lines += ["[wind]", direction, f"speed = {speed!r}", f"gust = {gust!r}"]
    if skin is not None:
        usd, prim = os.path.abspath(skin[0]), skin[1]
        lines += ["[skin]", f"usd = {_text(usd)}", f"prim = {_text(prim)}"]
    _write(file, *lines)


def with_z_up(vector, up_axis):
    """A vector of a host in featherfx's axes, as the stage's up axis says."""
    x, y, z = vector
    return (x, y, z) if up_axis == "Z" else (x, -z, y)


def _text(value):
    return json.dumps(value, ensure_ascii=False)  # as TOML has it


def _stem(file):
    return os.path.basename(file).split(".")[0]


def _write(file, *lines):
    Path(file).write_text("\n".join(lines) + "\n", encoding="utf-8")


def report(file):
    """Return the report of `featherfx inspect` about a stage."""
    return json.loads(Run("inspect", file, "--json").finish())
