"""Measurements of `featherfx lab measure`: packages, compiling, scaled feathers, and plumage whose
size is a number."""

from __future__ import annotations

import ast
import json
import math
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import trimesh
from scipy.interpolate import CubicSpline

from featherfx.api import read_shot
from featherfx.feather.build import build_feather
from featherfx.files.disk_cache import nothing_kept
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.jit.compile_workers import SECONDS
from featherfx.jit.compiled import ARGUMENTS, KernelEntry
from featherfx.jit.kernel_calls import describe_arguments
from featherfx.lab.feather import feather_kind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.shot.loop.simulate import simulate
from featherfx.solver.damping import frequencies
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import State, rest_state

_COLUMNS = "files", "lines"
_CHANGE = "Change here: "


def package_table(folder: Path) -> Iterator[str]:
    """Yield the lines of a Markdown table: each package, its counts, what it holds, what to change.

    The last two are the first line of a package's docstring and its line "Change here: ...".
    """
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for file in sorted(folder.rglob("*.py")):
        found = Counter(files=1, lines=len(file.read_text(encoding="utf-8").splitlines()))
        parents = file.relative_to(folder).parents
        for package in parents:
            if package.parent == Path() or (folder / package / "__init__.py").is_file():
                counts["all" if package == Path() else package.as_posix()] += found
    yield f"| package | {' | '.join(_COLUMNS)} | holds | change here |"
    yield "|---|" + "---|" * (len(_COLUMNS) + 2)
    for name, found in sorted(counts.items(), key=lambda each: (each[0] == "all", each)):
        start = folder / name / "__init__.py"
        text = ast.get_docstring(ast.parse(start.read_text("utf-8"))) if start.is_file() else ""
        lines = (text or "").splitlines()
        holds = lines[0] if lines else ""
        change = next((each for each in lines if each.startswith(_CHANGE)), "")[len(_CHANGE) :]
        numbers = " | ".join(f"{found[each]:,}" for each in _COLUMNS)
        yield f"| {name} | {numbers} | {holds} | {change} |"


CompiledEntry = tuple[str, float, float]


def write_calls(works: Mapping[str, Callable[[], None]]) -> Path:
    """Do some works, and write which kernels Python calls in each, and types of their arguments.

    Kernels that take arrays of records are left out: these have no text to make them of.
    """
    found: dict[str, dict[str, str]] = {}
    for work, do in works.items():
        calls: dict[str, str] = {}
        call = KernelEntry.__call__

        def listed(self: KernelEntry, *arguments: Any, calls: Any = calls, call: Any = call) -> Any:
            if self.name not in calls:
                calls[self.name] = describe_arguments(arguments)
            return call(self, *arguments)

        with patch.object(KernelEntry, "__call__", listed), nothing_kept():
            do()
        found[work] = {name: text for name, text in calls.items() if "[" not in text}
    ARGUMENTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return ARGUMENTS


def measure_entries(work: Callable[[], None]) -> list[CompiledEntry]:
    """Do a work, and return of each entry compiled its name, seconds of lowering and of LLVM."""
    from numba.core.codegen import JITCodeLibrary

    from featherfx.jit import compiler

    entries: list[CompiledEntry] = []
    own = threading.local()  # threads of a bake wait for each other's compiling
    compile_entry, finalize = compiler.compile_entry, JITCodeLibrary.finalize

    def compile_timed(kernel: Any, types: Any) -> Any:
        stack, begin = vars(own).setdefault("stack", []), time.thread_time()
        # of this entry: LLVM's seconds, and those of entries compiled meanwhile
        stack.append([0.0, 0.0])
        code = compile_entry(kernel, types)
        passed, (llvm, nested) = time.thread_time() - begin, stack.pop()
        if stack:
            stack[-1][1] += passed
        entries.append((kernel.name, passed - llvm - nested, llvm))
        return code

    def finalize_timed(self: Any) -> None:
        stack, begin = vars(own).get("stack"), time.thread_time()
        before = stack[-1][1] if stack else 0.0
        finalize(self)
        if stack:
            # loading code that calls others has these compiled first
            stack[-1][0] += time.thread_time() - begin - (stack[-1][1] - before)

    with (
        patch.object(compiler, "compile_entry", compile_timed),
        patch.object(JITCodeLibrary, "finalize", finalize_timed),
    ):
        work()
    return entries


