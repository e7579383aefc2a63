"""Placement of the feathers of a shot: laid over each other and bound to their skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import compress

import numpy as np

from featherfx.errors import InputError, Problem, warn_input
from featherfx.groom.types import Groom, Placement
from featherfx.limits import CROWD_PAIRS, MAX_NEIGHBOURS
from featherfx.packages import load_name
from featherfx.phases import phase
from featherfx.shot.patterns import last_fitting
from featherfx.shot.types import Shot, may_touch

# side of the cubes that roots are counted in, over the length of the shortest feathers there are
# in them: whatever compares feathers compares those of one cube
_SIDE = 0.5


def lay_out(groom: Groom) -> Groom:
    """The groom with the feathers of its regions laid, where it asks for that; see leaves.py."""
    if groom.layout is None:
        return groom
    if groom.skin is None:
        told = "[layout] lays feathers of regions over each other, and there are no regions"
        warn_input(f"{groom.source}: {told}. Leave it out")
        return groom
    _refuse_crowds(groom.feathers, str(groom.source), "layout", "or leave [layout] out")
    # what has no layout does without compiled code
    from featherfx.feather import leaves

    with phase("reading", silent=True):
        return leaves.lay_out(groom)


def place_feathers(shot: Shot) -> Shot:
    """A shot as it was read, with its feathers laid over each other and bound to its skin.

    Roots that are far from their skin give a warning, and so do feathers that find no room in
    their layout (lay_out). Raises InputError for shapes that cannot be built.
    """
    groom = lay_out(shot.groom)
    _refuse_touching_crowds(replace(shot, groom=groom))
    skin, colliders = shot.skin, shot.colliders
    if shot.surfaces is not None:
        surfaces = shot.surfaces
        if shot.motion.moves_skin:
            move_body = load_name("motion.body:move_body")
            surfaces, colliders = move_body(replace(shot, groom=groom), surfaces)
            load_name("motion.body:warn_of_passage")(shot, surfaces, colliders)
        skin = surfaces.bind(groom)
    exposure, alone = None, skin is None and len(groom.feathers) == 1
    if not alone and min(last_fitting(shot.shelters, groom.feathers), default=0) < 0:
        instead = "or give all a share in [[shelter]], without which they shelter each other"
        _refuse_crowds(groom.feathers, str(shot.source), "groom", instead)
        exposure = load_name("loop.shelter:lying_exposures")(groom.feathers, skin)
    return replace(
        shot, groom=groom, skin=skin, colliders=colliders, surfaces=None, exposure=exposure
    )


def _refuse_touching_crowds(shot: Shot) -> None:
    """Raise InputError where too many feathers that touch stand at one place."""
    if shot.contact is not None:
        chosen = compress(shot.groom.feathers, may_touch(shot, shot.contact))
        _refuse_crowds(
            list(chosen), str(shot.source), "contact.regions", "or name the regions that matter"
        )


def _refuse_crowds(placements: Sequence[Placement], source: str, key: str, instead: str) -> None:
    """Raise InputError where so many feathers stand at one place that comparing them would not end.

    Pairs grow as the square of the number of feathers in each other's place, and with them what
    layouts, contact and shelter take. source, key: of the problem. instead: what helps besides
    placing them apart.
    """
    length = np.array([each.kind.length for each in placements])
    root = np.array([each.position for each in placements]).reshape(-1, 3)
    octave = np.floor(np.log2(length))
    cube = np.floor(root / (_SIDE * 2.0 ** octave[:, None]))
    _, cubes, counts = np.unique(
        np.column_stack([octave, cube]), axis=0, return_inverse=True, return_counts=True
    )
    pairs = int((counts * (counts - 1) // 2).sum())
    if pairs <= max(CROWD_PAIRS, MAX_NEIGHBOURS * len(placements) // 2):
        return
    some = np.flatnonzero(cubes.ravel() == counts.argmax())
    message = (
        f"{len(placements)} feathers make at least {pairs} pairs that stand within half a length of"
        f" each other, more than {CROWD_PAIRS}, or {MAX_NEIGHBOURS} neighbours a feather (beside"
        f" '{placements[some[0]].id}' stand {len(some) - 1}). Place them apart, {instead}"
    )
    raise InputError(Problem(source, key, message))
