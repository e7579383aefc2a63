"""What the motion of each feather depends on, as one short text: equal texts, equal motion.

A feather that is simulated depends on its shape and materials, on its root, on what pulls or
shelters it, on its levels of detail, and on what all have in common: wind, motion, quality, frame
rate. One that follows guides depends on theirs as well, one that pushes others on all of its island
(islands.py), and one that is laid over others on these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from featherfx.algebra.types import Indices
from featherfx.feather.shapes import build_feathers
from featherfx.files.content import digest, digests, members
from featherfx.groom.types import Placement
from featherfx.mechanics.batch import is_guarded, may_slip
from featherfx.shot.detail.guides import guide_weights
from featherfx.shot.detail.levels import LevelPlan, level_plan
from featherfx.shot.direction.channels import acting
from featherfx.shot.direction.roots import shares_of
from featherfx.shot.direction.targets import targets_of
from featherfx.shot.islands import ALONE, pushing_islands
from featherfx.shot.layers.layers import Layers
from featherfx.shot.layers.types import Laid
from featherfx.shot.loads.wind import exposures
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.motion.roots import Roots
from featherfx.shot.motion.skin import BoundSkin
from featherfx.shot.patterns import last_fitting
from featherfx.shot.types import Shot

# of a shot, what does not count, and what counts for each feather by itself
_NOT_COMMON = {
    "name", "groom", "last_frame", "grips", "forces", "details", "shelters", "exposure",
    "level_of_detail", "skin", "surfaces", "inputs", "colliders", "contact", "wets", "detachments",
    "channels", "targets",
}  # fmt: skip
# of a feather, what only the output has, or contact asks for
_NOT_MOVING = {"id", "region", "layer", "stack", "rank", "grown", "skin", "skin_uv"}


def motion_dependences(shot: Shot) -> list[str]:
    """Of every feather of a shot that is placed on its skin, in the groom's order: what its motion
    depends on before it is laid over others. Raises InputError for shapes that cannot be built,
    and for levels that cannot be."""
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    motion = root_motion(shot)
    plan = level_plan(shot, drawn, motion)
    common = digest(_common(shot))
    texts = digests([common, *each] for each in _each(shot, plan, motion))
    if shot.contact is not None:
        texts = _with_islands(shot, pushing_islands(shot, drawn, motion, plan), texts)
    return _with_guides(shot, plan, texts)


def dependences(shot: Shot, laid: Laid | None = None, own: Sequence[str] = ()) -> list[str]:
    """The same of what is shown of each feather.

    laid: who lies over whom of some feathers, where that is known; texts of others that are laid
    over any are then of no use. own: what motion_dependences gives, where it is known. Raises what
    that raises.
    """
    texts = own or motion_dependences(shot)
    if shot.layers is None:
        return list(texts)
    if laid is None:
        drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
        laid = Layers(shot, drawn, np.arange(len(drawn)), 1).laid
    return _with_those_beneath(shot, laid, texts)


def _with_islands(shot: Shot, islands: Indices, own: Sequence[str]) -> list[str]:
    """The texts with what all feathers of an island depend on."""
    slips = any(may_slip(each.kind) for each in shot.groom.feathers)
    placements, result = shot.groom.feathers, list(own)
    for number in np.unique(islands[islands != ALONE]).tolist():
        members = np.flatnonzero(islands == number).tolist()
        some = [placements[f] for f in members]
        labels = [(each.id, each.region, each.kind.name, each.layer, each.stack) for each in some]
        # places in the order of the layout, as far as these feathers go
        order = np.unique([each.rank for each in some], return_inverse=True)[1]
        laid = order, [each.rank < 0 for each in some]
        parts = [own[f] for f in members], labels, *laid
        together = digest(*parts, shot.contact, shot.colliders, slips)
        for f in members:
            result[f] = digest(own[f], together)
    return result


def _with_those_beneath(shot: Shot, laid: Laid, own: Sequence[str]) -> list[str]:
    """The texts with those of the feathers that each is laid over, and these with theirs."""
    stack = laid.stack
    # how far is searched for what lies beneath goes with the thickest
    most = max(each.kind.vane_material.thickness for each in shot.groom.feathers)
    result = list(own)
    for place, f in enumerate(laid.feathers[stack.order].tolist()):
        lower = stack.pairs[stack.first[place] : stack.first[place + 1], 1]
        texts = [result[g] for g in laid.feathers[lower].tolist()]
        result[f] = digest(own[f], shot.layers, most, texts)
    return result


def _common(shot: Shot) -> list[Any]:
    found: list[Any] = [each for each in members(shot) if each[0] not in _NOT_COMMON]
    skin = shot.skin
    surfaces = [] if skin is None else [skin.start, *(part.surface for part in skin.parts)]
    return [*found, shot.groom.joints, surfaces]


def _each(shot: Shot, plan: LevelPlan, motion: Roots) -> list[list[Any]]:
    """What counts for each feather by itself."""
    placements = shot.groom.feathers
    shelter = exposures(shot).tolist()
    roots = _roots(shot.skin, len(placements))
    guarded = _guarded(shot, plan)
    rules = [
        [each[number] if number >= 0 else None for number in last_fitting(each, placements)]
        for each in (shot.wets, shot.detachments)
    ]
    directed, share, brought = acting(shot), shares_of(motion, len(placements)), targets_of(shot)
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
            guarded[f],
            [each[f] for each in rules],
            [directed[f], float(share[f])],
            brought[f],
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


def _guarded(shot: Shot, plan: LevelPlan) -> list[bool]:
    """Whether a feather is computed with the terms of a compression guard, its own or another's of
    its batch."""
    guards = [is_guarded(p.kind, touching=False) for p in shot.groom.feathers]
    with_guard = {own for own, guard in zip(plan.resolutions, guards, strict=True) if guard}
    return [own in with_guard for own in plan.resolutions]


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
    result, guided = list(own), plan.at_level("guided")
    if not len(guided):
        return result
    guides, weights = guide_weights(shot, guided, plan.leading)
    for row, f in enumerate(guided.tolist()):
        some = slice(weights.indptr[row], weights.indptr[row + 1])
        followed = guides[weights.indices[some]].tolist()
        parts = [own[g] for g in followed]
        result[f] = digest(own[f], parts, weights.data[some])
    return result
