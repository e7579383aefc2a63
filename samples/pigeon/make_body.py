"""Makes body.usdc: the skin of a walking pigeon, as one closed mesh on a skeleton, and its eyes.

python samples/pigeon/make_body.py [OUT.usdc [BIRD]]

BIRD is pigeon, gull, owl or sparrow; the landmarks of a groom's [bird] are printed.
Folded wings are no part of the shape: they are feathers alone. samples/first_bird has the same one.

The shape is a smooth union of ellipsoids and tapered capsules, given by its distance function and
turned into a mesh by surface nets (Gibson 1998): one point in every cell of a lattice that the
surface passes, drawn onto it, and one face for every edge of the lattice that it cuts. Metres, x
forward, y to the left, z up. Vertex primvars tell how much of each part there is at a point; they
add up to 1, and `eye` where no feathers shall be for the sake of the eyes.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

CELL = 0.004
LOW, HIGH = np.array([-0.165, -0.1, -0.012]), np.array([0.2, 0.1, 0.335])
ROUNDING = 0.012  # m, radius over which parts pass into each other
SHARE_WIDTH = 0.006  # m, over which the parts' primvars pass into each other
FRAMES, FRAMES_PER_SECOND = 96, 24
STEP = 12  # frames from one step to the next
PUPIL, IRIS = 28.0, 52.0  # deg from the middle of the eye; the rest is its lid


class Colours(NamedTuple):
    """Linear, by eye. down: of what shows between feathers. cere: of the root of the bill."""

    down: tuple[float, float, float] = (0.16, 0.18, 0.22)
    bill: tuple[float, float, float] = (0.05, 0.05, 0.06)
    cere: tuple[float, float, float] = (0.55, 0.52, 0.50)
    leg: tuple[float, float, float] = (0.42, 0.12, 0.10)
    iris: tuple[float, float, float] = (0.75, 0.16, 0.02)


class Build(NamedTuple):
    """A bird beside the pigeon, by eye. size: of all of it. trunk: factors of its length, breadth
    and depth. neck: of its length, head: of its radii, beak: of its length and thickness. eye:
    radius, m, of a head as large as the pigeon's, and how far it looks forward, 0 to 1. bare: radii
    of the eye, between which feathers begin around it. lean: deg, how far it stands up more."""

    size: float
    trunk: tuple[float, float, float] = (1.0, 1.0, 1.0)
    neck: float = 1.0
    head: float = 1.0
    beak: tuple[float, float, float] = (1.0, 1.0, 1.0)
    eye: tuple[float, float] = (0.0042, 0.2)
    colours: Colours = Colours()
    bare: tuple[float, float] = (1.5, 2.1)
    lean: float = 0.0


_YELLOW, _HORN = (0.65, 0.38, 0.03), (0.12, 0.09, 0.06)
_GULL = Colours((0.55, 0.56, 0.58), _YELLOW, _YELLOW, (0.55, 0.30, 0.25), (0.70, 0.60, 0.25))
_OWL = Colours((0.62, 0.56, 0.48), _HORN, _HORN, (0.35, 0.28, 0.18), (0.020, 0.012, 0.008))
_SPARROW = Colours((0.24, 0.19, 0.14), _HORN, _HORN, (0.40, 0.24, 0.16), (0.03, 0.02, 0.01))
BUILDS = {
    "pigeon": Build(1.0),
    "gull": Build(1.5, (1.05, 0.95, 0.95), 0.9, 1.05, (1.3, 1.2, 1.0), (0.0038, 0.2), _GULL),
    "owl": Build(
        0.95, (0.85, 1.2, 1.1), 0.5, 1.5, (0.5, 0.9, 2.6), (0.0046, 0.7), _OWL, (0.95, 1.25), 25.0
    ),
    "sparrow": Build(0.36, (0.9, 1.05, 1.05), 0.65, 1.2, (0.7, 1.3, 1.0), (0.0040, 0.2), _SPARROW),
}
NECK = np.array((0.06, 0.0, 0.2))  # where it begins
HIP = np.array((0.0, 0.0, 0.135))  # about which trunks lean

# joint: parent, pivot
JOINTS = {
    "body": ("", (-0.01, 0.0, 0.17)),
    "neck": ("body", (0.055, 0.0, 0.195)),
    "head": ("neck", (0.108, 0.0, 0.272)),
    "tail": ("body", (-0.095, 0.0, 0.14)),
    "leg_left": ("body", (0.005, 0.028, 0.125)),
    "leg_right": ("body", (0.005, -0.028, 0.125)),
}


def ellipsoid(points, centre, radii, pitch=0.0, yaw=0.0):
    """About the distance to an ellipsoid, nose up by pitch (deg), turned left by yaw (deg)."""
    local = points - np.array(centre)
    p, w = np.radians(pitch), np.radians(yaw)
    forward = np.array([np.cos(p) * np.cos(w), np.cos(p) * np.sin(w), np.sin(p)])
    left = np.array([-np.sin(w), np.cos(w), 0.0])
    local = local @ np.stack([forward, left, np.cross(forward, left)], axis=1)
    scaled, steeper = local / np.array(radii), local / np.array(radii) ** 2
    size = np.linalg.norm(scaled, axis=-1)
    return size * (size - 1.0) / np.maximum(np.linalg.norm(steeper, axis=-1), 1e-9)


def capsule(points, start, end, first, last):
    """About the distance to a capsule whose radius goes from first to last."""
    start, along = np.array(start), np.array(end) - np.array(start)
    share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    gap = np.linalg.norm(points - start - share[..., None] * along, axis=-1)
    return gap - (first + (last - first) * share)


def leant(build, points, sense=1.0):
    """Places of the pigeon's trunk (..., 3) as the bird stands, nose up; back with sense -1."""
    angle = sense * np.radians(build.lean)
    turn = np.array(
        ((np.cos(angle), 0, -np.sin(angle)), (0, 1, 0), (np.sin(angle), 0, np.cos(angle)))
    )
    return HIP + (np.array(points) - HIP) @ turn.T