def shot_entries(shot: Path) -> list[CompiledEntry]:
    """Return what simulating a shot compiles, largest first, with an empty cache."""

    def work() -> None:
        for _ in simulate(read_shot(shot), jobs=1):
            pass

    with tempfile.TemporaryDirectory() as folder:
        os.environ |= {"FEATHERFX_CACHE": folder, "FEATHERFX_COMPILERS": "1"}
        return sorted(measure_entries(work), key=lambda each: -each[1] - each[2])


def write_seconds(works: Iterable[str]) -> Path:
    """Write the file that the progress of compiling goes by; each work in its own process."""
    found = {}
    for name in works:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "featherfx", "lab", "measure", "compiling"]
            environment = os.environ | {"FEATHERFX_CACHE": folder, "FEATHERFX_COMPILERS": "1"}
            done = subprocess.run(
                [*command, "--work", name], env=environment, stdout=subprocess.PIPE, check=True
            )
        seconds: dict[str, float] = {}
        for entry, front, llvm in json.loads(done.stdout):
            count = sum(each.partition("#")[0] == entry for each in seconds)
            seconds[f"{entry}#{count + 1}" if count else entry] = round(front + llvm, 2)
        found[name] = seconds
    SECONDS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return SECONDS


_ROWS, _BARB_COLUMNS = 21, 6
_SIZES = (0.25, 0.5, 1.0, 2.0, 5.0)
_GRAVITY = (0.0, 0.0, -9.81)  # m/s^2


def _at_rest(solver: Solver) -> State:
    return rest_state(solver.model, np.zeros((1, 3)), np.eye(3)[None])


def scaling_rows(preset: str) -> Iterator[tuple[str, float, float, float, float]]:
    """Yield droop and first frequency of a feather held level, by scaling rule and size.

    Rule, size, droop of the tip and of the lowest barb below its root (feather lengths), Hz.
    """
    for rule in ("similar", "behaviour", "fixed_vane"):
        for size in _SIZES:
            kind = adjusted(replace(feather_kind(preset), scaling=rule), Change(scale=size))
            model = make_model([build_feather(kind, _ROWS, _BARB_COLUMNS)], [kind], 2)
            with Solver(model, Settings(newton=1e-7 * kind.length)) as solver:
                start = _at_rest(solver)
                state, status, _ = solver.equilibrium(start, no_loads(1, _GRAVITY))
            if status[0] != 0:
                raise RuntimeError(f"{preset}, {rule}, size {size}: found no equilibrium.")
            down = (start.points.nodes[0] - state.points.nodes[0])[..., 2] / kind.length
            barbs = (down[:, 1:] - down[:, :1]).max()
            yield rule, size, float(down[-1, 0]), float(barbs), frequencies(model, 0, 1)[0]


# from the tail to the tip of the beak: x and z of the middle, radius, m
_SPINE = np.array(
    [
        (-0.52, 0.15, 0.010), (-0.42, 0.14, 0.060), (-0.20, 0.12, 0.150), (0.06, 0.11, 0.170),
        (0.26, 0.16, 0.120), (0.35, 0.28, 0.060), (0.33, 0.44, 0.040), (0.34, 0.60, 0.034),
        (0.42, 0.69, 0.036), (0.50, 0.68, 0.024), (0.56, 0.66, 0.008),
    ]
)  # fmt: skip
_RINGS, _AROUND, _RATE = 220, 64, 24
_DENSITY = 25_000.0  # feathers per m^2 of a patch
# length of a feather where 25,000 of them cover the swan, m
_LENGTH, _SWAN_COUNT = 0.035, 25_000
# of the swan's regions: fraction of the feathers, and length over _LENGTH
_REGIONS = {"neck": (0.45, 0.6), "body": (0.55, 1.0)}

