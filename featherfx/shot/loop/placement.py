"""Placement of the feathers of a shot: laid over each other and bound to their skin."""

from __future__ import annotations

import warnings
from dataclasses import replace
from itertools import compress

from featherfx.errors import InputWarning
from featherfx.groom.coincident_feathers import refuse_crowds
from featherfx.groom.types import Groom
from featherfx.packages import load_name
from featherfx.phases import phase
from featherfx.shot.patterns import may_touch
from featherfx.shot.types import Shot


def lay_out(groom: Groom) -> Groom:
    """The groom with the feathers of its regions laid, where it asks for that; see leaves.py."""
    if groom.layout is None:
        return groom
    if groom.skin is None:
        told = "[layout] lays feathers of regions over each other, and there are no regions"
        warnings.warn(f"{groom.source}: {told}. Leave it out", InputWarning, stacklevel=2)
        return groom
    refuse_crowds(groom.feathers, str(groom.source), "layout", "or leave [layout] out")
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
    _refuse_crowds(replace(shot, groom=groom))
    skin = shot.surfaces.bind(groom) if shot.surfaces is not None else shot.skin
    if skin is not None:
        refuse_crowds(groom.feathers, str(shot.source), "skin", "since these shelter each other")
    exposure = None
    if skin is not None:
        exposure = load_name("loads.shelter:lying_exposures")(groom.feathers, skin)
    return replace(shot, groom=groom, skin=skin, surfaces=None, exposure=exposure)


def _refuse_crowds(shot: Shot) -> None:
    """Raise InputError where too many feathers that touch stand at one place."""
    if shot.contact is not None:
        chosen = compress(shot.groom.feathers, may_touch(shot, shot.contact))
        refuse_crowds(
            list(chosen), str(shot.source), "contact.regions", "or name the regions that matter"
        )
