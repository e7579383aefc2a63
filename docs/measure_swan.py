"""Prints what a swan's plumage costs, as docs/plumage.md has it: a skin that moves, wind, guides,
layers.

python docs/measure_swan.py FEATHERS... [--frames N] [--folder FOLDER] [--jobs N] [--as condensed]

The inputs are made in FOLDER/FEATHERS, by default in one that is removed: body.usdc, groom.toml and
shot.toml, which `featherfx bake` takes. Feathers are as long as so many of them cover the body
alike, so what lies over what is the same for every number.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt
from scipy.interpolate import CubicSpline

from featherfx.baking.bake import bake
from featherfx.errors import InputWarning

# from the tail to the tip of the beak: x and z of the middle, radius, m
SPINE = np.array(
    [
        (-0.52, 0.15, 0.010), (-0.42, 0.14, 0.060), (-0.20, 0.12, 0.150), (0.06, 0.11, 0.170),
        (0.26, 0.16, 0.120), (0.35, 0.28, 0.060), (0.33, 0.44, 0.040), (0.34, 0.60, 0.034),
        (0.42, 0.69, 0.036), (0.50, 0.68, 0.024), (0.56, 0.66, 0.008),
    ]
)  # fmt: skip
RINGS, AROUND, FRAMES, RATE = 220, 64, 96, 24
# length of a feather where 25,000 of them cover the body, m, and the swan's own number
LENGTH, OWN = 0.035, 25_000
GROOM = """name = "swan"
[skin]
usd = "body.usdc"
prim = "/swan"
[layout]
most_tilt = 30
least_size = 0.5
drop = 2e-4
"""
REGION = """[[region]]
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
# share of the feathers, and length over LENGTH
REGIONS = {"neck": (0.45, 0.6), "body": (0.55, 1.0)}
SHOT = """name = "swan"
groom = "groom.toml"
frames = [1, {frames}]
quality = {{ base = "draft", max_substeps = 16 }}
wind = {{ base = "breeze", direction = [-1, 0.3, 0] }}
[skin]
usd = "body.usdc"
prim = "/swan"
[[shelter]]
share = 0
[[shelter]]
kind = "body_contour"
share = 0.7
[contact]
forces = false
[[detail]]
kind = "body_contour"
level = "guided"
every = 8
"""


def spine(time: float) -> np.ndarray:
    """(RINGS, 4) x, y, z of the middle and radius, m, at a time in s: the neck sways."""
    knots = np.insert(SPINE, 1, 0.0, axis=1)
    part = np.arange(len(knots)) / (len(knots) - 1)
    neck = np.clip((part - 0.4) / 0.6, 0.0, 1.0) ** 2
    knots[:, 1] += 0.06 * neck * np.sin(2.0 * np.pi * 0.5 * time)
    knots[:, 0] += 0.03 * neck * np.sin(2.0 * np.pi * 0.75 * time)
    knots[:, 2] += 0.01 * np.sin(2.0 * np.pi * 0.4 * time)
    return np.asarray(CubicSpline(part, knots)(np.linspace(0.0, 1.0, RINGS)))