def on_neck(build, point):
    """Where a place of the pigeon's neck or head is."""
    return leant(build, NECK + build.neck * (np.array(point) - NECK))


def parts(points, build=BUILDS["pigeon"]):
    """About the distance (m) to each part, negative inside, at the pigeon's size.

    points: (..., 3) m.
    """
    x, y, z = np.moveaxis(points, -1, 0)
    right = np.stack([x, np.abs(y), z], axis=-1)  # both sides at once, on the left
    trunk, upright = np.array(build.trunk), leant(build, points, -1.0)
    torso = np.minimum(
        ellipsoid(upright, (-0.012, 0, 0.168), (0.1, 0.041, 0.053) * trunk, 17),
        ellipsoid(upright, (0.044, 0, 0.172), (0.055, 0.049, 0.055) * trunk, 30),
    )
    leg = capsule(right, (0.005, 0.026, 0.122), (0.0, 0.028, 0.085), 0.021, 0.008)
    for start, end in (
        ((0.0, 0.028, 0.085), (-0.012, 0.029, 0.058)),
        ((-0.012, 0.029, 0.058), (0.0, 0.03, 0.006)),
        ((0.0, 0.03, 0.006), (0.033, 0.036, 0.004)),
        ((0.0, 0.03, 0.006), (0.027, 0.014, 0.004)),
        ((0.0, 0.03, 0.006), (-0.02, 0.03, 0.004)),
    ):
        leg = np.minimum(leg, capsule(right, start, end, 0.005, 0.0045))
    skull = on_neck(build, (0.117, 0, 0.285))
    return {
        "torso": torso,
        "neck": capsule(
            points,
            leant(build, NECK),
            on_neck(build, (0.106, 0, 0.272)),
            0.036,
            0.0215 * build.head,
        ),
        "head": ellipsoid(points, skull, np.array((0.0265, 0.0205, 0.0215)) * build.head, -8),
        "beak": capsule(points, *beak(build), 0.0075 * build.beak[1], 0.0035 * build.beak[1]),
        "rump": capsule(upright, (-0.06, 0, 0.157), (-0.13, 0, 0.131), 0.034, 0.011),
        "leg": leg,
    }


