"""Inputs that the motion of each feather depends on, as one short text: equal texts, equal motion.

A feather that is simulated depends on its shape and materials, on its root, on what pulls or
shelters it, on its levels of detail, and on what all have in common: wind, motion, quality, frame
rate. One that follows guides depends on theirs as well, and one that pushes others on all of its
island (islands.py).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from featherfx.feather.placed_feathers import build_feathers
from featherfx.files.content import digest, digests, members
from featherfx.groom.types import Placement
from featherfx.mechanics.batch import is_guarded
from featherfx.packages import brought
from featherfx.shot.loads import exposures
from featherfx.shot.motion.motion import prepare_cuts, uncut_motion
from featherfx.shot.options import ShotOptions, resolve_options
from featherfx.shot.patterns import last_fitting
from featherfx.shot.roots import Roots
from featherfx.shot.types import Shot

if TYPE_CHECKING:
    from featherfx.shot.skin import BoundSkin


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
