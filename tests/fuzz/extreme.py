"""Random extreme shots: each ends in time, finite, and with a word about each bound that it passes.

One to three feathers of 1 mm to 3 m; roots that jump, shake at up to 50 g, or stand in wind of up
to 80 m/s; 1 to 1,000 frames a second; mirrored, in contact, with colliders at speed, hooks that
open and water. Stretch and speed are measured here anew, from the points of the cache.
"""

from __future__ import annotations

import json
import math
import re
import shutil
import warnings
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from featherfx.api import read_shot
from featherfx.shot.loop.simulate import simulate

from .cases import Command, Kind

# name, and length at scale 1, m
KINDS = {"covert": 0.05, "down": 0.02, "swan_primary": 0.35, "tail_feather": 0.13, "bristle": 0.01}
RATES = (1, 12, 24, 25, 60, 240, 1000)
FRAMES = 24
SIZE = 10.0  # of a scene, in lengths of its feathers
WARM_SEEDS = 5, 9, 27, 38, 43  # of scenes in air, in water and in contact
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
NUMBERS = 'base = "draft"\nsimulated_rows = 7\nsimulated_columns = 3\ntolerance = 1e-3\n'
CORNERS = ((-1, -1, 1), (1, -1, 1), (-1, 1, 1), (1, 1, 1), (-1, 1, -1), (1, 1, -1), (-1, -1, -1),
           (1, -1, -1))  # fmt: skip


def damage(random: np.random.Generator, number: int, folder: Path) -> tuple[str, Sequence[Command]]:
    """Write a shot and bake it."""
    write_scene(Random(int(random.integers(1 << 62))), folder)
    bake = ("bake", "shot.toml", "-o", "o.usdc", "--report", "o.json", "--jobs", "1")
    bake += ("--presets", "presets")
    return "extreme", [Command(bake, ("o.usdc", "o.json"))]


def load_kernels(folder: Path) -> None:
    """Simulate three frames of scenes without a collider, whose stage would start threads."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for seed in WARM_SEEDS:
            scene = folder / f"warm{seed}"
            scene.mkdir()
            write_scene(Random(seed), scene)
            shot = read_shot(scene / "shot.toml", [scene / "presets"])
            list(simulate(shot, 1, (1, 3)))
            shutil.rmtree(scene)


def judge_cache(folder: Path, said: str) -> str:
    """Name what must not be: points that are not finite, a bound that is passed without a word,
    or motion from nothing."""
    finite, stretch, speed = measure_cache(folder / "o.usdc")
    report = json.loads((folder / "o.json").read_text())
    if not finite:
        return "not finite"
    if stretch > MAX_STRETCH and not (report["bounds_passed"] and "warning: " in said):
        return f"silent stretch {stretch:.4f}"
    if is_still(shot := (folder / "shot.toml").read_text()):
        fall = (2.0 * 9.81 * SIZE * float(find_value(shot, "length"))) ** 0.5
        if speed > fall:
            return f"motion from nothing: {speed:.3g} m/s, a fall has {fall:.3g} m/s"
    return ""


def is_still(shot: str) -> bool:
    """Whether nothing drives the feathers of a shot."""
    return not re.search(r"\[motion|\[collider|\[wet", shot) and find_value(shot, "speed") == "0"


def find_value(shot: str, key: str) -> str:
    """The first value of a key in a shot's text."""
    found = re.search(rf"^(?:# )?{key} = (.*)$", shot, re.M)
    assert found, key
    return found[1]


def measure_cache(cache: Path) -> tuple[bool, float, float]:
    """Whether all points of a cache are finite, the largest relative change of the length of a
    rachis, and the largest speed of a point, m/s."""
    from pxr import Usd, UsdGeom  # else all cases would share its threads

    stage, finite, worst, fastest = Usd.Stage.Open(str(cache)), True, 0.0, 0.0
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Mesh) or not prim.HasAttribute("primvars:st"):
            continue
        rest = np.array(prim.GetAttribute("primvars:rest").Get(), dtype=float)
        st = np.array(prim.GetAttribute("primvars:st").Get(), dtype=float)
        row = np.where(st[:, 0] == 0.5, st[:, 1], np.nan)
        length = length_of_rachis(rest, row)
        attribute = UsdGeom.Mesh(prim).GetPointsAttr()
        before = None
        for code in attribute.GetTimeSamples():
            points = np.array(attribute.Get(code), dtype=float)
            if before is not None:
                way = np.linalg.norm(points - before, axis=1).max()
                fastest = max(fastest, float(way) * stage.GetTimeCodesPerSecond())
            before = points
            finite &= bool(np.isfinite(points).all())
            rounding = np.finfo(np.float32).eps * np.abs(points).max() * len(points) ** 0.5
            off = abs(length_of_rachis(points, row) - length) - rounding
            worst = max(worst, float(off / length))
    return finite, worst, fastest


def length_of_rachis(points: Any, row: Any) -> float:
    """Length of the line through the middles of the points of each row; row: NaN off the rachis."""
    rows = np.unique(row[np.isfinite(row)])
    line = np.array([points[row == each].mean(axis=0) for each in rows])
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def write_scene(chance: Random, folder: Path) -> None:
    """Write a groom, a shot and a collider."""
    length = 10.0 ** chance.uniform(-3.0, math.log10(3.0))
    count, rate = chance.choice([1, 1, 1, 2, 2, 3]), chance.choice(RATES)
    lines = ['name = "extreme"', "[[joint]]", 'name = "root"', "position = [0, 0, 0]"]
    for number in range(count):
        kind = chance.choice(sorted(KINDS))
        shaft = [round(chance.gauss(0.0, 1.0), 3) for _ in range(3)]
        up = np.cross(shaft, [chance.gauss(0.0, 1.0) for _ in range(3)]).round(4).tolist()
        place = [round(0.5 * length * chance.gauss(0.0, 1.0), 5) for _ in range(3)]
        lines += ["[[feather]]", f'id = "left_{number}"', f'kind = "{kind}"', f"up = {up}"]
        lines += [f"position = {place}", f"direction = {shaft}", 'joint = "root"']
        lines.append(f"scale = {min(max(length / KINDS[kind], 0.01), 100.0):.6f}")
        if chance.random() < 0.2:
            lines += ['side = "left"', 'mirror = "y"']
        if chance.random() < 0.3:
            lines.append('overrides = { vane_material.hooks = "open" }')
    (folder / "groom.toml").write_text("\n".join(lines) + "\n")
    # most promise no error, since measuring it takes longer than the bake
    quality = chance.choice([*["numbers"] * 8, "draft", "preview"])
    (folder / "presets/quality").mkdir(parents=True)
    (folder / "presets/quality/numbers.toml").write_text(NUMBERS)
    lines = [
        f"# length = {length:.6f}",
        'name = "extreme"',
        'groom = "groom.toml"',
        f"frames = [1, {FRAMES}]",
    ]
    lines += [f"frames_per_second = {rate}", f'quality = "{quality}"']
    if chance.random() < 0.3:
        lines.append("[contact]")
    if chance.random() < 0.15:
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


def write_motion(chance: Random, length: float, seconds: float) -> list[str]:
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


KIND = Kind(
    lambda _: None,
    damage,
    (
        "featherfx.baking.bake",
        "featherfx.baking.frame_loop",
        "featherfx.cli.bake",
        "featherfx.usd.check.judge",
        "featherfx.usd.write.cache_writer",
        "pxr.UsdGeom",
    ),
    judge_cache,
    load_kernels,
    seconds=120,
)
