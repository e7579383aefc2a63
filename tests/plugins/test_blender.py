"""Caches in Blender itself, by the bpy wheel (`pip install bpy==4.2.0`, Python 3.11).

BLENDER_PYTHON names the interpreter of an environment of its own that has it.
"""

import json
import os
import subprocess

import numpy as np
import pytest

from featherfx import bake
from featherfx.baking.install import copy_sample
from featherfx.usd.read.cache import Cache

pytestmark = pytest.mark.nightly

# prints what Blender holds: frames, objects by type, and the world points of one mesh by frame
SCRIPT = """
import json, sys
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.usd_import(filepath=sys.argv[1], set_frame_range=True, import_guide=True, scale=1.0)
scene = bpy.context.scene
mesh = next(each for each in scene.objects if each.name == sys.argv[2])
points, speeds = {}, {}
for frame in (1, 6, 12):
    scene.frame_set(frame)
    shown = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    points[frame] = [list(mesh.matrix_world @ vertex.co) for vertex in shown.vertices]
    speeds[frame] = [list(each.vector) for each in shown.attributes["velocity"].data]
types = [each.type for each in scene.objects]
found = {
    "frames": [scene.frame_start, scene.frame_end], "meshes": types.count("MESH"),
    "curves": types.count("CURVES"), "points": points, "velocities": speeds,
    "attributes": [each.name for each in mesh.data.attributes],
}
print("FOUND " + json.dumps(found))
"""


def test_blender_shows_meshes_curves_and_velocities_of_a_cache(tmp_path):
    if not (blender := os.environ.get("BLENDER_PYTHON")):
        pytest.skip("BLENDER_PYTHON names no Python with bpy")
    copy_sample("swan_wing", tmp_path / "wing")
    cache = tmp_path / "wing.usdc"
    bake(tmp_path / "wing/shot.toml", cache, frames=(1, 12))
    command = [blender, "-c", SCRIPT, str(cache), "left_primary_01"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    line = next(each for each in done.stdout.splitlines() if each.startswith("FOUND "))
    found = json.loads(line.removeprefix("FOUND "))
    assert (found["frames"], found["meshes"], found["curves"]) == ([1, 12], 20, 20)
    assert {"st", "rest", "side", "barbDirection", "velocity"} <= {*found["attributes"], "velocity"}
    ours = Cache(cache)
    index = [each.id for each in ours.feathers].index("left_primary_01")
    for frame in ("1", "6", "12"):
        np.testing.assert_allclose(
            found["points"][frame], ours.points(index, float(frame)), atol=1e-5
        )
        speeds = np.asarray(found["velocities"][frame])
        assert speeds.shape == ours.points(index, 1.0).shape
        assert np.isfinite(speeds).all()
    # motion blur goes along what is drawn: between frames velocities lead from one to the next
    assert np.abs(np.asarray(found["velocities"]["6"])).max() > 0.1
