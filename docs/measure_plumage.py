"""Prints the figures of static plumage in docs/plumage.md.

python docs/measure_plumage.py [FEATHERS]     default 25,000, a swan's count
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
import trimesh
from pxr import Usd, UsdGeom, Vt

from featherfx.api import read_groom, scene_readers
from featherfx.baking.pipeline import export_groom
from featherfx.errors import InputWarning
from featherfx.feather.layout.layout import laid_out, measure_layout
from featherfx.groom.read.read import read_groom as read_placed

REGION = """
[[region]]
id = "{name}"
kind = "body_contour"
count = {count}
length = {length}
follow = 1
variants = 8
where = [{{ x = {span}, soft = 0.1 }}]
flow = {{ away = [0.5, 0, 0.1] }}
variation = {{ length = 0.05, curl = 2, turn = 4, roll = 2 }}
"""
SPANS = {"front": "[0.15, 9]", "middle": "[-0.15, 0.15]", "back": "[-9, -0.15]"}


def write_skin(path: Path) -> None:
    """An egg of 1 m, as large as a swan's body."""
    mesh = trimesh.creation.icosphere(5, radius=1.0)
    points = np.array(mesh.vertices) * (0.45, 0.22, 0.2)
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, "Z")
    skin = UsdGeom.Mesh.Define(stage, "/egg")
    skin.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    skin.CreateFaceVertexCountsAttr([3] * len(mesh.faces))
    faces = np.array(mesh.faces, dtype=np.int32).ravel()
    skin.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces))
    stage.GetRootLayer().Save()


def timed(name: str, task):
    begin, processor = time.perf_counter(), time.process_time()
    result = task()
    wall, spent = time.perf_counter() - begin, time.process_time() - processor
    print(f"{name}: {wall:.1f} s wall, {spent:.1f} s of processor time", flush=True)
    return result


def written(groom: Path, output: Path, quality: str, instances: bool) -> None:
    """Write a groom and print time and size."""
    form = "instances" if instances else "plain meshes"
    timed(
        f"groom to USD, {quality}, {form}",
        lambda: export_groom(groom, output, quality=quality, instances=instances),
    )
    print(f"  {output.stat().st_size / 1e6:.1f} MB", flush=True)


def main() -> None:
    warnings.simplefilter("ignore", InputWarning)
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 25_000
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        write_skin(home / "skin.usdc")
        regions = "".join(
            REGION.format(name=name, span=span, count=count // 3, length=0.035)
            for name, span in SPANS.items()
        )
        groom = home / "groom.toml"
        head = 'name = "egg"\n[skin]\nusd = "skin.usdc"\nprim = "/egg"\n[layout]\n'
        groom.write_text(head + regions)
        print(f"{count} feathers, load {os.getloadavg()[0]:.1f}")
        read_groom(groom)  # compiles
        placed = timed("scatter", lambda: read_placed(groom, (), scene_readers()))
        before = measure_layout(placed)
        _, report = timed("layout", lambda: laid_out(placed))
        for name, found in (("before", before), ("after", report)):
            through = int((found.gaps < 0).sum())
            print(
                f"{name}: {through} of {len(found.gaps)} pairs pass through each other,"
                f" 95 % of pairs by less than {-1e3 * np.percentile(found.gaps, 5):.2f} mm,"
                f" {int((found.skin_gaps < 0).sum())} feathers enter the skin"
            )
        written(groom, home / "draft.usdc", "draft", True)
        written(groom, home / "final.usdc", "final", True)
        written(groom, home / "plain.usdc", "draft", False)


if __name__ == "__main__":
    main()
