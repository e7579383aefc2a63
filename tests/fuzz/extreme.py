"""Random extreme shots: each ends in time, finite, and with a word about each bound that it passes.

One to five feathers of 1 mm to 3 m; roots that jump, shake at up to 50 g, or stand in wind of up to
80 m/s; 1 to 1,000 frames a second; mirrored, in contact, with colliders at speed, hooks that open
and water. Each is baked by a process of its own, with the bounds of the other kinds (cases.py).
Stretch is measured here anew, from the points of the cache.
"""

from __future__ import annotations

import json
import math
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pxr import Usd, UsdGeom

from .cases import Failure, Found, nothing

# name, and length at scale 1, m
KINDS = {"covert": 0.05, "down": 0.02, "swan_primary": 0.35, "tail_feather": 0.13, "bristle": 0.01}
RATES = (1, 12, 24, 25, 60, 240, 1000)
FRAMES = 24
SECONDS = 120.0  # of processor time, for a shot of 24 frames
MAX_STRETCH = 0.0101  # of the length of a rachis, beyond which a word is due
BALL = """#usda 1.0
( metersPerUnit = 1
  upAxis = "Z"
  timeCodesPerSecond = {rate} )
def Mesh "ball"
{{
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [
        0, 1, 3, 2, 2, 3, 5, 4, 4, 5, 7, 6, 6, 7, 1, 0, 1, 7, 5, 3, 6, 0, 2, 4
    ]
    point3f[] points = [{points}]
    uniform token subdivisionScheme = "none"
    double3 xformOp:translate.timeSamples = {{ {places} }}
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
"""
CORNERS = ((-1, -1, 1), (1, -1, 1), (-1, 1, 1), (1, 1, 1), (-1, 1, -1), (1, 1, -1), (-1, -1, -1),
           (1, -1, -1))  # fmt: skip


class Scene(NamedTuple):
    """What became of a shot. stretch: of the rest length, the largest of a rachis; told: whether a
    warning or error was given; seconds: of processor time."""

    number: int
    outcome: str
    stretch: float
    told: bool
    seconds: float
    said: str


def run(cases: Sequence[int], seed: int, keep: Path | None = None) -> Iterator[Found]:
    """Outcomes of each shot by name.

    done: finite, in time, and no bound passed without a word. named: an error that names feather,
    frame and reason. silent, slow, broken: what must not be. keep: takes the folders of such cases.
    """
    for number in cases:
        result = nothing()
        with tempfile.TemporaryDirectory() as name:
            scene = bake_scene(random.Random(f"{seed} {number}"), number, Path(name))
            if scene.outcome not in ("done", "named"):
                shot = (Path(name) / "shot.toml").read_text()
                result.failures.append(Failure(number, f"{scene}\n{shot}"))
                if keep is not None:
                    keep.mkdir(parents=True, exist_ok=True)
                    Path(name).rename(keep / f"{seed}_{number}")
                    Path(name).mkdir()
        result.outcomes[scene.outcome] += 1
        result.through.append(number)
        yield result


def bake_scene(chance: random.Random, number: int, folder: Path) -> Scene:
    """Write a shot, bake it, and look at the cache."""
    write_scene(chance, folder)
    cache, report = folder / "o.usdc", folder / "o.json"
    command = [sys.executable, "-m", "featherfx", "bake", str(folder / "shot.toml")]
    command += ["-o", str(cache), "--report", str(report), "--jobs", "1"]
    before, begin = os.times(), time.monotonic()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=900.0, check=False)
    except subprocess.TimeoutExpired:
        return Scene(number, "slow", 0.0, False, time.monotonic() - begin, "")
    after = os.times()
    seconds = after.children_user + after.children_system
    seconds -= before.children_user + before.children_system
    lines = [line for line in done.stderr.splitlines() if line.startswith("featherfx: ")]
    said = "\n".join(line for line in lines if not line.startswith("featherfx: read "))
    if done.returncode:
        named = done.returncode == 1 and "Traceback" not in done.stderr and said
        outcome = "named" if named else "broken"
        return Scene(number, outcome, 0.0, bool(named), seconds, said or done.stderr[-2000:])
    finite, stretch = measure_cache(cache)
    told = bool(json.loads(report.read_text())["bounds_passed"]) and "warning: " in said
    outcome = "done" if stretch <= MAX_STRETCH or told else "silent"
    if seconds > SECONDS:
        outcome = "slow"
    return Scene(number, outcome if finite else "broken", stretch, told, seconds, said)


