"""Bodies that an act moves: it carries a skin as one piece, and drives the joints of its skeleton.

With `body = "act"` the skin stands as it is at the first frame. With the turn R and the way d of
the groom under the act, a point x of it goes to R x + d. Roots, coat and contact see the surface
there, and limbs fold on it as on any other skin.

A joint s of the skeleton that a joint j of the groom drives stands, with row vectors, at

    M_s(t) = M_s(rest) C_j(t) M_a(rest)^-1 M_a(t),

with the carrier C_j of j from rest, the body's own turn and way left out, and a the nearest joint
above s below which all is driven: the skeleton itself where there is none. So bone and feathers of
a limb are moved as one. Other joints keep their places against those above them.

Bodies that an act leads through a collider, such as the ground.

Points of the skin are followed from frame to frame. Over a triangle that a point p is nearest to,
with the normal n and the nearest place c, its height is n (p - c), where p stands over that place.
Where the height changes its sign from one frame to the next, the point has gone through.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots, face_products
from featherfx.errors import InputWarning
from featherfx.groom.skin.skin import closest
from featherfx.shot.frames import StageClock
from featherfx.shot.motion.joints import PosesOverTime, Skeleton, skeleton_of
from featherfx.shot.motion.motion import joint_poses, without_body
from featherfx.shot.skin import SkinSurfaces
from featherfx.shot.sources import JointTree, MovingSurface, TimedSurface
from featherfx.shot.types import Shot

# turn (3, 3) and way (3,) m of a body at a time in s
BodyPath = Callable[[float], tuple[Array, Array]]
_ALWAYS = 1e9  # time codes, within which a body moves
_MAX_TIMES = 8  # times, at which roots and the skin as a body are asked for


def _matrix(turn: Array, way: Array) -> Array:
    """(..., 4, 4) for row vectors, of turns (..., 3, 3) and ways (..., 3)."""
    found = np.zeros((*way.shape[:-1], 4, 4))
    found[..., :3, :3], found[..., 3, :3], found[..., 3, 3] = turn.swapaxes(-1, -2), way, 1.0
    return found


@dataclass(frozen=True)
class JointDrive:
    """Joints of a skeleton that an act drives. driven: of each, the number of the groom's joint.

    poses: of the groom's joints over time, without the body. rest: (J + 1, 4, 4) at rest, as of
    MovingSurface.joint_matrices.
    """

    tree: JointTree
    driven: Mapping[int, int]
    skeleton: Skeleton
    poses: PosesOverTime
    rest: Array

    def anchor(self, joint: int) -> int:
        """Return the joint above all that is driven above a joint; -1: the skeleton itself."""
        above, found = joint, joint
        while above >= 0:
            found = above if above in self.driven else found
            above = int(self.tree.parents[above])
        return int(self.tree.parents[found])

    def bearing(self, joint: int, now: Array) -> Array:
        """(4, 4) from rest to where the anchor of a joint takes what hangs on it. now: (J + 1, 4,
        4)."""
        anchor = self.anchor(joint)
        return np.asarray(np.linalg.inv(self.rest[anchor]) @ now[anchor])

    def matrices(self, now: Array, time: float) -> Array:
        """(J + 1, 4, 4), joints that stand at now (J + 1, 4, 4) but for those that are driven, at a
        time in s."""
        carriers = _matrix(*self.skeleton.carriers(self.poses(time)))
        own, found = now[:-1] @ np.linalg.inv(now[self.tree.parents]), now.copy()
        for joint, parent in enumerate(self.tree.parents):
            found[joint] = own[joint] @ found[parent]
            if joint in self.driven:
                moved = self.rest[joint] @ carriers[self.driven[joint]]
                found[joint] = moved @ self.bearing(joint, now)
        return found


class BodySurface:
    """A surface that an act moves. own: as the scene has it. clock: of its stage.

    path: along which the body is carried as it is at the first frame; None: it moves as the scene
    has it. drive: of its skeleton's joints. All else is that of the surface at the first frame
    (sources.MovingSurface).
    """

    sampled, knots = (-_ALWAYS, _ALWAYS), None

    def __init__(
        self,
        own: MovingSurface,
        path: BodyPath | None,
        clock: StageClock,
        drive: JointDrive | None = None,
    ) -> None:
        self.own, self.body_path, self._clock, self.drive = own, path, clock, drive
        self._posed = lru_cache(_MAX_TIMES)(self._pose)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "own":
            raise AttributeError(name)
        return getattr(self.own, name)

    def carriers(self, code: float) -> tuple[Array, Array]:
        """Turn (3, 3) and way (3,) m of the body at a time code."""
        if self.body_path is None:
            return np.eye(3), np.zeros(3)
        return self.body_path(self._time(code))

    def joints(self, code: float) -> Array:
        """(J + 1, 4, 4), joints of the skeleton at a time code before the body is carried."""
        assert self.drive is not None
        now = self.own.joint_matrices(self.own_code(code))
        return self.drive.matrices(now, self._time(code))

    def bearing(self, joint: int, code: float) -> tuple[Array, Array]:
        """Turn (3, 3) and way (3,) m of a limb, from rest, at a time code. joint: of the groom."""
        assert self.drive is not None
        place = next(k for k, each in self.drive.driven.items() if each == joint)
        now = self.own.joint_matrices(self.own_code(code))
        borne = self.drive.bearing(place, now) @ _matrix(*self.carriers(code))
        left, _, right = np.linalg.svd(borne[:3, :3].T)
        return left @ right, borne[3, :3]

    def corners(self, code: float, triangles: Indices) -> Array:
        """(F, 3, 3) m, corners of triangles (F, 3) of points at a time code."""
        if self.drive is not None:
            return self._posed(code)[triangles]
        return self._carried(self.own.corners(self.own_code(code), triangles), code)

    def points(self, code: float) -> Array:
        """(V, 3) m, all points at a time code."""
        if self.drive is not None:
            return self._posed(code)
        return self._carried(self.own.points(self.own_code(code)), code)

    def is_mirrored(self, code: float) -> bool:
        """Return whether it is mirrored against rest."""
        return self.own.is_mirrored(self.own_code(code))

    def masked(self, chosen: Flags) -> BodySurface:
        """The same with some of its triangles (T,) alone."""
        return BodySurface(self.own.masked(chosen), self.body_path, self._clock, self.drive)

    def smoothed(self, knots: Any) -> BodySurface:
        """The same, where the act carries it: its path is smooth; else as MovingSurface."""
        if self.body_path is not None:
            return self
        return BodySurface(self.own.smoothed(knots), None, self._clock, self.drive)

    def own_code(self, code: float) -> float:
        """Return the time code of the scene's own motion at a time code."""
        return code if self.body_path is None else self._clock.start

    def _time(self, code: float) -> float:
        return (code - self._clock.start) / (self._clock.step * self._clock.frames_per_second)

    def _pose(self, code: float) -> Array:
        points = self.own.posed_points(self.own_code(code), self.joints(code))
        found = self._carried(points, code)
        found.flags.writeable = False
        return found

    def _carried(self, points: Array, code: float) -> Array:
        turn, way = self.carriers(code)
        return np.asarray(points @ turn.T + way)


