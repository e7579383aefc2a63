"""Follicles that are directed: they turn and shift each root on whatever moves it.

With the root frame (p, R) of the motion and the values of a feather's channels at that time,

    p' = p + puff z,    R' = R Z(fan + fold) Y(ruffle - sleek) X(turn)

z = R e_z the dorsal side, and X, Y, Z turns about the feather's own axes: Y raises the shaft to the
dorsal side, X raises the leading vane, Z turns within the vane. A fan spreads feathers in
proportion to their place along the line on which their roots lie, a fold turns each towards the
mean direction of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from featherfx.algebra.types import Array, Flags
from featherfx.groom.types import Placement
from featherfx.shot.direction.channels import Course, courses
from featherfx.shot.motion.roots import RootFrames, Roots
from featherfx.shot.types import Shot

NAMES = ("ruffle", "sleek", "turn", "fan", "fold", "puff")


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
    """Roots of a motion as the channels of a shot turn and shift them."""

    motion: Roots
    pulls: tuple[_Pull, ...]

    def frames(self, time: float) -> RootFrames:
        """Where the roots are at a time, s since the first frame."""
        positions, rotations = self.motion.frames(time)
        values = [each.course.of_each(time) for each in self.pulls]
        lift = sum(value * each.shift for value, each in zip(values, self.pulls, strict=True))
        turn = sum(
            value[:, None] * each.axes for value, each in zip(values, self.pulls, strict=True)
        )
        from scipy.spatial.transform import Rotation  # heavy, and only for this

        own = Rotation.from_euler("ZYX", np.asarray(turn)[:, ::-1]).as_matrix()
        positions = positions + np.asarray(lift)[:, None] * rotations[:, :, 2]
        return RootFrames(positions, rotations @ own)


def directed(shot: Shot, motion: Roots) -> Roots:
    """The motion with the channels of a shot that act on roots; itself where there are none."""
    found = courses(shot, NAMES)
    if not found:
        return motion
    return Directed(motion, tuple(_pull(shot.groom.feathers, each) for each in found))


def _pull(placements: Sequence[Placement], course: Course) -> _Pull:
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
            axes[:, 2] = np.radians(_spread(placements, course.weights > 0.0))
        case "fold":
            axes[:, 2] = _to_mean(placements, course.weights)
    return _Pull(course, shift, axes)


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


def _to_mean(placements: Sequence[Placement], weights: Array) -> Array:
    """(F,) rad, turn about z that brings each shaft nearest to the mean direction."""
    frames = np.array([each.rotation for each in placements])
    mean = weights @ frames[:, :, 0]
    found = np.arctan2(frames[:, :, 1] @ mean, frames[:, :, 0] @ mean)
    return np.where(weights > 0.0, found, 0.0)
