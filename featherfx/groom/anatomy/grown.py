"""Feathers and joints of wings, tails and crests."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from featherfx.algebra.vectors import frames_from, parallel
from featherfx.groom.anatomy.fans import crest, tail
from featherfx.groom.anatomy.wing import wing
from featherfx.groom.course import Mirror
from featherfx.groom.keys.problems import Place
from featherfx.groom.presets.library import Library
from featherfx.groom.presets.presets import KindStore
from featherfx.groom.read.drafts import Draft, mirror_of, other_side, with_mirror_images
from featherfx.groom.read.space import Space
from featherfx.groom.types import Joint


def grow_limbs(
    parts: dict[str, Any], store: KindStore, library: Library, space: Space
) -> tuple[tuple[Draft, ...], tuple[tuple[Joint, Place], ...]]:
    """Return feathers and joints of [[wing]], [[tail]] and [[crest]], joints with their tables.

    Problems go to the places of the tables.
    """
    drafts: list[Draft] = []
    joints: list[tuple[Joint, Place]] = []
    taken: dict[str, Place] = {}
    for at, entry in reversed(parts["wing"]):  # those of [bird] come last
        if taken.setdefault(entry["id"], at) is not at:
            other = taken[entry["id"]].key
            at.child("id").fail(f"'{entry['id']}' is taken by {other}. Choose another")
    for at, entry in parts["wing"]:
        if taken[entry["id"]] is not at:
            continue
        with at.problems.collecting():
            if parallel(entry["forward"], entry["up"]):
                at.child("up").refuse("is parallel to forward. Give another vector")
            axes = frames_from(entry["forward"], entry["up"])
            own, bones = wing(entry, at, store, library, axes)
            mirror = mirror_of(entry, space)
            drafts += with_mirror_images(own, at, mirror)
            joints += [(each, at) for each in bones]
            if mirror is not None:
                joints += [(_mirrored(each, mirror), at) for each in bones if other_side(each.name)]
    for name, grow in (("tail", tail), ("crest", crest)):
        for at, entry in parts[name]:
            with at.problems.collecting():
                own, bones = grow(entry, at, store)
                drafts += own
                joints += [(each, at) for each in bones]
    return tuple(drafts), tuple(joints)


def _mirrored(joint: Joint, mirror: Mirror) -> Joint:
    hinge = None if joint.hinge is None else mirror.rotation_vectors(joint.hinge)
    return replace(
        joint,
        name=other_side(joint.name) or joint.name,
        position=mirror.points(np.asarray(joint.position)),
        parent=other_side(joint.parent) or joint.parent,
        side=-joint.side,
        hinge=hinge,
        bone=None if joint.bone is None else mirror.points(joint.bone),
        offset=None if joint.offset is None else mirror.directions(joint.offset),
    )
