"""Makes body.usdc: the skin of a walking pigeon, as one closed mesh on a skeleton, eyes and claws.

python samples/pigeon/make_body.py [OUT.usdc [BIRD]]

BIRD is pigeon, gull, owl, owl_flying, sparrow, parrot, peacock, swan, swan_flying or ostrich, of
bodies.py; the landmarks of a groom's [bird] are printed.
Folded wings are no part of the shape: they are feathers alone. samples/first_bird has the same one.

The shape is a smooth union of a loft, an ellipsoid and tapered capsules, given by its distance
function and turned into a mesh by surface nets (Gibson 1998): one point in every cell of a lattice
that the surface passes, drawn onto it, and one face for every edge of the lattice that it cuts.
Metres, x forward, y to the left, z up. Vertex primvars tell how much of each part there is at a
point; they add up to 1, and `eye` where no feathers shall be for the sake of the eyes.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from bodies import (
    BUILDS,
    beak,
    distance,
    eye,
    landmarks,
    leant,
    neck,
    parts,
    skull_of,
    smooth,
    toes,
)
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

CELL = 0.004
MARGIN = 0.03  # m, of the lattice around landmarks and soles
SHARE_WIDTH = 0.006  # m, over which the parts' primvars pass into each other
FRAMES, FRAMES_PER_SECOND = 96, 24
STEP = 12  # frames from one step to the next
PUPIL, IRIS = 28.0, 52.0  # deg from the middle of the eye; the rest is its lid


def joints(build):
    """Parent and pivot, (3,) m at the pigeon's size, of each joint by name."""
    (sole, _), wide = toes(build), build.trunk[1]
    found = {
        "body": ("", (-0.01, 0.0, 0.17)),
        "neck": ("body", neck(build)[0] - (0.005, 0.0, 0.005)),
        "head": ("neck", skull_of(build) - build.head * np.array((0.009, 0.0, 0.013))),
        "tail": ("body", leant(build, (-0.095, 0.0, 0.14))),
    }
    for side, sign in (("left", 1.0), ("right", -1.0)):
        found[f"leg_{side}"] = "body", (0.005, sign * 0.028 * wide, 0.125)
        heel = (-0.012, sign * 0.029 * wide, build.legs.heel)
        found[f"tarsus_{side}"] = f"leg_{side}", heel
        found[f"foot_{side}"] = f"tarsus_{side}", sole * (1.0, sign, 1.0)
    return {name: (parent, np.array(pivot)) for name, (parent, pivot) in found.items()}


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


def claw_mesh(build):
    """Points (V, 3) m, faces (F, 4), and linear colours (V, 3) of all claws, at the bird's size:
    cones that bend down beyond the ends of the toes."""
    sole, ends = toes(build)
    along = np.linspace(0.0, 1.0, 7)
    around = np.radians(np.arange(0, 360, 36))
    points, faces = [], []
    for end in ends:
        way = (end - sole) * (1.0, 1.0, 0.0)
        way /= np.linalg.norm(way)
        side = np.cross((0.0, 0.0, 1.0), way)
        thick, long = build.legs.thick, build.legs.claws + build.legs.thick
        # from within the toe, out of the upper half of its end, down to the ground
        lift = 0.35 * thick - (0.8 * thick) * along**2
        middle = end + long * along[:, None] * way + lift[:, None] * np.array((0.0, 0.0, 1.0))
        wide = 0.55 * thick * np.sqrt(1.0 - 0.97 * along)
        ring = np.cos(around)[:, None] * side + np.sin(around)[:, None] * np.array((0.0, 0.0, 1.0))
        own = middle[:, None] + wide[:, None, None] * ring
        number = sum(map(len, points)) + np.arange(own[..., 0].size).reshape(own.shape[:2])
        quads = [number[:-1], np.roll(number, -1, 1)[:-1], np.roll(number, -1, 1)[1:], number[1:]]
        points.append(own.reshape(-1, 3))
        faces.append(np.stack(quads, axis=-1).reshape(-1, 4))
    left, own = build.size * np.concatenate(points), np.concatenate(faces)
    return (
        np.concatenate([left, left * (1.0, -1.0, 1.0)]),
        np.concatenate([own, own[:, ::-1] + len(left)]),
        np.tile(build.colours.bill, (2 * len(left), 1)),
    )


