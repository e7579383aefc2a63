"""A creature that flies, bends and beats, made by script: a closed skin, 24 frames.

A body along y, as long as 2 m, with an elliptic section. Every section is turned about x by
`bend(y, time)` and stands on the line that these turns make, so that the surface's own bend is
known exactly. `sampled` writes it as sampled points, Z up, in metres; `skinned` as a skeleton of
24 joints, three to a point, Y up, in centimetres. Both begin at frame 1001, in mid-beat.

PYTHONPATH=tests python tests/usdin/creature.py OUT.usda writes the skeleton of
docs/production_shot.md.
"""

import sys
from pathlib import Path

import numpy as np
from places import COARSE
from pxr import Gf, UsdSkel, Vt
from usdin_scenes import add_mesh, new_stage, vec

FIRST, LAST, RATE = 1001, 1024, 24.0
SPEED = 12.0  # m/s, forwards
BEAT = 2.0  # Hz
BEND = 1.1  # rad at the ends
HALF = 1.0  # m
JOINTS = 24
_SECTIONS, _ROUND = 41, 18
_FINE = 2001


def bend(y, time):
    """Turn of the section at y (m) about x in rad."""
    share = np.asarray(y) / HALF
    return BEND * np.sin(2 * np.pi * BEAT * time + 0.6) * (share + 0.2 * share**2)


def body_shift(time):
    """(3,) m, of the middle of the body."""
    return np.array([SPEED * time, 0.0, 0.05 * np.cos(2 * np.pi * BEAT * time)])


def moved(points, time):
    """Points (N, 3) at rest, m, z up, at a time in s since the first frame."""
    fine = np.linspace(-HALF, HALF, _FINE)
    turned = bend(fine, time)
    line = []
    for slope in (np.cos(turned), np.sin(turned)):
        steps = 0.5 * (slope[1:] + slope[:-1]) * np.diff(fine)
        way = np.concatenate([[0.0], np.cumsum(steps)])
        line.append(np.interp(points[:, 1], fine, way - np.interp(0.0, fine, way)))
    angle = bend(points[:, 1], time)
    y = line[0] - np.sin(angle) * points[:, 2]
    z = line[1] + np.cos(angle) * points[:, 2]
    return np.column_stack([points[:, 0], y, z]) + body_shift(time)


def body(seed=3):
    """Points (V, 3) m at rest, counts and indices; sections are spaced unevenly."""
    random = np.random.default_rng(seed)
    along = np.linspace(-HALF, HALF, _SECTIONS)
    along[1:-1] += random.uniform(-0.3, 0.3, _SECTIONS - 2) * (along[1] - along[0])
    around = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)
    thick = np.sqrt(1.0 - 0.9 * (along / HALF) ** 2)[:, None]
    x, z = 0.2 * thick * np.cos(around), 0.1 * thick * np.sin(around)
    y = np.broadcast_to(along[:, None], x.shape)
    points = np.stack([x, y, z], axis=2).reshape(-1, 3)
    ring = np.arange(_ROUND)
    quads = [
        np.stack([k + ring, k + (ring + 1) % _ROUND, k + _ROUND + (ring + 1) % _ROUND,
                  k + _ROUND + ring], axis=1)[:, ::-1]
        for k in range(0, (_SECTIONS - 1) * _ROUND, _ROUND)
    ]  # fmt: skip
    indices = [*np.concatenate(quads).ravel(), *ring, *(len(points) - _ROUND + ring)[::-1]]
    counts = [4] * (len(quads) * _ROUND) + [_ROUND, _ROUND]
    return points, counts, indices


def times(subframes=1):
    """(code, s since the first frame) of the samples."""
    steps = (LAST - FIRST) * subframes
    return [(FIRST + k / subframes, k / subframes / RATE) for k in range(steps + 1)]


def sampled(path: Path, subframes=1):
    """The creature as sampled points."""
    stage = new_stage(path)
    points, counts, indices = body()
    mesh = add_mesh(stage, "/creature/skin", points, counts, indices)
    for code, time in times(subframes):
        mesh.GetPointsAttr().Set(vec(moved(points, time)), code)
    stage.Save()