def beak(build):
    """Its root and tip, (3,) m."""
    skull = on_neck(build, (0.117, 0, 0.285))
    root = skull + build.head * np.array((0.018, 0.0, -0.002))
    return root, root + build.beak[0] * np.array((0.031, 0.0, -0.011 * build.beak[2]))


def eye(build):
    """Middle of the left eye, (3,) m, and the unit way that it looks, at the pigeon's size."""
    radius, forward = build.eye
    look = np.array((forward, 1.0 - forward, 0.08))
    look /= np.linalg.norm(look)
    skull = on_neck(build, (0.117, 0, 0.285))
    radii = build.head * np.array((0.0265, 0.0205, 0.0215))
    aim = np.array((0.42 + 0.45 * forward, 1.0 - 0.55 * forward, 0.2))
    rim = skull + radii * aim / np.linalg.norm(aim)
    deep = 0.15 + 0.8 * max(forward - 0.2, 0.0)  # those that look forward lie in a disc
    return rim - deep * build.head * radius * look, look


def without_feathers(points, build):
    """(V,) from 0 to 1, around the eyes, and before them, where feathers would fall on them."""
    middle, _ = eye(build)
    ahead = np.array((0.9, 0.0, -0.1)) * build.eye[0] * build.head
    right = points * np.array((1.0, -1.0, 1.0))
    near = [np.linalg.norm(each - middle - ahead, axis=1) for each in (points, right)]
    return 1.0 - smooth(np.minimum(*near) / (build.eye[0] * build.head), *build.bare)


def eye_mesh(build):
    """Points (V, 3) m, faces (F, 4), and linear colours (V, 3) of both eyes, at its size."""
    middle, look = eye(build)
    side = np.cross(look, (0.0, 0.0, 1.0))
    side /= np.linalg.norm(side)
    turned = np.radians([0.5, *np.linspace(PUPIL - 18.0, PUPIL, 3), PUPIL + 1.0])
    turned = np.append(turned, np.radians([*np.linspace(IRIS - 12.0, IRIS, 3), IRIS + 2.0, 75, 90]))
    around = np.radians(np.arange(0, 360, 15))
    rings, steps = np.meshgrid(turned, around, indexing="ij")
    ways = np.cos(rings)[..., None] * look
    aside = np.cos(steps)[..., None] * side + np.sin(steps)[..., None] * np.cross(side, look)
    left = middle + build.head * build.eye[0] * (ways + np.sin(rings)[..., None] * aside)
    left = build.size * left.reshape(-1, 3)
    number = np.arange(len(left)).reshape(rings.shape)
    quads = [number[:-1], number[1:], np.roll(number, -1, 1)[1:], np.roll(number, -1, 1)[:-1]]
    faces = np.stack(quads, axis=-1).reshape(-1, 4)
    degrees = np.degrees(rings).reshape(-1, 1)
    own = np.where(degrees <= IRIS, build.colours.iris, 0.6 * np.array(build.colours.down))
    own = np.where(degrees <= PUPIL, (0.004, 0.004, 0.005), own)
    return (
        np.concatenate([left, left * (1.0, -1.0, 1.0)]),
        np.concatenate([faces, faces[:, ::-1] + len(left)]),
        np.concatenate([own, own]),
    )


