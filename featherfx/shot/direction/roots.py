"""Follicles that are directed: they turn and shift each root on whatever moves it.

With the root frame (p, R) of the motion and the values of a feather's channels at that time,

    p' = p + puff z,    R' = R Z(fan + fold) Y(ruffle - sleek) X(turn)

z = R e_z the dorsal side, and X, Y, Z turns about the feather's own axes: Y raises the shaft to the
dorsal side, X raises the leading vane, Z turns within the vane. A fan spreads feathers in
proportion to their place along the line on which their roots lie, a fold turns each towards the
mean direction of all, each wing and tail for itself.

What is pressed down over a skin, by an angle a = sleek - ruffle above 0, turns instead by

    DOWN r (1 - exp(-a / (DOWN FLAT))),

r the angle that is between the feather and the skin at rest. So heights over the skin shrink by one
factor, the order of feathers over each other stays, and none is pressed into the skin. Wings and
tails, which stand off it, turn by the angle itself. The leaves of a coat, which take over what
roots do (shot/coat/leaves.py), open by an angle a up to a / (1 + (a / OPEN)^8)^(1/8).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.crossings import strips_of
from featherfx.groom.types import Placement
from featherfx.shot.contact.bodies import SkinBeneath, surfaces_under
from featherfx.shot.direction.channels import Course, acting, courses
from featherfx.shot.motion.limbs import limbs_of
from featherfx.shot.roots import RootFrames, Roots
from featherfx.shot.types import Shot

_NAMES = ("ruffle", "sleek", "turn", "fan", "fold", "puff")
# rad, near what is between feather and skin in the median of the pigeon's coat
FLAT = np.radians(15.0)
# rad, by which channels raise the leaves of a coat at most
OPEN = np.radians(80.0)
# of the way down to the skin, how far a coat goes at most: feathers lie on feathers
DOWN = 0.5
# of a feather's length, places that are not to be pressed into the skin
PRESSED = 0.4, 0.7, 1.0


@dataclass(frozen=True)
class _Pull:
    """A channel and how it acts, each for a value of 1.

    shift: (F,) of a root along z. axes: (F, 3) rad, the turn about x, y and z.
    """

    course: Course
    shift: Array
    axes: Array


@dataclass(frozen=True)
class Directed:
    """Roots of a motion as the channels of a shot turn and shift them. room: (F,) rad, how far each
    feather is over a skin, inf where it is over none. on_leaf: (F,) feathers of a coat."""

    motion: Roots
    pulls: tuple[_Pull, ...]
    room: Array
    on_leaf: Flags

    def frames(self, time: float) -> RootFrames:
        """Return where the roots are at a time, s since the first frame."""
        positions, rotations = self.motion.frames(time)
        lift = sum(each.course.of_each(time) * each.shift for each in self.pulls)
        from scipy.spatial.transform import Rotation  # heavy, and only for this

        axes = self.turns(time)
        up = (axes[:, 1] < 0.0) & self.on_leaf
        axes[up, 1] /= (1.0 + (axes[up, 1] / OPEN) ** 8) ** 0.125
        down = (axes[:, 1] > 0.0) & np.isfinite(self.room)
        axes[down, 1] = -DOWN * self.room[down] * np.expm1(-axes[down, 1] / (DOWN * FLAT))
        own = Rotation.from_euler("ZYX", axes[:, ::-1]).as_matrix()
        positions = positions + np.asarray(lift)[:, None] * rotations[:, :, 2]
        return RootFrames(positions, rotations @ own)

    def turns(self, time: float) -> Array:
        """(F, 3) rad, turns about x, y and z that channels ask for at a time."""
        return np.array(sum(each.course.of_each(time)[:, None] * each.axes for each in self.pulls))


def direct_roots(shot: Shot, motion: Roots) -> Roots:
    """The motion with the channels of a shot that act on roots; itself where there are none."""
    found = courses(shot, _NAMES)
    if not found:
        return motion
    limbs = limbs_of(shot.groom)
    pulls = tuple(_pull(shot.groom.feathers, limbs, each) for each in found)
    on_leaf = np.array([each.leaf is not None for each in shot.groom.feathers])
    return Directed(motion, pulls, _room(shot, found), on_leaf)


def depend_on_channels(shot: Shot, motion: Roots) -> list[Any]:
    """List the channels of every feather of a shot."""
    return [acts or None for acts in acting(shot)]


def _room(shot: Shot, found: Sequence[Course]) -> Array:
    """(F,) rad, angle between each feather and the skin beneath it at rest, at least 0; inf where
    nothing is pressed down, there is no skin, or a limb stands off it."""
    room = np.full(len(shot.groom.feathers), np.inf)
    sides = {"ruffle": -1.0, "sleek": 1.0}
    presses = any((sides.get(c.channel.name, 0.0) * c.curve.values > 0.0).any() for c in found)
    if shot.skin is None or not presses:
        return room
    strips = strips_of(shot.groom.feathers)
    length = np.linalg.norm(strips.shaft, axis=1)
    for surface, own in surfaces_under(shot.skin, np.arange(len(room))):
        for part in PRESSED:
            beneath = SkinBeneath(surface, strips.root[own] + part * strips.shaft[own])
            angle = np.arctan2(np.maximum(beneath.height, 0.0), part * length[own])
            room[own] = np.minimum(room[own], angle)
    return np.where([each.turning is None for each in shot.groom.feathers], room, np.inf)


def _pull(placements: Sequence[Placement], limbs: Indices, course: Course) -> _Pull:
    count = len(placements)
    shift, axes = np.zeros(count), np.zeros((count, 3))
    match course.channel.name:
        case "puff":
            shift[:] = 1.0
        case "ruffle":
            axes[:, 1] = -np.pi / 180.0
        case "sleek":
            axes[:, 1] = np.pi / 180.0
        case "turn":
            sides = np.array([-1.0 if each.mirrored else 1.0 for each in placements])
            axes[:, 0] = np.radians(sides)
        case "fan":
            for own in _of_each_limb(limbs, course):
                axes[:, 2] += np.radians(_spread(placements, own > 0.0))
        case "fold":
            for own in _of_each_limb(limbs, course):
                # (F,) rad, turn about z that brings each shaft nearest to the mean direction
                frames = np.array([each.rotation for each in placements])
                mean = own @ frames[:, :, 0]
                found = np.arctan2(frames[:, :, 1] @ mean, frames[:, :, 0] @ mean)
                axes[:, 2] += np.where(own > 0.0, found, 0.0)
    return _Pull(course, shift, axes)


def _of_each_limb(limbs: Indices, course: Course) -> Iterator[Array]:
    """(F,) weights of a course on each wing, tail or crest, and on the coat, without the others."""
    for limb in np.unique(limbs[course.weights > 0.0]):
        yield np.where(limbs == limb, course.weights, 0.0)


def _spread(placements: Sequence[Placement], members: Flags) -> Array:
    """(F,) share of a fan's angle that turns each feather about its z: half of it, either way, at
    the ends of the line along which roots lie most."""
    found = np.zeros(len(placements))
    if members.sum() < 2:
        return found
    places = np.array([each.position for each in placements])[members]
    frames = np.array([each.rotation for each in placements])[members]
    centred = places - places.mean(axis=0)
    line = np.linalg.svd(centred, full_matrices=False)[2][0]
    along = centred @ line
    middle, half = 0.5 * (along.max() + along.min()), 0.5 * np.ptp(along)
    outwards = np.sign(frames[:, :, 1] @ line)
    found[members] = 0.5 * outwards * (along - middle) / max(half, 1e-12)
    return found