_PATCH_GROOM = """
name = "patch"
[skin]
usd = "body.usda"
prim = "/skin"
[layout]
[[region]]
id = "patch"
kind = "body_contour"
count = {count}
length = 0.035
follow = 1
variants = 8
where = [{{ sphere = [0, 0, 0.2, {radius}] }}]
flow = {{ direction = [-1, 0, 0] }}
variation = {{ length = 0.05, curl = 2, turn = 4, roll = 2 }}
"""
_PATCH_SHOT = """
name = "patch"
groom = "groom.toml"
frames = [1, {frames}]
quality = "draft"
motion = {{ base = "shake", amplitude = 0.01 }}
wind = {{ base = "breeze", direction = [-1, 0.2, 0] }}
[[shelter]]
share = 0.7
"""
_SWAN_GROOM = """
name = "swan"
[skin]
usd = "body.usda"
prim = "/skin"
[layout]
"""
_SWAN_REGION = """
[[region]]
id = "{name}"
kind = "body_contour"
count = {count}
length = {length:.5f}
tilt = 4
follow = 1
max_length_per_free_radius = 1.0
variants = 4
where = [{{ primvar = "{name}" }}, {{ free_radius = {room:.5f}, soft = {soft:.5f} }}]
flow = {{ primvar = "flow" }}
variation = {{ length = 0.05, curl = 2, turn = 4, roll = 3 }}
"""
_SWAN_SHOT = """
name = "swan"
groom = "groom.toml"
frames = [1, {frames}]
quality = {{ base = "draft", max_substeps = 16 }}
wind = {{ base = "breeze", direction = [-1, 0.3, 0] }}
[skin]
usd = "body.usda"
prim = "/skin"
[[shelter]]
share = 0
[[shelter]]
kind = "body_contour"
share = 0.7
[[detail]]
kind = "body_contour"
level = "guided"
every = 8
"""


def write_patch(folder: Path, count: int, frames: int) -> Path:
    """Write contour feathers of one density on a patch of an egg; returns the shot's path."""
    egg = trimesh.creation.icosphere(5, radius=1.0)
    points = np.array(egg.vertices) * (0.45, 0.22, 0.2)
    _write_mesh(folder / "body.usda", [3] * len(egg.faces), egg.faces.ravel(), [points])
    radius = math.sqrt(count / (math.pi * _DENSITY))
    (folder / "groom.toml").write_text(_PATCH_GROOM.format(count=count, radius=radius))
    (folder / "shot.toml").write_text(_PATCH_SHOT.format(frames=frames))
    return folder / "shot.toml"


def write_swan(folder: Path, count: int, frames: int) -> Path:
    """Write a swan with so many feathers: a skin that moves, wind, guides.

    Feathers are as long as so many of them cover the body alike. Returns the shot's path.
    """
    counts, corners = _tube_faces()
    part = np.append(np.repeat(np.linspace(0.0, 1.0, _RINGS), _AROUND), [0.0, 1.0])
    neck, bare = (np.clip(x, 0.0, 1.0) for x in ((part - 0.42) / 0.06, (0.93 - part) / 0.02))
    back = -np.gradient(_spine(0.0)[:, :3], axis=0)
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    flow = np.concatenate([np.repeat(back, _AROUND, axis=0), back[[0, -1]]])
    primvars = {"float[] neck": neck * bare, "float[] body": 1.0 - neck, "vector3f[] flow": flow}
    moved = [_tube(frame / _RATE) for frame in range(frames)]
    _write_mesh(folder / "body.usda", counts, corners, moved, primvars)
    length = _LENGTH * (_SWAN_COUNT / count) ** 0.5
    regions = [
        _SWAN_REGION.format(
            name=name,
            count=round(fraction * count),
            length=relative * length,
            room=0.3 * relative * length,
            soft=0.15 * relative * length,
        )
        for name, (fraction, relative) in _REGIONS.items()
    ]
    (folder / "groom.toml").write_text(_SWAN_GROOM + "".join(regions))
    (folder / "shot.toml").write_text(_SWAN_SHOT.format(frames=frames))
    return folder / "shot.toml"


