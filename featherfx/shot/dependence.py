"""What the motion of each feather depends on, as one short text: equal texts, equal motion.

A feather that is simulated depends on its shape and materials, on its root, on what pulls or
shelters it, on its levels of detail, and on what all have in common: wind, motion, quality, frame
rate. One that follows guides depends on theirs as well. Where feathers touch, each depends on all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from featherfx.feather.shapes import feathers_of
from featherfx.files.content import digest, digests, members
from featherfx.groom.types import Placement
from featherfx.shot.detail.guides import guide_weights
from featherfx.shot.detail.levels import LevelPlan, level_plan
from featherfx.shot.loads.wind import exposures
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.motion.skin import BoundSkin
from featherfx.shot.types import Shot

# of a shot, what does not count, and what counts for each feather by itself
_NOT_COMMON = {
    "name", "groom", "last_frame", "grips", "forces", "details", "shelters", "level_of_detail",
    "skin", "surfaces", "inputs", "colliders", "contact",
}  # fmt: skip
# of a feather, what only the output has, or contact asks for
_NOT_MOVING = {"id", "region", "layer", "stack", "rank", "grown", "skin", "skin_uv"}


def dependences(shot: Shot) -> list[str]:
    """Of every feather of a shot that is placed on its skin, in the groom's order.

    Raises InputError for shapes that cannot be built, and for levels that cannot be.
    """
    drawn = feathers_of(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    plan = level_plan(shot, drawn, root_motion(shot))
    common = digest(_common(shot))
    own = digests([common, *each] for each in _each(shot, plan))
    if shot.contact is not None:
        together = digest(own, shot.contact, shot.colliders, _layers(shot))
        return [digest(each, together) for each in own]
    return _with_guides(shot, plan, own)


def _common(shot: Shot) -> list[Any]:
    found: list[Any] = [each for each in members(shot) if each[0] not in _NOT_COMMON]
    skin = shot.skin
    surfaces = [] if skin is None else [skin.start, *(part.surface for part in skin.parts)]
    return [*found, shot.groom.joints, surfaces]


def _each(shot: Shot, plan: LevelPlan) -> list[list[Any]]:
    """What counts for each feather by itself."""
    placements = shot.groom.feathers
    shelter = exposures(shot).tolist()
    roots = _roots(shot.skin, len(placements))
    guarded = _guarded(shot, plan)
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
            plan.resolutions[f],
            plan.table[:, f],
            guarded[f],
        ]
        for f, placement in enumerate(placements)
    ]


def _shape_and_root(placement: Placement) -> list[Any]:
    kind = placement.kind
    if placement.prototype is None:
        return [value for name, value in members(placement) if name not in _NOT_MOVING]
    # the kind has the prototype's shape in its size, and materials of its own
    left_out = {*_NOT_MOVING, "kind"}
    own = [kind.vane_material, kind.rachis_material, kind.rachis, kind.length]
    return [own, *(value for name, value in members(placement) if name not in left_out)]


def _guarded(shot: Shot, plan: LevelPlan) -> list[bool]:
    """Whether a feather is computed with the terms of a compression guard, its own or another's of
    its batch."""
    guards = [p.kind.vane_material.compression_guard > 0.0 for p in shot.groom.feathers]
    with_guard = {each for own, guard in zip(plan.resolutions, guards, strict=True) if guard
                  for each in own}  # fmt: skip
    return [any(each in with_guard for each in own) for own in plan.resolutions]


def _roots(skin: BoundSkin | None, count: int) -> list[Any]:
    """Where each root sits on its skin, and by which triangles it turns."""
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


def _with_guides(shot: Shot, plan: LevelPlan, own: Sequence[str]) -> list[str]:
    """The texts of those that follow guides, with what these depend on."""
    result, guided = list(own), plan.of("guided")
    if not len(guided):
        return result
    guides, weights = guide_weights(shot, guided, plan.leading)
    for row, f in enumerate(guided.tolist()):
        some = slice(weights.indptr[row], weights.indptr[row + 1])
        followed = guides[weights.indices[some]].tolist()
        parts = [own[g] for g in followed]
        result[f] = digest(own[f], parts, weights.data[some])
    return result


def _layers(shot: Shot) -> list[Any]:
    """What decides which feather lies over which."""
    return [(p.id, p.region, p.layer, p.stack, p.rank) for p in shot.groom.feathers]
