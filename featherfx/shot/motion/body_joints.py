"""Joints of a body that acts move and that no feather hangs on: neck, head, legs and feet.

They stand in the groom beside its own ones where `[motion.joints]` names what they drive, at the
pivots of that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from featherfx.groom.types import Groom, Joint

if TYPE_CHECKING:
    from featherfx.shot.sources import MovingSurface

NECK, HEAD = "neck", "head"
TARSI = "right_tarsus", "left_tarsus"
# by their parents
BODY_JOINTS: Mapping[str, str] = {
    NECK: "",
    HEAD: NECK,
    "right_leg": "",
    "left_leg": "",
    "right_tarsus": "right_leg",
    "left_tarsus": "left_leg",
    "right_foot": "right_tarsus",
    "left_foot": "left_tarsus",
}


def with_body_joints(
    groom: Groom, driven: Mapping[str, str], surfaces: Sequence[MovingSurface]
) -> Groom:
    """A groom with those joints of bodies that drive joints of surfaces. driven: names of these by
    theirs."""
    known = {joint.name for joint in groom.joints}
    added: list[Joint] = []
    for name in BODY_JOINTS:
        for surface in surfaces:
            tree = surface.joint_tree
            if name in driven and name not in known and tree is not None:
                for place in tree.find(driven[name]):
                    known.add(name)
                    parent = BODY_JOINTS[name]
                    while parent and parent not in known:
                        parent = BODY_JOINTS[parent]
                    pivot = surface.joint_matrices(None)[place][3, :3]
                    added.append(Joint(name, pivot, parent))
    return replace(groom, joints=(*groom.joints, *added)) if added else groom