def box(build):
    """Lowest and highest corner (3,) m of the lattice, at the pigeon's size."""
    around = [place / build.size for place in landmarks(build).values()]
    around += [neck(build).min(axis=0), neck(build).max(axis=0), (0.0, 0.0, build.legs.sole)]
    reach = 0.1 * build.trunk[1]
    around += [(0.0, -reach, 0.12), (0.0, reach, 0.12)]
    return np.min(around, axis=0) - MARGIN, np.max(around, axis=0) + MARGIN


def surface_net(build):
    """Points (V, 3) m and faces (F, 4) of the closed surface."""
    low, high = box(build)
    counts = np.ceil((high - low) / CELL).astype(int) + 1
    axes = [low[k] + CELL * np.arange(counts[k]) for k in range(3)]
    corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = distance(corners, build) < 0.0
    cells = tuple(c - 1 for c in counts)
    mixed = np.zeros(cells, dtype=int)
    for i, j, k in np.ndindex(2, 2, 2):
        mixed += inside[i : i + cells[0], j : j + cells[1], k : k + cells[2]]
    number = np.full(cells, -1)
    used = np.argwhere((mixed > 0) & (mixed < 8))
    number[tuple(used.T)] = np.arange(len(used))
    points = onto_surface(low + CELL * (used + 0.5), build)
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


def along_neck(points, build):
    """(V,) place of points beside the neck, 0 where it begins to 1 in the skull, and on beyond."""
    path = neck(build)
    steps = np.diff(path, axis=0)
    long = np.append(0.0, np.cumsum(np.linalg.norm(steps, axis=1)))
    found, nearest = np.zeros(len(points)), np.full(len(points), np.inf)
    for k, step in enumerate(steps):
        low, high = -np.inf if k == 0 else 0.0, np.inf if k == len(steps) - 1 else 1.0
        share = np.clip((points - path[k]) @ step / (step @ step), low, high)
        away = np.linalg.norm(points - path[k] - share[:, None] * step, axis=1)
        place = (long[k] + share * (long[k + 1] - long[k])) / long[-1]
        found, nearest = np.where(away < nearest, place, found), np.minimum(away, nearest)
    return found


def joint_weights(points, shares, build):
    """(V, J) weights of the joints: of the neck none where wings hang."""
    _, y, z = points.T
    place, (sole, _) = along_neck(points, build), toes(build)
    shoulder = landmarks(build)["left_shoulder"] / build.size
    beside = np.linalg.norm(np.stack([points[:, 0], np.abs(y), z], axis=1) - shoulder, axis=1)
    moved, head = smooth(place, -0.4, 0.55) * smooth(beside, 0.01, 0.05), smooth(place, 0.45, 1.0)
    leg = shares["leg"] * smooth(-z, -0.13, -0.105)
    tarsus = smooth(-z, -build.legs.heel - 0.003, 0.007 - build.legs.heel)
    foot = smooth(-z, -sole[2] - 0.008, -sole[2])
    weights = {
        "neck": moved * (1.0 - head),
        "head": moved * head,
        "tail": smooth(-leant(build, points, -1.0)[:, 0], 0.075, 0.12) * (1.0 - moved),
    }
    for side, beside in (("left", y > 0), ("right", y <= 0)):
        weights[f"leg_{side}"] = leg * (1.0 - tarsus) * beside
        weights[f"tarsus_{side}"] = leg * tarsus * (1.0 - foot) * beside
        weights[f"foot_{side}"] = leg * tarsus * foot * beside
    weights["body"] = np.maximum(1.0 - sum(weights.values()), 0.0)
    found = np.stack([weights[name] for name in joints(build)], axis=1)
    return found / found.sum(axis=1, keepdims=True)


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
    below = root[2] + along * (tip[2] - root[2]) - points[:, 2]
    thigh = smooth(points[:, 2], build.legs.bare - 0.006, build.legs.bare + 0.006)  # feathered skin
    feet, horn = shares["leg"] * (1.0 - thigh), shares["beak"]
    # above the root of the bill alone
    share = np.maximum(smooth(along, 0.3, 0.4), smooth(below, -0.0015, 0.0005))[:, None]
    own = share * bill + (1.0 - share) * cere
    return (1.0 - feet - horn)[:, None] * down + feet[:, None] * leg + horn[:, None] * own


