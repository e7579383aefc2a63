"""The motion of a shot: which source moves its roots, and the paths that the solver follows.

Inputs that the motion of each feather depends on, as one short text: equal texts, equal motion.

A feather that is simulated depends on its shape and materials, on its root, on what pulls or
shelters it, on its levels of detail, and on what all have in common: wind, motion, quality, frame
rate. One that follows guides depends on theirs as well, and one that pushes others on all of its
island (contact/partition.py).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from featherfx.algebra.interpolation import eased
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots, frames_to_quats, rotation_vectors, vectors_to_frames
from featherfx.feather.placed_feathers import build_feathers
from featherfx.files.disk_cache import digest, digests, members
from featherfx.groom.keys.preset import UNSCALED_CLOCK, Clock
from featherfx.groom.types import Placement
from featherfx.mechanics.resolution import is_guarded
from featherfx.packages import MOTION_SOURCES, brought, load_name
from featherfx.shot.frames import NO_CUTS
from featherfx.shot.loads import exposures
from featherfx.shot.motion.joints import (
    JointPoses,
    PosesOverTime,
    Skeleton,
    joint_roots,
    skeleton_of,
)
from featherfx.shot.options import ShotOptions, resolve_options
from featherfx.shot.patterns import last_fitting
from featherfx.shot.roots import SAMPLES, Roots, arrived
from featherfx.shot.types import Motion, Shot
from featherfx.solver.state import RootPath

if TYPE_CHECKING:
    from featherfx.shot.skin import BoundSkin


def root_motion(shot: Shot) -> Roots:
    """Find what moves the roots of a shot, its channels and cuts included.

    Raises InputError for a motion whose joints the groom lacks.
    """
    return uncut_motion(prepare_cuts(shot))


def prepare_cuts(shot: Shot) -> Shot:
    """The shot with its cuts, where anything moves."""
    if shot.frame_cuts is not NO_CUTS or not (shot.has_moving_roots or shot.colliders):
        return shot
    found: Shot = load_name("motion.cuts:with_cuts")(shot)
    return found


def uncut_motion(shot: Shot) -> Roots:
    """The same as its stages and keyframes have it where they are not led by cuts."""
    motion = undirected_motion(shot)
    for change in brought(shot, "roots"):
        motion = change(shot, motion)
    return motion


def undirected_motion(shot: Shot) -> Roots:
    """Beside a skin the motion's limbs count, and the skin carries them; without them the bones of
    a skeleton move wings."""
    if shot.skin is None:
        skeleton = skeleton_of(shot.groom)
        return joint_roots(shot.groom, skeleton, joint_poses(shot.motion, shot, skeleton))
    skin_roots = load_name("motion.limbs:skin_roots")
    if not shot.motion.of_limbs:
        return skin_roots(shot.groom, shot.skin)
    skeleton = skeleton_of(shot.groom)
    poses = without_body(joint_poses(shot.motion, shot, skeleton))
    return skin_roots(shot.groom, shot.skin, joint_roots(shot.groom, skeleton, poses))


def joint_poses(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of the joints of a shot's groom under a motion, in the time of its clock."""
    if motion.kind == "act":
        motion = _size_of_parts(motion)
    clock, source = motion.clock, load_name(MOTION_SOURCES[motion.kind])
    if clock == UNSCALED_CLOCK:
        poses: PosesOverTime = source(motion, shot, skeleton)
        return poses
    # what falls does so in its own ways and time, which the clock takes to the shot's
    own = replace(shot, gravity=shot.gravity / (clock.size * clock.tempo**2))
    return _clocked_poses(source(motion, own, skeleton), clock)


def _size_of_parts(motion: Motion) -> Motion:
    """An act whose parts have its size, so that it puts them together in the groom's own."""
    size, parts = motion.clock.size, motion.values["motions"]
    parts = tuple(replace(p, clock=replace(p.clock, size=size * p.clock.size)) for p in parts)
    clock = replace(motion.clock, size=1.0)
    return replace(motion, values=motion.values | {"motions": parts}, clock=clock)


def _clocked_poses(poses: PosesOverTime, clock: Clock) -> PosesOverTime:
    """Poses in the time, and by the amount, of a clock."""
    times, amounts = zip(*clock.amount, strict=True)

    def changed(time: float) -> JointPoses:
        own = (time - clock.start) * clock.tempo
        found, amount = poses(own), eased(times, amounts, own)
        if amount == 1.0 == clock.size:
            return found
        fraction = min(amount, 1.0)
        return JointPoses(
            rotations=scaled_turns(found.rotations, amount),
            displacements=clock.size * amount * found.displacements,
            bends=amount * found.bends,
            folds=amount * found.folds,
            aims=fraction * found.aims,
            taken=fraction * found.taken,
        )

    return changed


def scaled_turns(rotations: Array, amount: Array | float) -> Array:
    """Part of (J, 3, 3) rotations, about their axes."""
    return vectors_to_frames(amount * rotation_vectors(rotations))


def without_body(poses: PosesOverTime) -> PosesOverTime:
    """Poses of joints that leave the groom itself where it is."""

    def limbs(time: float) -> JointPoses:
        found = poses(time)
        rotations, displacements = found.rotations.copy(), found.displacements.copy()
        rotations[0], displacements[0] = np.eye(3), 0.0
        return found._replace(rotations=rotations, displacements=displacements)

    return limbs


