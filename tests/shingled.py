"""Feathers that lie on each other like shingles, and on a level skin, to try layers on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from places import SAMPLES

from featherfx.feather.crossings import find_intersections, make_patches
from featherfx.feather.shapes import build_feathers
from featherfx.feather.types import RACHIS_PART
from featherfx.groom.types import Placement
from featherfx.shot.layers import layers
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.read.read import read_shot
from featherfx.shot.types import Contact, Detail, Layers, Motion, Shot

THICKNESS = 1e-3


def in_line(count: int, step: np.ndarray, frames: int, **quality: object) -> Shot:
    """Like feathers, each a step (m) behind the last, whose roots swing together in still air."""
    shot = read_shot(SAMPLES / "feather_pull" / "shot.toml")
    one = shot.groom.feathers[0]
    feathers = tuple(
        replace(one, id=f"f{k}", region="coat", position=k * step, rank=count - k)
        for k in range(count)
    )
    swing = {
        "amplitude": 0.03,
        "frequency": 3.0,
        "direction": (0.0, 0.0, 1.0),
        "ramp_periods": 0.25,
    }
    return replace(
        shot,
        groom=replace(shot.groom, feathers=feathers),
        first_frame=0,
        last_frame=frames,
        grips=(),
        motion=Motion("shake", swing),
        wind=replace(shot.wind, speed=0.0, gust=0.0),
        quality=replace(
            shot.quality.pushing, columns=3, coefficients=1, simulated_rows=0, **quality
        ),
    )


def shingles(count: int = 5, frames: int = 4) -> Shot:
    """Feathers behind each other along their shafts, in one line, that swing; some follow. A layout
    is said to have laid each over the next, though they are bent so that they lie in each other."""
    length = read_shot(SAMPLES / "feather_pull" / "shot.toml").groom.feathers[0].kind.length
    return replace(
        in_line(count, np.array([0.25 * length, 0.0, 0.0]), frames, rows=11),
        details=(Detail(level="guided", every=4),),
        layers=Layers(Contact(THICKNESS)),
    )


def least_gap(upper: np.ndarray, lower: np.ndarray) -> float:
    """m, of the nodes of one vane over the other, along z, by triangles of its grid."""
    m = (lower.shape[1] - 3) // 2
    columns = [*range(2 + 2 * m, 2 + m, -1), 0, *range(3, 3 + m)]
    low, high = lower[:, columns], upper[:, columns].reshape(-1, 3)
    corners = np.concatenate(
        [
            np.stack([low[:-1, :-1], low[1:, :-1], low[:-1, 1:]], axis=2).reshape(-1, 3, 3),
            np.stack([low[1:, :-1], low[1:, 1:], low[:-1, 1:]], axis=2).reshape(-1, 3, 3),
        ]
    )
    a, b, c = (corners[:, k] for k in range(3))
    gaps = []
    for x in high:
        u, v, w = (b - a)[:, :2], (c - a)[:, :2], (x - a)[:, :2]
        det = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        sound = np.abs(det) > 1e-12
        det = np.where(sound, det, 1.0)
        p = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / det
        q = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / det
        over = sound & (p >= 0) & (q >= 0) & (p + q <= 1)
        z = a[:, 2] + p * (b - a)[:, 2] + q * (c - a)[:, 2]
        gaps += (x[2] - z[over]).tolist()
    return min(gaps, default=np.inf)


def crossings(shot: Shot, frame) -> int:
    """Triangles of vanes that pass through each other."""
    rows, columns = shot.quality.rows, shot.quality.columns
    feathers = build_feathers(shot.groom.feathers, rows, columns)
    meshes, offset = [], []
    for k, (feather, pose) in enumerate(zip(feathers, frame.poses, strict=True)):
        surface = feather.surface
        vanes = surface.triangles[surface.part != RACHIS_PART]
        offset.append(surface.points(pose.points))
        meshes.append((offset[-1], vanes, np.zeros(len(vanes), dtype=bool), k))
    return int(find_intersections(np.concatenate(offset), make_patches(meshes)).vanes.sum())


def askew(one: Placement, k: int, angle: float = 6.0) -> Placement:
    """Rolled by an angle in degrees, one way or the other."""
    roll = np.radians(angle) * (-1) ** k
    c, s = np.cos(roll), np.sin(roll)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return replace(one, rotation=one.rotation @ turn)


def depths(points) -> float:
    """m, how deep feathers are in those beneath them, the deepest."""
    count = len(points)
    return -min(least_gap(points[k], points[j]) for k in range(count) for j in range(k + 1, count))


def lay(plumage, poses, skin, frame, duration):
    plumage.ask(list(poses), skin, duration)
    return plumage.lay(frame)


def farthest(laid, before) -> float:
    return float(np.linalg.norm(laid.points.nodes - before.points.nodes, axis=-1).max())


def sinking(
    ease: float, when: tuple[int, ...] = (10, 11, 12)
) -> tuple[Shot, layers.LayeredPlumage, list, list]:
    """A shot, its layers, and poses of a feather and of what it lies over: it is beneath that, all
    at once, in some of 24 samples. Where it is before it is laid, too."""
    shot = shingles(2)
    shot = replace(shot, layers=replace(shot.layers, ease=ease))
    upper, lower = next(iter(simulate(replace(shot, layers=None)))).poses
    sunk = replace(upper, points=upper.points.shifted(np.array([0.0, 0.0, -0.02])))
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    poses = [[sunk if k in when else upper, lower] for k in range(24)]
    return shot, layers.LayeredPlumage(shot, drawn, np.arange(2), 1), poses


def lifted(
    shot: Shot, plumage: layers.LayeredPlumage, poses: list, first: int = 0
) -> tuple[list, dict]:
    """Poses as they are laid, from a sample on, and the memory after the sixth sample."""
    step, none = 1.0 / shot.frames_per_second, np.zeros((0, 3))
    ahead, found, memory = shot.layers.samples_ahead(step), [], {}
    for k in range(first, len(poses) + ahead):
        if k < len(poses):
            plumage.ask(list(poses[k]), none, step if k else 0.0)
        if k - first >= ahead:
            found.append(plumage.lay(float(k - ahead)))
        if k - ahead == 5:
            memory = plumage.memory()
    return found, memory


class Sheet:
    """A level square that does not move, as featherfx.shot.sources.MovingSurface has it."""

    path, st, sampled, bones, is_ribbon = "/sheet", None, None, None, False
    triangles, face = np.array([[0, 1, 2], [0, 2, 3]]), np.array([0, 0])
    time_codes_per_second, has_rate = 24.0, True

    def __init__(self, height: float) -> None:
        self.rest = np.array([[-1.0, -1, height], [1, -1, height], [1, 1, height], [-1, 1, height]])

    def points(self, code: float) -> np.ndarray:
        return self.rest