def landmarks(build):
    """Those of a groom's [bird], (3,) m by name, at the bird's size."""
    skull, (long, wide, deep) = on_neck(build, (0.117, 0, 0.285)), build.trunk
    middle, _ = eye(build)
    found = {
        "beak": beak(build)[1],
        "crown": skull + build.head * np.array((0.001, 0, 0.022)),
        "nape": skull + build.head * np.array((-0.023, 0, 0.005)),
        "breast": leant(build, (0.042 + 0.055 * long, 0, 0.185)),
        "right_shoulder": leant(build, (0.055, -0.053 * wide, 0.205)),
        "left_shoulder": leant(build, (0.055, 0.053 * wide, 0.205)),
        "vent": leant(build, (-0.075, 0, 0.168 - 0.053 * deep)),
        "tail": leant(build, (-0.134, 0, 0.138)),
        "right_heel": np.array((-0.008, -0.0285, 0.068)),
        "left_heel": np.array((-0.008, 0.0285, 0.068)),
        "right_eye": middle * (1.0, -1.0, 1.0),
        "left_eye": middle,
    }
    return {name: build.size * place for name, place in found.items()}


def distance(points, build=BUILDS["pigeon"]):
    """Smooth union of all parts (exponential minimum)."""
    values = np.stack(list(parts(points, build).values()))
    least = values.min(axis=0)
    width = ROUNDING / 3.0
    return least - width * np.log(np.exp(-(values - least) / width).sum(axis=0))


def surface_net(build):
    """Points (V, 3) m and faces (F, 4) of the closed surface."""
    counts = np.ceil((HIGH - LOW) / CELL).astype(int) + 1
    axes = [LOW[k] + CELL * np.arange(counts[k]) for k in range(3)]
    corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = distance(corners, build) < 0.0
    cells = tuple(c - 1 for c in counts)
    mixed = np.zeros(cells, dtype=int)
    for i, j, k in np.ndindex(2, 2, 2):
        mixed += inside[i : i + cells[0], j : j + cells[1], k : k + cells[2]]
    number = np.full(cells, -1)
    used = np.argwhere((mixed > 0) & (mixed < 8))
    number[tuple(used.T)] = np.arange(len(used))
    points = onto_surface(LOW + CELL * (used + 0.5), build)
    faces = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        here = np.moveaxis(inside, axis, 0)
        cut = np.moveaxis(here[:-1] != here[1:], 0, axis)
        edges = np.argwhere(cut)
        around = []
        for a, b in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
            cell = edges.copy()
            cell[:, first] += a
            cell[:, second] += b
            around.append(number[tuple(cell.T)])
        quads = np.stack(around, axis=1)
        leaves = inside[tuple(edges.T)]  # the edge runs from inside to outside
        faces.append(np.where(leaves[:, None], quads, quads[:, ::-1]))
    return points, np.concatenate(faces)


def onto_surface(points, build):
    """Points drawn onto the surface along the gradient of the distance, within their cells."""
    start, step = points, 1e-5
    for _ in range(6):
        gradient = np.stack(
            [
                (distance(points + step * e, build) - distance(points - step * e, build))
                / (2.0 * step)
                for e in np.eye(3)
            ],
            axis=-1,
        )
        size = np.maximum((gradient**2).sum(axis=-1, keepdims=True), 0.05)
        points = points - distance(points, build)[:, None] * gradient / size
        points = start + np.clip(points - start, -0.5 * CELL, 0.5 * CELL)
    return points


def part_shares(points, build):
    """Share of each part at points (V, 3), adding up to 1."""
    values = parts(points, build)
    least = np.min(list(values.values()), axis=0)
    raw = {name: np.exp(-(value - least) / SHARE_WIDTH) for name, value in values.items()}
    total = sum(raw.values())
    return {name: value / total for name, value in raw.items()}


