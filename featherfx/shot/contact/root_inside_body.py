"""Wings whose motion leads roots into the body: nothing makes room for what is between.

A bird that is groomed with open wings and without `opens` has a folded pose that lies where its
type has it, not on this body.
"""

from __future__ import annotations

import warnings

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputWarning
from featherfx.groom.anatomy.drape import Body
from featherfx.groom.skin.field import search_tree
from featherfx.shot.motion.limbs import of_wings
from featherfx.shot.roots import RootFrames, Roots
from featherfx.shot.types import Shot, may_touch

# depth of a root in the body, over its feather's length, from which on it is told
_DEEP = 0.02
# frames that are looked at, at most
_LOOKS = 24


def warn_of_sunk(shot: Shot, motion: Roots) -> None:
    """Say which roots of wings that touch something a shot's motion leads into the body, deeper
    than they are at rest, and in which frame the deepest is."""
    groom, wings = shot.groom, of_wings(shot.groom)
    if shot.contact is None or groom.skin is None or wings.all():
        return
    some = wings & np.array(may_touch(shot, shot.contact))
    if not some.any():
        return
    body, coat = _body(groom.skin), np.flatnonzero(~wings)
    lengths = np.array([each.kind.length for each in groom.feathers])[some]
    rest = RootFrames(
        np.array([each.position for each in groom.feathers]),
        np.array([each.rotation for each in groom.feathers]),
    )
    usual = np.maximum(0.0, -body.gaps(rest.positions[some]))
    last = shot.last_frame - shot.first_frame
    frames = np.unique(np.linspace(0, last, _LOOKS).round().astype(int)).tolist()
    roots = (motion.frames(k / shot.frames_per_second) for k in frames)
    deep = np.stack([-body.gaps(_at_rest(now, rest, some, coat)) - usual for now in roots])
    found = (deep > _DEEP * lengths).any(axis=0)
    if not found.any():
        return
    frame, worst = np.unravel_index(np.where(found, deep, 0.0).argmax(), deep.shape)
    name = groom.feathers[int(np.flatnonzero(some)[worst])].id
    more = f" and of {int(found.sum()) - 1} more feathers" if found.sum() > 1 else ""
    warnings.warn(
        f"motion: leads the root of feather '{name}'{more} into the body, by"
        f" {1e3 * deep[frame, worst]:.2g} mm at frame {shot.first_frame + frames[frame]}: what"
        " contact finds between is squeezed there, and yields. In the groom, opens = true of"
        " [bird] has wings that lie on the body where they fold",
        InputWarning,
        stacklevel=2,
    )


def _body(corners: Array) -> Body:
    """The skin of a groom, seen from outside."""
    volume = np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return Body(corners if volume > 0.0 else corners[:, ::-1], np.eye(3), np.zeros(3))


def _at_rest(now: RootFrames, rest: RootFrames, some: Flags, coat: Indices) -> Array:
    """(S, 3) m, where some roots (F,) are, carried back to the body at rest, each by that root of
    the coat that it is nearest to."""
    place = now.positions[some]
    near = coat[search_tree(now.positions[coat]).query(place)[1]]
    back = rest.rotations[near] @ now.rotations[near].swapaxes(1, 2)
    away = np.einsum("sij,sj->si", back, place - now.positions[near])
    return np.asarray(rest.positions[near] + away)