def root_path(motion: Roots, members: Indices, start: float, end: float) -> RootPath:
    """Paths of the roots with indices members (F,) from start to end (s)."""
    times = np.linspace(start, end, SAMPLES)[1:]
    frames = [arrived(motion, start), *(motion.frames(time) for time in times)]
    positions = np.stack([each.positions[members] for each in frames], axis=1)
    rotations = np.stack([each.rotations[members] for each in frames], axis=1)
    relative = np.einsum("fkij,flj->fkil", rotations, rotations[:, 0])
    vectors = rotation_vectors(relative)
    for k in range(1, SAMPLES):
        vectors[:, k] = _nearest_branch(vectors[:, k], vectors[:, k - 1])
    samples = np.concatenate([positions, vectors], axis=2)
    return RootPath(samples, frames_to_quats(rotations[:, 0]))


def _nearest_branch(vectors: Array, before: Array) -> Array:
    """Rotation vectors (F, 3) on the branch (full turns added) nearest to those before."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    axis = np.divide(vectors, angle, out=np.zeros_like(vectors), where=angle > 1e-12)
    turns = np.round((dots(before, axis) - angle[:, 0]) / (2 * np.pi))
    return vectors + 2 * np.pi * turns[:, None] * axis


# of a shot, what does not count, and what counts for each feather by itself
_NOT_COMMON = {
    "name", "groom", "last_frame", "grips", "forces", "details", "shelters", "exposure",
    "level_of_detail", "skin", "surfaces", "inputs", "colliders", "contact", "wets", "detachments",
    "channels", "targets", "frame_cuts",
}  # fmt: skip
# of a feather, what only the output has, or contact asks for
_NOT_MOVING = {"id", "region", "rank", "grown", "skin", "skin_uv"}


def motion_dependences(shot: Shot, options: ShotOptions | None = None) -> list[str]:
    """Name what the motion of every feather of a shot that is placed on its skin depends on, in the
    groom's order. options: resolved, None: not yet. Raises InputError for shapes that cannot be
    built, and for levels that cannot be."""
    cut = prepare_cuts(shot)
    motion = uncut_motion(cut)
    if options is None:
        drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
        options = resolve_options(cut, drawn, motion)
    common = digest(_common(shot))
    each = _each(shot, options, motion)
    for more in brought(shot, "dependences"):
        values = zip(each, more(shot, motion), strict=True)
        each = [own if value is None else [*own, value] for own, value in values]
    texts = digests([common, *own] for own in each)
    # what pushes a feather, and then what it follows
    for spread in reversed(brought(shot, "spreads")):
        texts = spread(shot, options, texts)
    return texts


def _common(shot: Shot) -> list[Any]:
    found: list[Any] = [each for each in members(shot) if each[0] not in _NOT_COMMON]
    skin = shot.skin
    surfaces = [] if skin is None else [skin.clock, *(part.surface for part in skin.parts)]
    return [*found, shot.groom.joints, shot.groom.drawn_gravity, surfaces]


def _each(shot: Shot, options: ShotOptions, motion: Roots) -> list[list[Any]]:
    """List what counts for each feather by itself."""
    placements = shot.groom.feathers
    shelter = exposures(shot).tolist()
    roots = _roots(shot.skin, len(placements))
    guarded = _guarded(shot, options)
    rules = [
        [each[number] if number >= 0 else None for number in last_fitting(each, placements)]
        for each in (shot.wets, shot.detachments)
    ]
    pulls: dict[str, list[Any]] = {}
    for grip in shot.grips:
        pulls.setdefault(grip.feather, []).append(grip)
    for force in shot.forces:
        pulls.setdefault(force.feather, []).append(force)
    return [
        [
            _shape_and_root(placement),
            roots[f],
            pulls.get(placement.id, []),
            shelter[f],
            options.feathers[f].values(),
            guarded[f],
            [each[f] for each in rules],
        ]
        for f, placement in enumerate(placements)
    ]


def _shape_and_root(placement: Placement) -> list[Any]:
    kind = placement.kind
    placement = replace(
        placement,
        kind=kind.uncoloured,
        prototype=placement.prototype and placement.prototype.uncoloured,
    )
    if placement.prototype is None:
        return [value for name, value in members(placement) if name not in _NOT_MOVING]
    # the kind has the prototype's shape in its size, and materials of its own
    left_out = {*_NOT_MOVING, "kind"}
    own = [kind.vane_material, kind.rachis_material, kind.rachis, kind.length]
    return [own, *(value for name, value in members(placement) if name not in left_out)]


def _guarded(shot: Shot, options: ShotOptions) -> list[bool]:
    """Return whether a feather is computed with the terms of a compression guard, its own or
    another's of its batch."""
    guards = [is_guarded(p.kind, touching=False) for p in shot.groom.feathers]
    with_guard = {own for own, guard in zip(options.feathers, guards, strict=True) if guard}
    return [own in with_guard for own in options.feathers]


def _roots(skin: BoundSkin | None, count: int) -> list[Any]:
    """List where each root sits on its skin, and by which triangles it turns."""
    found: list[Any] = [None] * count
    for part in () if skin is None else skin.parts:
        binding = part.binding
        field = binding.field
        ends = np.append(field.starts[1:], len(field.places))
        for k, f in enumerate(part.members.tolist()):
            pairs = slice(field.starts[k], ends[k])
            turned_by = binding.used[field.places[pairs]], field.weights[pairs], field.upright[k]
            sits = binding.triangle[k], binding.barycentric[k], binding.offset[k]
            found[f] = [part.surface.path, *sits, *turned_by]
    return found
