"""Feathers that pass through each other at rest, and that nothing lays over each other."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.errors import InputWarning
from featherfx.feather.crossings import find_intersections, make_patches
from featherfx.feather.types import RACHIS_PART, Feather
from featherfx.groom.types import Placement
from featherfx.shot.frames import place
from featherfx.shot.layers.types import Indices, Stack
from featherfx.shot.patterns import may_touch
from featherfx.shot.types import Shot


def crossed_at_rest(
    placements: Sequence[Placement], drawn: Sequence[Feather], touching: Flags, stack: Stack
) -> Indices:
    """(K, 2) feathers whose vanes pass through each other at rest though both touch, (F,), and of
    which the stack has no order; not those that a layout laid, which says itself what it left."""
    meshes, points = [], []
    for number, (own, feather) in enumerate(zip(placements, drawn, strict=True)):
        surface = feather.surface
        vanes = surface.triangles[surface.part != RACHIS_PART]
        points.append(surface.points(place(feather.rest, own.position, own.rotation)))
        meshes.append((points[-1], vanes, np.zeros(len(vanes), dtype=np.bool_), number))
    found = find_intersections(np.concatenate(points), make_patches(meshes), asked=touching)
    pairs, laid = found.owners[found.vanes > 0], np.array([own.rank >= 0 for own in placements])
    first, second = np.sort(stack.pairs, axis=1).T
    known = np.isin(pairs @ [len(laid), 1], first * len(laid) + second)
    return pairs[touching[pairs].all(axis=1) & ~laid[pairs].all(axis=1) & ~known]


def warn_of_crossed(shot: Shot, drawn: Sequence[Feather], some: Indices, stack: Stack) -> None:
    """Say which of some feathers of a shot stay through each other because nothing tells which is
    over which. drawn: all feathers on the meshes' grid. stack: of those, counted in them."""
    placements = [shot.groom.feathers[f] for f in some]
    if shot.layers is None or all(own.rank >= 0 for own in placements):
        return
    touching = np.array(may_touch(shot, shot.layers.contact))[some]
    pairs = crossed_at_rest(placements, [drawn[f] for f in some], touching, stack)
    if len(pairs):
        one, other = (placements[f].id for f in pairs[0])
        more = f", and so do {len(pairs) - 1} more pairs" if len(pairs) > 1 else ""
        warnings.warn(
            f"layers: feathers '{one}' and '{other}' pass through each other at rest{more}. Nothing"
            " tells which is over which, so they are left crossed in all frames: move or turn one,"
            " or let a [layout] table of the groom lay them",
            InputWarning,
            stacklevel=2,
        )