def bind_rigidly(skeleton, mesh, joints):
    """joints: (V,) of the points, or (1,) of all of them."""
    api = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    api.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    whole = len(joints) == 1
    api.CreateJointIndicesPrimvar(whole, 1).Set(Vt.IntArray.FromNumpy(joints.astype(np.int32)))
    api.CreateJointWeightsPrimvar(whole, 1).Set([1.0] * len(joints))
    api.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))


def bind_skeleton(stage, build, mesh, eyes, claws, points, shares):
    """Bind meshes to a skeleton at rest; return it, and local pivots, m, by path."""
    skeleton = UsdSkel.Skeleton.Define(stage, "/pigeon/skeleton")
    known, paths = joints(build), {}
    for name, (parent, _) in known.items():
        paths[name] = f"{paths[parent]}/{name}" if parent else name
    pivots = {name: build.size * pivot for name, (_, pivot) in known.items()}
    local = {n: pivots[n] - (pivots[p] if p else 0.0) for n, (p, _) in known.items()}
    skeleton.CreateJointsAttr(list(paths.values()))
    for make_attribute, places in (
        (skeleton.CreateBindTransformsAttr, pivots),
        (skeleton.CreateRestTransformsAttr, local),
    ):
        make_attribute([Gf.Matrix4d().SetTranslate(Gf.Vec3d(*p.tolist())) for p in places.values()])
    api = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    api.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    weights = joint_weights(points, shares, build)
    strongest = np.argsort(-weights, axis=1)[:, :3]
    values = np.take_along_axis(weights, strongest, axis=1)
    values = values / values.sum(axis=1, keepdims=True)
    indices = Vt.IntArray.FromNumpy(strongest.astype(np.int32).ravel())
    api.CreateJointIndicesPrimvar(False, 3).Set(indices)
    shaped = Vt.FloatArray.FromNumpy(values.astype(np.float32).ravel())
    api.CreateJointWeightsPrimvar(False, 3).Set(shaped)
    api.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    bind_rigidly(skeleton, eyes, np.full(1, list(known).index("head")))
    left, right = list(known).index("foot_left"), list(known).index("foot_right")
    count = len(claws.GetPointsAttr().Get())
    bind_rigidly(skeleton, claws, np.where(np.arange(count) < count // 2, left, right))
    return skeleton, dict(zip(paths.values(), local.values(), strict=True))


def add_walk(stage, skeleton, local):
    """Add the walk as animation of a skeleton. local: pivots, m, by path."""
    animation = UsdSkel.Animation.Define(stage, "/pigeon/skeleton/walk")
    animation.CreateJointsAttr(list(local))
    still = (0.0, 0.0, 0.0)
    for frame in range(FRAMES):
        rotations, shift = poses(float(frame))
        moved = [at + (shift if path == "body" else 0.0) for path, at in local.items()]
        animation.CreateTranslationsAttr().Set([Gf.Vec3f(*m.tolist()) for m in moved], frame + 1)
        turns = [rotations.get(path.rpartition("/")[2], still) for path in local]
        turned = [quaternion([float(a) for a in each]) for each in turns]
        animation.CreateRotationsAttr().Set(turned, frame + 1)
    animation.CreateScalesAttr().Set([Gf.Vec3h(1, 1, 1)] * len(local))
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
    claws = define_mesh(stage, "claws", *claw_mesh(build))
    skeleton, local = bind_skeleton(stage, build, mesh, eyes, claws, points, shares)
    if bird == "pigeon":
        add_walk(stage, skeleton, local)
    stage.GetRootLayer().Save()
    return len(points), len(faces)


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("body.usdc")
    bird = sys.argv[2] if len(sys.argv) > 2 else "pigeon"
    target.unlink(missing_ok=True)
    print("# {} points, {} faces".format(*make(target, bird)))
    for name, place in landmarks(BUILDS[bird]).items():
        print(f"{name} = {np.round(place, 4).tolist()}")