def smooth(value, low, high):
    share = np.clip((value - low) / (high - low), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def joint_weights(points, shares):
    """(V, J) weights of the joints."""
    x, y, z = points.T
    along_neck = (points - np.array((0.05, 0, 0.185))) @ np.array((0.55, 0.0, 0.835))
    moved = smooth(along_neck, 0.0, 0.05)
    head = smooth(along_neck, 0.075, 0.115)
    tail = smooth(-x, 0.075, 0.12)
    leg = shares["leg"] * smooth(-z, -0.13, -0.105)
    weights = np.zeros((len(points), len(JOINTS)))
    weights[:, 1], weights[:, 2] = moved * (1.0 - head), moved * head
    weights[:, 3] = tail * (1.0 - moved)
    weights[:, 4], weights[:, 5] = leg * (y > 0), leg * (y <= 0)
    weights[:, 0] = np.maximum(1.0 - weights[:, 1:].sum(axis=1), 0.0)
    return weights / weights.sum(axis=1, keepdims=True)


def thrust(phase):
    """Place of the head from -1 (behind) to 1: a quick thrust, then held back as the body moves."""
    phase = np.mod(phase, 1.0)
    return np.where(
        phase < 0.4, 2.0 * smooth(phase, 0.0, 0.4) - 1.0, 1.0 - 2.0 * smooth(phase, 0.4, 1.0)
    )


def poses(frame):
    """Joint rotations (deg about x, y, z) and the body's shift (m) at a frame, 0 the first."""
    start = smooth(frame, 0.0, 18.0)  # from standing to walking
    phase = frame / STEP
    beat, stride = 2.0 * np.pi * phase, np.pi * phase
    nod = start * 9.0 * thrust(phase)
    swing = start * 24.0 * np.sin(stride)
    return {
        "body": (
            start * 2.5 * np.sin(stride),
            start * 1.2 * np.sin(beat),
            start * 1.5 * np.sin(stride),
        ),
        "neck": (0.0, nod, 0.0),
        "head": (0.0, -0.9 * nod, 0.0),
        "tail": (0.0, start * 2.0 * np.sin(beat + 0.6), start * 2.0 * np.sin(stride + 0.4)),
        "leg_left": (0.0, swing, 0.0),
        "leg_right": (0.0, -swing, 0.0),
    }, np.array([0.0, 0.0, start * 0.0035 * np.cos(beat)])


def quaternion(degrees):
    turned = Gf.Rotation(Gf.Vec3d(1, 0, 0), degrees[0])
    turned *= Gf.Rotation(Gf.Vec3d(0, 1, 0), degrees[1])
    turned *= Gf.Rotation(Gf.Vec3d(0, 0, 1), degrees[2])
    return Gf.Quatf(turned.GetQuat())


def define_mesh(stage, name, points, faces, colours, shares=()):
    """A mesh of quads with a linear colour (V, 3) at each point, and vertex primvars by name."""
    mesh = UsdGeom.Mesh.Define(stage, f"/pigeon/{name}")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 4, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.astype(np.int32).ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    extent = np.stack([points.min(axis=0), points.max(axis=0)]).astype(np.float32)
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(extent))
    api = UsdGeom.PrimvarsAPI(mesh)
    for key, share in dict(shares).items():
        primvar = api.CreatePrimvar(key, Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
        primvar.Set(Vt.FloatArray.FromNumpy(np.round(share, 4).astype(np.float32)))
    colour = api.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "vertex")
    colour.Set(Vt.Vec3fArray.FromNumpy(colours.astype(np.float32)))
    return mesh


def skin_colours(points, shares, build):
    """(V, 3) linear. points: (V, 3) m, at the pigeon's size."""
    down, bill, cere, leg, _ = (np.array(each) for each in build.colours)
    root, tip = beak(build)
    along = (points - root) @ (tip - root) / ((tip - root) @ (tip - root))
    thigh = smooth(points[:, 2], 0.066, 0.083)  # feathered skin
    feet, horn = shares["leg"] * (1.0 - thigh), shares["beak"]
    share = smooth(along, 0.3, 0.4)[:, None]
    own = share * bill + (1.0 - share) * cere
    return (1.0 - feet - horn)[:, None] * down + feet[:, None] * leg + horn[:, None] * own


