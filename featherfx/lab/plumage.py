"""Plumage whose size is a number: inputs of bakes that measure time and memory."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import trimesh
from scipy.interpolate import CubicSpline

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
