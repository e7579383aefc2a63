"""Wings, tails and crests that open and close on a skin: it carries the joint that they hang on.

The first joint of a limb goes with the skin as the root that is nearest to it; feathers of the limb
go with that joint and with the poses of those below it, all others with the skin. On a skeleton the
bones of wings go with its bones, and feathers between forearm and hand turn as these do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputError, Problem
from featherfx.groom.skin.skin import Binding, bind, follow
from featherfx.groom.types import Groom
from featherfx.shot.frames import StageClock
from featherfx.shot.motion.body import BodySurface
from featherfx.shot.motion.joints import (
    JointPoses,
    Skeleton,
    first_joints,
    joint_roots,
    of_wings,
    skeleton_of,
)
from featherfx.shot.roots import RootFrames, Roots
from featherfx.shot.skin import BoundSkin
from featherfx.shot.sources import MovingSurface
from featherfx.shot.types import Shot

# turn (3, 3) and way (3,) m of a limb from rest, at a time in s
LimbWay = Callable[[float], tuple[Array, Array]]
# times as far as another wing's bone, from which on one is beside the bone that bears both
_ASIDE = 4.0


@dataclass(frozen=True)
class LimbRoots:
    """Roots of a skin, some of them on limbs.

    members: (L,) feathers of limbs. bearers: (L,) the feather whose root carries each one's limb.
    rest: (F,) roots in the groom's frame. driven: of limbs that go with a body or with bones that
    an act moves (body.py), which members these are, and the way of their limb.
    """

    skin: Roots
    joints: Roots
    members: Indices
    bearers: Indices
    rest: RootFrames
    driven: Sequence[tuple[Flags, LimbWay]] = ()

    def frames(self, time: float) -> RootFrames:
        """Return where the roots are at a time, s since the first frame."""
        positions, rotations = self.skin.frames(time)
        moved = self.joints.frames(time)
        bearer, own = self.bearers, self.members
        turn = rotations[bearer] @ self.rest.rotations[bearer].transpose(0, 2, 1)
        away = (moved.positions[own] - self.rest.positions[bearer])[:, :, None]
        places = positions[bearer] + (turn @ away)[:, :, 0]
        for which, bearing in self.driven:
            turn[which], way = bearing(time)
            places[which] = moved.positions[own[which]] @ turn[which][0].T + way
        positions[own], rotations[own] = places, turn @ moved.rotations[own]
        return RootFrames(positions, rotations)


def carried(groom: Groom, skin: Roots, joints: Roots) -> Roots:
    """The roots of a groom on a skin whose limbs fold as their joints do."""
    joint_of = {joint.name: joint for joint in groom.joints}
    firsts = first_joints(groom)
    rest = RootFrames(
        np.array([each.position for each in groom.feathers]),
        np.array([each.rotation for each in groom.feathers]),
    )
    members = np.flatnonzero([each.turning is not None for each in groom.feathers])
    bearer = {
        name: int(np.linalg.norm(rest.positions - joint_of[name].position, axis=1).argmin())
        for name in set(firsts.values())
    }
    limbs = [firsts[groom.feathers[k].joint] for k in members]
    bearers = np.array([bearer[each] for each in limbs], dtype=np.int64)
    ways = {} if not isinstance(skin, BoundSkin) else _trunk_ways(groom, skin, rest, bearer)
    if isinstance(skin, BoundSkin):
        ways |= _driven_ways(skin, firsts, [joint.name for joint in groom.joints])
    driven = [
        (np.array([each == first for each in limbs]), way)
        for first, way in ways.items()
        if first in limbs
    ]
    return LimbRoots(skin, joints, members, bearers, rest, driven)


def _trunk_ways(
    groom: Groom, skin: BoundSkin, rest: RootFrames, bearer: Mapping[str, int]
) -> dict[str, LimbWay]:
    """Ways of wings on a body that an act carries, by their first joints: a neck that bends takes
    the skin beside a shoulder along, not the wing. bearer: feathers by first joints."""
    surfaces: Sequence[object] = [part.surface for part in skin.parts]
    bodies = [each for each in surfaces if isinstance(each, BodySurface)]
    body = next((each for each in bodies if each.body_path and each.drive), None)
    shoulders = [j.name for j in groom.joints if j.role == "shoulder" and j.name in bearer]
    if body is None or not shoulders:
        return {}
    still = skin.led(_undriven, skin.clock).frames(0.0)

    def way_of(k: int) -> LimbWay:
        first = still.rotations[k] @ rest.rotations[k].T
        begin = still.positions[k] - first @ rest.positions[k]

        def way(time: float) -> tuple[Array, Array]:
            turn, along = body.carriers(skin.clock.code(time))
            return turn @ first, turn @ begin + along

        return way

    return {name: way_of(bearer[name]) for name in shoulders}


def _undriven(surface: MovingSurface) -> MovingSurface:
    return surface.own if isinstance(surface, BodySurface) else surface


def _driven_ways(
    skin: BoundSkin, firsts: Mapping[str, str], names: Sequence[str]
) -> dict[str, LimbWay]:
    """Ways of limbs whose bones an act moves, by their first joints. firsts: by names of joints."""
    found: dict[str, LimbWay] = {}
    for part in skin.parts:
        body = part.surface
        if isinstance(body, BodySurface) and body.drive is not None:
            for joint in sorted(body.drive.driven.values()):
                found.setdefault(firsts[names[joint - 1]], _bearing(body, joint, skin.clock))
    return found


def _bearing(body: BodySurface, joint: int, clock: StageClock) -> LimbWay:
    return lambda time: body.bearing(joint, clock.code(time))


def limbs_of(groom: Groom) -> Indices:
    """(F,) the limb that each feather of a groom is of, from 1 on; 0 for those of the skin."""
    firsts = first_joints(groom)
    number = {name: k for k, name in enumerate(dict.fromkeys(firsts.values()), 1)}
    found = [0 if each.turning is None else number[firsts[each.joint]] for each in groom.feathers]
    return np.array(found, dtype=np.int64)


@dataclass(frozen=True)
class _Bones:
    """B bones of wings on the ribbons of a skeleton. joints: (B,) of the groom. middles: (B, 3) m.

    triangles: (U, 3) points of the ribbons that the binding uses.
    """

    skeleton: Skeleton
    joints: Indices
    middles: Array
    surface: MovingSurface
    binding: Binding
    triangles: Indices
    clock: StageClock

    def poses(self, time: float) -> JointPoses:
        """Return the poses of the groom's joints; those of no wing stay. time: s since the first
        frame."""
        code = self.clock.code(time)
        corners = self.surface.corners(code, self.triangles)
        places, turns = follow(self.binding, corners, self.surface.is_mirrored(code))
        count = len(self.skeleton.names)
        rotations, shifts = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
        rotations[self.joints] = turns
        shifts[self.joints] = places - np.einsum("bij,bj->bi", turns, self.middles)
        return self.skeleton.poses(rotations, shifts)


@dataclass(frozen=True)
class _WingRoots:
    """Roots of a skin, of which members (L,) go with the joints of wings."""

    skin: Roots
    wings: Roots
    members: Indices

    def frames(self, time: float) -> RootFrames:
        """Return where the roots are at a time, s since the first frame."""
        positions, rotations = self.skin.frames(time)
        moved, own = self.wings.frames(time), self.members
        positions[own], rotations[own] = moved.positions[own], moved.rotations[own]
        return RootFrames(positions, rotations)


def skin_roots(groom: Groom, skin: BoundSkin, limbs: Roots | None = None) -> Roots:
    """The roots of a groom on a skin; limbs: roots of wings, tails and crests that fold."""
    return on_bones(groom, skin) if limbs is None else carried(groom, skin, limbs)


def on_bones(groom: Groom, skin: BoundSkin) -> Roots:
    """The roots of a groom on a skin; where that is a skeleton, its bones move the wings'."""
    ribbons = next((part.surface for part in skin.parts if part.surface.bones is not None), None)
    bones = {k: each.bone for k, each in enumerate(groom.joints, 1) if each.bone is not None}
    names = {groom.joints[k - 1].name for k in bones}
    members = [
        k
        for k, each in enumerate(groom.feathers)
        if each.turning is not None and names.issuperset(each.turning.joints)
    ]
    if ribbons is None or not members:
        return skin
    middles = np.array(list(bones.values()))
    binding = bind(middles, ribbons.rest, ribbons.triangles)
    _refuse_one_wing([groom.joints[k - 1].name for k in bones], groom, ribbons, binding)
    used, skeleton = ribbons.triangles[binding.used], skeleton_of(groom)
    joints = np.array(list(bones), dtype=np.int64)
    own = _Bones(skeleton, joints, middles, ribbons, binding, used, skin.clock)
    roots = replace(joint_roots(groom, skeleton, own.poses), are_beaten=False)
    return _WingRoots(skin, roots, np.array(members))