def move_body(shot: Shot, skin: SkinSurfaces) -> tuple[SkinSurfaces, tuple[TimedSurface, ...]]:
    """The surfaces of a shot's skin, and its colliders, as its act moves them; of these, such as
    are of the skin's model."""
    values, skeleton = shot.motion.values, skeleton_of(shot.groom)
    poses = joint_poses(shot.motion, shot, skeleton)

    def path(time: float) -> tuple[Array, Array]:
        found = poses(time)
        return found.rotations[0], found.displacements[0]

    is_carried = values["body"] == "act"
    if is_carried and any(each.sampled is not None for each in skin.surfaces):
        told = "motion.body: the act carries the skin as it is at the first frame, without its own"
        keep = 'animation. body = "skin" keeps that'
        warnings.warn(f"{shot.source}: {told} {keep}", InputWarning, stacklevel=2)

    def moved(each: MovingSurface, clock: StageClock) -> MovingSurface:
        drive, tree = None, each.joint_tree
        if tree is not None and values["joints"]:
            driven = find_driven(values["joints"], tree, skeleton)
            rest = each.joint_matrices(None)
            drive = JointDrive(tree, driven, skeleton, without_body(poses), rest)
        if drive is None and not is_carried:
            return each
        return cast(MovingSurface, BodySurface(each, path if is_carried else None, clock, drive))

    models = {_model(each) for each in skin.surfaces}
    colliders = tuple(
        replace(each, surface=moved(each.surface, each.clock))
        if _model(each.surface) in models
        else each
        for each in shot.colliders
    )
    return replace(
        skin, surfaces=tuple(moved(each, skin.clock) for each in skin.surfaces)
    ), colliders