def skinned(path: Path):
    """The creature on a chain of joints, each carrying a part of the bend."""
    stage = new_stage(path, 0.01, "Y")
    UsdSkel.Root.Define(stage, "/creature")
    skeleton = UsdSkel.Skeleton.Define(stage, "/creature/skeleton")
    animation = UsdSkel.Animation.Define(stage, "/creature/motion")
    places = np.linspace(-HALF, HALF, JOINTS)
    names = ["/".join(f"j{i:02d}" for i in range(k + 1)) for k in range(JOINTS)]
    # x forward, z up, y left in the world: here y is up, and the body lies along -z
    pivots = 100.0 * np.column_stack([np.zeros(JOINTS), np.zeros(JOINTS), -places])
    for prim in (skeleton, animation):
        prim.CreateJointsAttr(names)
    binds = [Gf.Matrix4d().SetTranslate(Gf.Vec3d(*pivot.tolist())) for pivot in pivots]
    steps = np.diff(pivots, axis=0, prepend=np.zeros((1, 3)))
    rests = [Gf.Matrix4d().SetTranslate(Gf.Vec3d(*step.tolist())) for step in steps]
    skeleton.CreateBindTransformsAttr(Vt.Matrix4dArray(binds))
    skeleton.CreateRestTransformsAttr(Vt.Matrix4dArray(rests))
    animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1)] * JOINTS))
    translations = animation.CreateTranslationsAttr()
    rotations = animation.CreateRotationsAttr()
    for code, time in times():
        turns = np.diff(bend(places, time), prepend=0.0)
        shift = 100.0 * body_shift(time)
        # the first joint stands where the chain's middle is the body's
        long = 200.0 * HALF / (JOINTS - 1)
        lengths = np.where(places[:-1] < -0.5 * long / 100, long, 0.0)
        lengths[JOINTS // 2 - 1] = 0.5 * long
        slopes = bend(places[:-1], time)
        shift[1:] -= np.array([np.cos(slopes), np.sin(slopes)]) @ lengths
        own = steps.copy()
        own[0] = shift[0], shift[2], -shift[1]
        translations.Set(vec(own), code)
        quats = [Gf.Quatf(float(np.cos(t / 2)), float(np.sin(t / 2)), 0, 0) for t in turns]
        rotations.Set(Vt.QuatfArray(quats), code)
    points, counts, indices = body()
    local = 100.0 * np.column_stack([points[:, 0], points[:, 2], -points[:, 1]])
    mesh = add_mesh(stage, "/creature/skin", local, counts, indices)
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    at = (points[:, 1] + HALF) / (places[1] - places[0])
    middle = np.clip(np.round(at), 1, JOINTS - 2).astype(int)
    off = at - middle
    weights = np.column_stack([(0.5 - off) ** 2 / 2, 0.75 - off**2, (0.5 + off) ** 2 / 2])
    near = middle[:, None] + np.arange(-1, 2)
    binding.CreateJointIndicesPrimvar(False, 3).Set(near.ravel().tolist())
    binding.CreateJointWeightsPrimvar(False, 3).Set(weights.ravel().tolist())
    api = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    api.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    stage.Save()


def write_shot(folder: Path, make, count=60, more="", skin="", frames=(FIRST, LAST)):
    """A shot with a row of feathers along the body's back edge; make: sampled or skinned."""
    folder.mkdir(exist_ok=True)
    make(folder / "creature.usda")
    root = "direction = [-1, 0, 0.1], up = [0, 0, 1]"
    (folder / "groom.toml").write_text(
        f'name = "row"\n[[row]]\nid = "row"\nkind = "covert"\ncount = {count}\n'
        f"first = {{ position = [-0.17, -0.5, 0], {root} }}\n"
        f"last = {{ position = [-0.17, 0.5, 0], {root} }}\n"
    )
    path = folder / "shot.toml"
    path.write_text(
        f'name = "creature"\ngroom = "groom.toml"\nframes = [{frames[0]}, {frames[1]}]\n'
        f"{COARSE}{more}\n"
        f'[skin]\nusd = "creature.usda"\nprim = "/creature/skin"\ntolerance = 1\n{skin}\n'
    )
    return path


if __name__ == "__main__":
    skinned(Path(sys.argv[1]))