def _refuse_one_wing(
    names: Sequence[str], groom: Groom, ribbons: MovingSurface, binding: Binding
) -> None:
    """Raise InputError where a bone of a skeleton carries a wing's that it lies on, and one of
    another wing that is far from it: the skeleton has one wing only. names: of B joints."""
    firsts, bone, away = first_joints(groom), ribbons.face[binding.triangle], binding.distance
    for near in np.argsort(away, kind="stable"):
        others = np.flatnonzero((bone == bone[near]) & (away > _ASIDE * away[near]))
        for far in others[np.argsort(-away[others], kind="stable")]:
            length = float(np.linalg.norm(_way_of(names[far], groom)))
            if firsts[names[far]] != firsts[names[near]] and away[far] > length:
                told = (
                    f"the bone nearest to '{names[far]}' is {away[far]:.3g} m away and is that of "
                    f"'{names[near]}', {away[near]:.3g} m away: has the skeleton one wing only? "
                    "Name joints of both sides, or leave out `skeleton` or that wing"
                )
                raise InputError(Problem(ribbons.path, "joints", told))


def _way_of(name: str, groom: Groom) -> Array:
    """(3,) m, from a joint of a wing to the middle of its bone, twice."""
    joint = next(each for each in groom.joints if each.name == name)
    assert joint.bone is not None
    return 2.0 * (np.array(joint.bone) - np.array(joint.position))


def moving_limbs(shot: Shot) -> Indices:
    """(F,) which wing moves each feather beside the skin of a shot, 0 for none. Tails and crests
    open where they are, and leave nothing that they lie on or under."""
    skin, limbs = shot.skin, limbs_of(shot.groom)
    if skin is None or not (shot.motion.of_limbs or on_bones(shot.groom, skin) is not skin):
        return np.zeros_like(limbs)
    return np.where(of_wings(shot.groom), limbs, 0)