def measure_cache(cache: Path) -> tuple[bool, float]:
    """Whether all points of a cache are finite, and the largest relative change of the length of a
    rachis."""
    stage, finite, worst = Usd.Stage.Open(str(cache)), True, 0.0
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Mesh) or not prim.HasAttribute("primvars:st"):
            continue
        rest = np.array(prim.GetAttribute("primvars:rest").Get(), dtype=float)
        st = np.array(prim.GetAttribute("primvars:st").Get(), dtype=float)
        row = np.where(st[:, 0] == 0.5, st[:, 1], np.nan)
        length = length_of_rachis(rest, row)
        attribute = UsdGeom.Mesh(prim).GetPointsAttr()
        for code in attribute.GetTimeSamples():
            points = np.array(attribute.Get(code), dtype=float)
            finite &= bool(np.isfinite(points).all())
            rounding = np.finfo(np.float32).eps * np.abs(points).max() * len(points) ** 0.5
            off = abs(length_of_rachis(points, row) - length) - rounding
            worst = max(worst, float(off / length))
    return finite, worst


def length_of_rachis(points: Any, row: Any) -> float:
    """Length of the line through the middles of the points of each row; row: NaN off the rachis."""
    rows = np.unique(row[np.isfinite(row)])
    line = np.array([points[row == each].mean(axis=0) for each in rows])
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def write_scene(chance: random.Random, folder: Path) -> None:
    """Write a groom, a shot and a collider."""
    length = 10.0 ** chance.uniform(-3.0, math.log10(3.0))
    count, rate = chance.randint(1, 5), chance.choice(RATES)
    lines = ['name = "extreme"', "[[joint]]", 'name = "root"', "position = [0, 0, 0]"]
    for number in range(count):
        kind = chance.choice(sorted(KINDS))
        shaft = [round(chance.gauss(0.0, 1.0), 3) for _ in range(3)]
        up = np.cross(shaft, [chance.gauss(0.0, 1.0) for _ in range(3)]).round(4).tolist()
        place = [round(0.5 * length * chance.gauss(0.0, 1.0), 5) for _ in range(3)]
        lines += ["[[feather]]", f'id = "left_{number}"', f'kind = "{kind}"', f"up = {up}"]
        lines += [f"position = {place}", f"direction = {shaft}", 'joint = "root"']
        lines.append(f"scale = {min(max(length / KINDS[kind], 0.01), 100.0):.6f}")
        if chance.random() < 0.3:
            lines.append('overrides = { vane_material.hooks = "open" }')
    (folder / "groom.toml").write_text("\n".join(lines) + "\n")
    quality = chance.choice(["draft", "draft", "preview"])
    lines = ['name = "extreme"', 'groom = "groom.toml"', f"frames = [1, {FRAMES}]"]
    lines += [f"frames_per_second = {rate}", f'quality = "{quality}"']
    if chance.random() < 0.4:
        lines.append("[contact]")
    if chance.random() < 0.3:
        points = ", ".join(str(tuple(0.5 * length * x for x in corner)) for corner in CORNERS)
        way = [chance.choice([0.0, 10.0 ** chance.uniform(-1.0, 1.9)]) / rate for _ in range(2)]
        steps = (f"{k}: ({k * way[0] - 5 * way[0]}, {way[1] * k}, 0)" for k in range(1, FRAMES + 1))
        places = ", ".join(steps)
        text = BALL.format(rate=rate, points=points, places=places)
        (folder / "ball.usda").write_text(text)
        if "[contact]" not in lines:
            lines.append("[contact]")
        lines += ["[[collider]]", 'usd = "ball.usda"', 'prims = ["/ball"]']
    lines += ["[wind]", 'base = "gust"', f"speed = {chance.choice([0, 10, 80])}"]
    if chance.random() < 0.2:
        lines += ["[[wet]]", 'feathers = "left_*"', "keys = [[0, 1], [1, 0.2]]"]
    lines += write_motion(chance, length, FRAMES / rate)
    (folder / "shot.toml").write_text("\n".join(lines) + "\n")


def write_motion(chance: random.Random, length: float, seconds: float) -> list[str]:
    """Lines of a motion: roots that jump from place to place, or shake; or none."""
    what = chance.random()
    if what < 0.4:
        frequency = 10.0 ** chance.uniform(-0.5, 1.5)
        amplitude = chance.choice([1.0, 5.0, 50.0]) * 9.81 / (2.0 * math.pi * frequency) ** 2
        lines = ["[motion]", 'kind = "shake"', f"frequency = {frequency:.4f}"]
        return [*lines, f"amplitude = {min(amplitude, 10.0):.6f}", "direction = [1, 0.2, 1]"]
    if what < 0.8:
        lines = ["[motion]", 'kind = "keys"', "keyframes = ["]
        for number in range(chance.randint(2, 5)):
            place = [round(chance.choice([0.1, 10.0]) * length * chance.uniform(-1, 1), 5)]
            place += [round(length * chance.uniform(-1, 1), 5) for _ in range(2)]
            turned = [chance.choice([0, 90, 180, 350]) for _ in range(3)]
            at = round(seconds * (number + chance.choice([0.001, 0.5])) / 5.0, 6)
            lines.append(
                f'  {{ time = {at}, joint = "root", position = {place}, rotation = {turned} }},'
            )
        return [*lines, "]"]
    return []
