"""Bakes killed at seeded times and resumed, compared byte by byte with undisturbed ones."""

from __future__ import annotations

import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from .cases import Failure, Found, nothing

SHOT = Path(__file__).resolve().parents[2] / "samples/feather_pull/shot.toml"
LAYOUTS = ("clips", "flat", "payload")
MAX_KILLS = 3  # of one bake before it is left in peace
SECONDS = 120  # beyond which a bake hangs


def run(cases: Sequence[int], seed: int, keep: Path | None = None) -> Iterator[Found]:
    """Outcomes of each case by name.

    done: a bake that was killed and resumed is the same, byte by byte, with no file more. killed:
    bakes that a kill hit. differs, stray, refused, hang: what must not be. keep: takes the folders
    of such cases.
    """
    with tempfile.TemporaryDirectory() as name:
        whole = Path(name)
        expected, seconds = {}, {}
        for layout in LAYOUTS:
            folder = whole / layout
            folder.mkdir()
            _bake(folder, layout)  # compiles what is not compiled yet
            shutil.rmtree(folder)
            folder.mkdir()
            begin = time.monotonic()
            assert _bake(folder, layout) == 0
            seconds[layout] = time.monotonic() - begin
            expected[layout] = _tree(folder)
        for number in cases:
            result = nothing()
            outcomes = result.outcomes
            chance = random.Random(f"{seed} {number}")
            layout = LAYOUTS[number % len(LAYOUTS)]
            folder = whole / f"case{number}"
            folder.mkdir()
            for _ in range(chance.randint(1, MAX_KILLS)):
                outcomes["killed"] += _killed(folder, layout, chance, seconds[layout])
            end = _end(folder, layout, expected[layout])
            outcomes[end] += 1
            if end != "done":
                result.failures.append(Failure(number, f"{layout}: {end}"))
                if keep is not None:
                    shutil.copytree(folder, keep / f"{seed}_{number}", dirs_exist_ok=True)
            shutil.rmtree(folder)
            result.through.append(number)
            yield result


def _command(folder: Path, layout: str) -> list[str]:
    arguments = ["bake", str(SHOT), "-o", str(folder / "o.usdc"), "--layout", layout, "--resume"]
    arguments += ["--quality", "draft", "--chunk", "2", "--jobs", "1", "--progress", "json"]
    return [sys.executable, "-m", "featherfx", *arguments]


def _bake(folder: Path, layout: str) -> int:
    done = subprocess.run(
        _command(folder, layout), capture_output=True, text=True, timeout=SECONDS, check=False
    )
    if done.returncode:
        print(done.stderr, flush=True)
    return done.returncode


def _killed(folder: Path, layout: str, chance: random.Random, seconds: float) -> bool:
    """Whether a kill hit: at any time of a bake, or more often after its first frames."""
    process = subprocess.Popen(_command(folder, layout), stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    if chance.random() < 0.75:
        wanted = chance.randint(1, 25)
        for line in process.stderr:
            if line.startswith("{") and json.loads(line)["done"] >= wanted:
                break
        wait = chance.uniform(0.0, 0.1 * seconds)
    else:
        wait = chance.uniform(0.0, seconds)
    # so that a full pipe does not hold it up
    threading.Thread(target=process.stderr.read, daemon=True).start()
    try:
        process.wait(wait)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
    return process.wait() == -signal.SIGKILL


def _end(folder: Path, layout: str, expected: dict[str, bytes]) -> str:
    """What a resumed bake comes to."""
    try:
        if _bake(folder, layout):
            return "refused"
    except subprocess.TimeoutExpired:
        return "hang"
    found = _tree(folder)
    if found.keys() != expected.keys():
        print(sorted(found.keys() ^ expected.keys()), flush=True)
        return "stray"
    return "done" if found == expected else "differs"


def _tree(folder: Path) -> dict[str, bytes]:
    files = (file for file in sorted(folder.rglob("*")) if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}
