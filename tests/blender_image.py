"""Image of a cache in Blender: BLENDER_PYTHON tests/blender_image.py CACHE FRAME -o FILE.png."""

import math
import sys

import bpy
from mathutils import Vector

cache, frame, output = sys.argv[1], int(sys.argv[2]), sys.argv[sys.argv.index("-o") + 1]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.usd_import(filepath=cache, set_frame_range=True)
scene = bpy.context.scene
scene.frame_set(frame)
corners = [
    shown.matrix_world @ Vector(corner)
    for shown in scene.objects
    if shown.type == "MESH"
    for corner in shown.bound_box
]
low = [min(corner[k] for corner in corners) for k in range(3)]
high = [max(corner[k] for corner in corners) for k in range(3)]
middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
size = max(b - a for a, b in zip(low, high, strict=True))
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.location = (middle[0] + 1.6 * size, middle[1], middle[2] + 0.5 * size)
camera.rotation_euler = (math.radians(73), 0, math.radians(90))
sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
sun.data.energy, sun.rotation_euler = 4.0, (math.radians(40), math.radians(30), 0)
for each in (camera, sun):
    scene.collection.objects.link(each)
scene.camera = camera
scene.world = bpy.data.worlds.new("world")
scene.world.color = (0.4, 0.45, 0.5)
scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 32, "CPU"
scene.render.resolution_x, scene.render.resolution_y = 800, 450
scene.render.filepath = output
bpy.ops.render.render(write_still=True)
