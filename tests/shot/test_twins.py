"""Feathers of one shape to which the same happens are solved once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from featherfx.shot.loads.types import Grip
from featherfx.shot.read.read import read_shot
from featherfx.shot.simulate import simulate

ROOT = '[[joint]]\nname = "body"\nposition = [0, 0, 0]\n'
# one side of a fan, and its mirror image
FAN = """
[[row]]
id = "right_row"
kind = "swan_primary"
count = 2
first = { position = [0, -0.1, 0], direction = [-0.6, -1.0, 0.1], up = [0, 0.2, 1] }
last = { position = [0.05, -0.2, 0], direction = [-0.2, -1.0, 0.1], up = [0, 0.2, 1] }
joint = "body"
mirror = "y"
"""
FRAMES = 3


def shot_of(folder, feathers, **changes):
    """A small shot that is shaken up and forth in a headwind."""
    (folder / "groom.toml").write_text('name = "fan"\n' + ROOT + feathers)
    path = folder / "shot.toml"
    path.write_text(
        f'name = "fan"\ngroom = "groom.toml"\nframes = [1, {FRAMES}]\n'
        'quality = { base = "draft", simulated_rows = 6, simulated_columns = 2, '
        "coefficients = 2 }\n"
        'wind = { base = "breeze", gust = 0, direction = [-1, 0, 0.1] }\n'
        "[motion]\n"
        'kind = "shake"\namplitude = 0.05\nfrequency = 3\ndirection = [0.3, 0, 1]\n'
    )
    return replace(read_shot(path), **changes)


def baked(shot):
    """(frames, feathers) poses, and feather frames that were not stepped."""
    simulation = simulate(shot)
    poses = [frame.poses for frame in simulation]
    return poses, simulation.report["skipped"]["twin feather frames"]


def bits(poses):
    """All numbers of poses, as bytes."""
    parts = [(*p.points, *p.velocities, *p.accelerations) for frame in poses for p in frame]
    return b"".join(part.tobytes() for each in parts for part in each)


def apart(some, others):
    """m, the largest distance of a node between poses."""
    both = zip(sum(some, ()), sum(others, ()), strict=True)
    return max(np.abs(a.points.nodes - b.points.nodes).max() for a, b in both)


@pytest.mark.parametrize("hooks", ["closed", "slip"])
def test_a_mirrored_wing_has_the_bits_of_one_that_is_solved(hooks, tmp_path):
    soft = f'[overrides]\n"*" = {{ vane_material.hooks = "{hooks}" }}\n'
    shot = shot_of(tmp_path, FAN + soft)
    poses, skipped = baked(shot)
    alone, none = baked(replace(shot, twins="none"))
    assert (skipped, none) == (2 * (FRAMES - 1), 0)
    assert bits(poses) == bits(alone)
    first = simulate(shot, frames=(1, FRAMES - 1))
    assert len(list(first)) == FRAMES - 1
    after = simulate(replace(shot, twins="none"), start=first.checkpoint())
    assert bits([frame.poses for frame in after]) == bits(alone[-1:])


def test_what_happens_to_one_alone_parts_it_from_its_twin(tmp_path):
    shot = shot_of(tmp_path, FAN)
    how = {"row": 1.0, "column": 0.0, "side": "leading", "stiffness": 50.0}
    time = {"start": 1 / 24, "end": 2 / 24}
    grip = Grip(feather="right_row_01", displacement=np.array([0, 0, 0.01]), **how, **time)
    held = replace(shot, grips=(grip,))
    poses, skipped = baked(held)
    alone, _ = baked(replace(held, twins="none"))
    assert skipped == 2 * (FRAMES - 1) - (FRAMES - 1)
    assert bits(poses) == bits(alone)
    aslant = replace(shot, wind=replace(shot.wind, direction=np.array([-1.0, 0.1, 0.0])))
    assert baked(aslant)[1] == 0


def test_a_ring_about_the_vertical_is_solved_once(tmp_path):
    ring = ""
    for k, angle in enumerate(np.linspace(0, 2 * np.pi, 5, endpoint=False)):
        out = 0.1 * np.array([np.cos(angle), np.sin(angle), 0.0])
        there = f"position = {out.tolist()}\n"
        there += f"direction = {(5 * out + (0, 0, 1)).tolist()}\nup = {(-10 * out).tolist()}\n"
        ring += f'[[feather]]\nid = "f{k}"\nkind = "ornamental_plume"\njoint = "body"\n' + there
    shot = shot_of(tmp_path, ring)
    motion = replace(shot.motion, values=shot.motion.values | {"direction": (0.0, 0.0, 1.0)})
    still = replace(shot.wind, speed=0.0, air_density=0.0)
    shot = replace(shot, motion=motion, wind=still)
    poses, skipped = baked(replace(shot, twins="all"))
    alone, _ = baked(replace(shot, twins="none"))
    assert skipped == 4 * (FRAMES - 1)
    assert apart(poses, alone) < 1e-9
    assert baked(replace(shot, twins="all", wind=replace(shot.wind, speed=0.0)))[1] > 0
    assert baked(replace(shot, twins="mirrored"))[1] < skipped