def _spine(time: float) -> np.ndarray:
    """Return (RINGS, 4) x, y, z of the middle and radius, m, at a time in s: the neck sways."""
    knots = np.insert(_SPINE, 1, 0.0, axis=1)
    part = np.arange(len(knots)) / (len(knots) - 1)
    neck = np.clip((part - 0.4) / 0.6, 0.0, 1.0) ** 2
    knots[:, 1] += 0.06 * neck * np.sin(2.0 * np.pi * 0.5 * time)
    knots[:, 0] += 0.03 * neck * np.sin(2.0 * np.pi * 0.75 * time)
    knots[:, 2] += 0.01 * np.sin(2.0 * np.pi * 0.4 * time)
    return np.asarray(CubicSpline(part, knots)(np.linspace(0.0, 1.0, _RINGS)))


def _tube(time: float) -> np.ndarray:
    """Return (RINGS * AROUND + 2, 3) m, points of a closed tube around the spine."""
    line = _spine(time)
    middle, radius = line[:, :3], np.maximum(line[:, 3], 0.004)
    along = np.gradient(middle, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross([0.0, 1.0, 0.0], along)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    angle = 2.0 * np.pi * np.arange(_AROUND)[:, None] / _AROUND
    outward = np.cos(angle) * side[:, None] + np.sin(angle) * np.cross(along, side)[:, None]
    rings = middle[:, None] + radius[:, None, None] * outward
    ends = middle[0] - 0.004 * along[0], middle[-1] + 0.004 * along[-1]
    return np.concatenate([rings.reshape(-1, 3), np.stack(ends)])


def _tube_faces() -> tuple[list[int], np.ndarray]:
    """Return corners of each face, and the points of all, counter-clockwise from outside."""
    first = np.arange((_RINGS - 1) * _AROUND)
    after = first - first % _AROUND + (first + 1) % _AROUND
    sides = np.stack([first, after, after + _AROUND, first + _AROUND], axis=1)
    ring = np.arange(_AROUND)
    beside, last = (ring + 1) % _AROUND, (_RINGS - 1) * _AROUND
    tail = np.stack([np.full(_AROUND, _RINGS * _AROUND), beside, ring], axis=1)
    beak = np.stack([np.full(_AROUND, _RINGS * _AROUND + 1), last + ring, last + beside], axis=1)
    counts = [4] * len(sides) + [3] * (2 * _AROUND)
    return counts, np.concatenate([each.ravel() for each in (sides, tail, beak)])


def _write_mesh(
    path: Path,
    counts: Sequence[int],
    corners: np.ndarray,
    points: Sequence[np.ndarray],
    primvars: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write a mesh as text: its points (P, 3) m at frames from 1 on, and values of its points."""
    rest = "\n".join(
        f'    {name.replace(" ", " primvars:")} = {_values(values)} (interpolation = "vertex")'
        for name, values in (primvars or {}).items()
    )
    samples = ",\n".join(f"        {k}: {_values(each)}" for k, each in enumerate(points, 1))
    path.write_text(
        f"""#usda 1.0
(
    defaultPrim = "skin"
    metersPerUnit = 1
    timeCodesPerSecond = {_RATE}
    upAxis = "Z"
)
def Mesh "skin"
{{
    int[] faceVertexCounts = {list(counts)}
    int[] faceVertexIndices = {corners.tolist()}
    point3f[] points = {_values(points[0])}
    point3f[] points.timeSamples = {{
{samples}
    }}
{rest}
}}
"""
    )


def _values(array: np.ndarray) -> str:
    """Return numbers (N,) or tuples of numbers (N, 3) as text of USD."""
    texts = np.char.mod("%.7g", array).tolist()
    if array.ndim == 2:
        texts = [f"({', '.join(row)})" for row in texts]
    return f"[{', '.join(texts)}]"