def _model(surface: MovingSurface) -> tuple[Path, str]:
    """File and root prim of a surface."""
    return surface.file, surface.path.split("/")[1]


def find_driven(names: Mapping[str, str], tree: JointTree, skeleton: Skeleton) -> dict[int, int]:
    """Find the joints of a skeleton that joints of a groom drive: numbers of these by theirs.

    names: of the skeleton's joints, by those of the groom's.
    """
    return {
        joint: skeleton.names.index(own) for own, name in names.items() for joint in tree.find(name)
    }


_DEEP = 0.01  # depth over the body's size, from which on it is told
_MAX_POINTS = 1000  # that are looked at
_MAX_FRAMES = 400  # likewise
_BESIDE = 1e-3  # of a distance, by which a point may be beside what it stands over


def warn_of_passage(shot: Shot, skin: SkinSurfaces, colliders: Sequence[TimedSurface]) -> None:
    """Say where an act leads a body through colliders, in which frame the deepest and how deep."""
    last = shot.last_frame - shot.first_frame
    frames = np.unique(np.linspace(0, last, _MAX_FRAMES).round().astype(int)).tolist()
    carried = [each for each in skin.surfaces if isinstance(each, BodySurface) and each.body_path]
    walls = [each for each in colliders if not isinstance(each.surface, BodySurface)]
    for surface in carried if walls else ():
        stride, body = -(-len(surface.rest) // _MAX_POINTS), TimedSurface(surface, skin.clock)
        ways = [body.points(k / shot.frames_per_second)[::stride] for k in frames]
        size = float(np.linalg.norm(np.ptp(ways[0], axis=0)))
        for wall in walls:
            deep = _depths(ways, wall, [k / shot.frames_per_second for k in frames])
            worst = int(deep.argmax())
            if deep[worst] > _DEEP * size:
                warnings.warn(
                    f"{shot.source}: motion: leads the body {surface.path} through collider"
                    f" {wall.surface.path}, by {1e3 * deep[worst]:.3g} mm at frame"
                    f" {shot.first_frame + frames[worst]}. Give a path that stays outside",
                    InputWarning,
                    stacklevel=2,
                )


def _depths(ways: Sequence[Array], wall: TimedSurface, times: Sequence[float]) -> Array:
    """(K,) m, how deep a body is in a collider, and was not at first. ways: points (V, 3) m of the
    body at times (K,) s."""
    deep, before, through = np.zeros(len(ways)), np.zeros(len(ways[0])), None
    usual = 0.0
    for k, (points, time) in enumerate(zip(ways, times, strict=True)):
        heights = _heights(points, wall.points(time)[wall.surface.triangles])
        if through is None and heights.any():
            through = heights * np.sign(heights.sum()) < 0.0
            usual = np.abs(heights[through]).max(initial=0.0)
        if through is None:
            continue
        through ^= heights * before < 0.0
        before, deep[k] = heights, max(0.0, np.abs(heights[through]).max(initial=0.0) - usual)
    return deep


def _heights(points: Array, corners: Array) -> Array:
    """(N,) m, of points (N, 3) over the triangles (T, 3, 3) that they are nearest to; 0 where they
    stand over none."""
    triangle, weights = closest(points, corners)
    away = points - np.einsum("nk,nkc->nc", weights, corners[triangle])
    normals = face_products(corners[triangle])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    height = dots(away, normals)
    beside = np.linalg.norm(away - height[:, None] * normals, axis=1)
    return np.where(beside <= _BESIDE * np.abs(height), height, 0.0)