def skin(time: float) -> np.ndarray:
    """(RINGS * AROUND + 2, 3) m, points of a closed tube around the spine."""
    line = spine(time)
    middle, radius = line[:, :3], np.maximum(line[:, 3], 0.004)
    along = np.gradient(middle, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross([0.0, 1.0, 0.0], along)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    ways = (
        np.cos(angle)[:, None] * side[:, None]
        + np.sin(angle)[:, None] * np.cross(along, side)[:, None]
    )
    rings = middle[:, None] + radius[:, None, None] * ways
    ends = middle[0] - 0.004 * along[0], middle[-1] + 0.004 * along[-1]
    return np.concatenate([rings.reshape(-1, 3), np.stack(ends)])


def faces() -> tuple[list[int], list[int]]:
    """Corners of each face, and the points of all, counter-clockwise seen from outside."""
    first = np.arange((RINGS - 1) * AROUND)
    after = first - first % AROUND + (first + 1) % AROUND
    sides = np.stack([first, after, after + AROUND, first + AROUND], axis=1)
    ring = np.arange(AROUND)
    beside, last = (ring + 1) % AROUND, (RINGS - 1) * AROUND
    tail = np.stack([np.full(AROUND, RINGS * AROUND), beside, ring], axis=1)
    beak = np.stack([np.full(AROUND, RINGS * AROUND + 1), last + ring, last + beside], axis=1)
    counts = [4] * len(sides) + [3] * (2 * AROUND)
    return counts, np.concatenate([each.ravel() for each in (sides, tail, beak)]).tolist()


def write_skin(path: Path, frames: int) -> None:
    """The skin with its motion, and where its regions are."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.SetTimeCodesPerSecond(RATE)
    mesh = UsdGeom.Mesh.Define(stage, "/swan")
    stage.SetDefaultPrim(mesh.GetPrim())
    counts, points = faces()
    mesh.CreateFaceVertexCountsAttr(counts)
    mesh.CreateFaceVertexIndicesAttr(points)
    place = mesh.CreatePointsAttr()
    place.Set(Vt.Vec3fArray.FromNumpy(skin(0.0).astype(np.float32)))
    for frame in range(frames):
        moved = skin(frame / RATE).astype(np.float32)
        place.Set(Vt.Vec3fArray.FromNumpy(moved), frame + 1.0)
    part = np.append(np.repeat(np.linspace(0.0, 1.0, RINGS), AROUND), [0.0, 1.0])
    neck = np.clip((part - 0.42) / 0.06, 0.0, 1.0)
    bare = np.clip((0.93 - part) / 0.02, 0.0, 1.0)
    api = UsdGeom.PrimvarsAPI(mesh)
    for name, values in (("neck", neck * bare), ("body", 1.0 - neck)):
        primvar = api.CreatePrimvar(name, Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
        primvar.Set(Vt.FloatArray.FromNumpy(values.astype(np.float32)))
    back = -np.gradient(spine(0.0)[:, :3], axis=0)
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    flow = np.concatenate([np.repeat(back, AROUND, axis=0), back[[0, -1]]])
    primvar = api.CreatePrimvar("flow", Sdf.ValueTypeNames.Vector3fArray, UsdGeom.Tokens.vertex)
    primvar.Set(Vt.Vec3fArray([Gf.Vec3f(*map(float, each)) for each in flow]))
    stage.GetRootLayer().Export(str(path))


def write_inputs(folder: Path, feathers: int, frames: int) -> Path:
    """Body, groom and shot of so many feathers; returns the shot's path."""
    write_skin(folder / "body.usdc", frames)
    length = LENGTH * (OWN / feathers) ** 0.5
    regions = [
        REGION.format(
            name=name,
            count=round(share * feathers),
            length=relative * length,
            room=0.3 * relative * length,
            soft=0.15 * relative * length,
        )
        for name, (share, relative) in REGIONS.items()
    ]
    (folder / "groom.toml").write_text(GROOM + "".join(regions))
    (folder / "shot.toml").write_text(SHOT.format(frames=frames))
    return folder / "shot.toml"


def measure(feathers: int, frames: int, folder: Path, **options: Any) -> None:
    shot = write_inputs(folder, feathers, frames)
    begin, processor = time.perf_counter(), time.process_time()
    at: list[float] = []
    report = bake(
        shot,
        folder / "swan.usdc",
        overwrite=True,
        on_frame=lambda *_: at.append(time.process_time()),
        **options,
    )
    wall, spent = time.perf_counter() - begin, time.process_time() - processor
    count = report["feathers"]
    seconds = {name: round(value, 1) for name, value in report["seconds"].items()}
    inputs = {shot, folder / "groom.toml", folder / "body.usdc"}
    files = {path for path in folder.rglob("*") if path.is_file()}
    written = sum(path.stat().st_size for path in files - inputs)
    print(f"{count} feathers, {frames} frames: {wall:.1f} s, {spent:.1f} s of processor time,")
    print(
        f"  {at[1] - processor:.1f} s of it until the first frame was done; {json.dumps(seconds)}"
    )
    if frames > 1:
        # the first call says that nothing is done, the last one that all is
        each = 1e3 * (at[-1] - at[1]) / (count * (frames - 1))
        print(f"  {each:.2f} ms of processor time for a feather and further frame")
    memory = report["peak_memory_bytes"] / 1e9
    print(
        f"  {memory:.2f} GB of memory, {1e-3 * written / (count * frames):.2f} kB written of each"
    )
    contact = report["contact"]
    depths = json.dumps({name: round(x, 2) for name, x in contact["written_depth"].items()})
    print(f"  {contact['pairs_touching']} touching pairs, thicknesses deep: {depths}", flush=True)


def main() -> None:
    warnings.simplefilter("ignore", InputWarning)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("feathers", type=int, nargs="+")
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--as", dest="form", default="mesh")
    given = parser.parse_args()
    group = "region" if given.form == "condensed" else None
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        for feathers in given.feathers:
            own = folder / str(feathers)
            own.mkdir(parents=True, exist_ok=True)
            measure(feathers, given.frames, own, jobs=given.jobs, form=given.form, group=group)


if __name__ == "__main__":
    main()