def bind_skeleton(stage, mesh, eyes, points, shares):
    skeleton = UsdSkel.Skeleton.Define(stage, "/pigeon/skeleton")
    paths = {}
    for name, (parent, _) in JOINTS.items():
        paths[name] = f"{paths[parent]}/{name}" if parent else name
    pivots = {name: np.array(pivot) for name, (_, pivot) in JOINTS.items()}
    skeleton.CreateJointsAttr(list(paths.values()))
    bind = [Gf.Matrix4d().SetTranslate(Gf.Vec3d(*pivots[name])) for name in JOINTS]
    local = {n: pivots[n] - (pivots[p] if p else 0.0) for n, (p, _) in JOINTS.items()}
    skeleton.CreateBindTransformsAttr(bind)
    skeleton.CreateRestTransformsAttr(
        [Gf.Matrix4d().SetTranslate(Gf.Vec3d(*map(float, local[name]))) for name in JOINTS]
    )
    api = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    api.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    weights = joint_weights(points, shares)
    strongest = np.argsort(-weights, axis=1)[:, :3]
    values = np.take_along_axis(weights, strongest, axis=1)
    values = values / values.sum(axis=1, keepdims=True)
    indices = Vt.IntArray.FromNumpy(strongest.astype(np.int32).ravel())
    api.CreateJointIndicesPrimvar(False, 3).Set(indices)
    shaped = Vt.FloatArray.FromNumpy(values.astype(np.float32).ravel())
    api.CreateJointWeightsPrimvar(False, 3).Set(shaped)
    api.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    api = UsdSkel.BindingAPI.Apply(eyes.GetPrim())
    api.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    api.CreateJointIndicesPrimvar(True, 1).Set([list(JOINTS).index("head")])
    api.CreateJointWeightsPrimvar(True, 1).Set([1.0])
    api.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    animation = UsdSkel.Animation.Define(stage, "/pigeon/skeleton/walk")
    animation.CreateJointsAttr(list(paths.values()))
    for frame in range(FRAMES):
        rotations, shift = poses(float(frame))
        moved = [local[name] + (shift if name == "body" else 0.0) for name in JOINTS]
        animation.CreateTranslationsAttr().Set([Gf.Vec3f(*map(float, m)) for m in moved], frame + 1)
        animation.CreateRotationsAttr().Set(
            [quaternion([float(a) for a in rotations[name]]) for name in JOINTS], frame + 1
        )
    animation.CreateScalesAttr().Set([Gf.Vec3h(1, 1, 1)] * len(JOINTS))
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(
        [animation.GetPath()]
    )


def make(path, bird="pigeon"):
    """Write the skin of a bird to a USD file, that of others than the pigeon without a walk."""
    build = BUILDS[bird]
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.SetTimeCodesPerSecond(FRAMES_PER_SECOND)
    stage.SetFramesPerSecond(FRAMES_PER_SECOND)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(FRAMES)
    root = UsdSkel.Root.Define(stage, "/pigeon")
    Usd.ModelAPI(root).SetKind("component")
    stage.SetDefaultPrim(root.GetPrim())
    points, faces = surface_net(build)
    shares = part_shares(points, build)
    maps = shares | {"eye": without_feathers(points, build)}
    colours = skin_colours(points, shares, build)
    mesh = define_mesh(stage, "body", build.size * points, faces, colours, maps)
    eyes = define_mesh(stage, "eyes", *eye_mesh(build))
    if bird == "pigeon":
        bind_skeleton(stage, mesh, eyes, points, shares)
    stage.GetRootLayer().Save()
    return len(points), len(faces)


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("body.usdc")
    bird = sys.argv[2] if len(sys.argv) > 2 else "pigeon"
    target.unlink(missing_ok=True)
    print("# {} points, {} faces".format(*make(target, bird)))
    for name, place in landmarks(BUILDS[bird]).items():
        print(f"{name} = {np.round(place, 4).tolist()}")
