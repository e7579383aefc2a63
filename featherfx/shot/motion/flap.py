"""Poses of a groom whose wings beat (beat.py), and of wings, tails and crests that fold.

They open and close by turns of their joints about their hinges over time.

Beats that are fitted to a groom: how far its wings fold.

A span ratio is met by the folds of elbow and wrist. What was found is remembered by groom.

Fit of a motion that was set on a pigeon to another groom: how fast and how far it goes.

Wings beat as often as Pennycuick's formula tells (1996, Journal of Experimental Biology 199:
1613-1618), of body mass m, span b and area S of the wings, with gravity and air the same:

    f ~ m^(3/8) b^(-23/24) S^(-1/3)

Of birds in proportion that is f ~ length^(-1/2), the rate at which bodies of all sizes fall and
swing alike. Masses go as the volume of the skin; where there is none, a bird is in proportion to
its wings, and wings that a groom lacks are to its body. A skin that is open is none.
"""

from __future__ import annotations

import fnmatch
import math
import warnings
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple
from weakref import ReferenceType, ref

import numpy as np

from featherfx.algebra.interpolation import eased
from featherfx.algebra.types import Array
from featherfx.algebra.vectors import dots, from_rotation_vector
from featherfx.errors import InputWarning, Problem
from featherfx.groom.keys.preset import Clock
from featherfx.groom.types import Groom, Placement
from featherfx.shot.motion.beat import BEAT_SAMPLES, Flap, Wings, track_of
from featherfx.shot.motion.joints import (
    JointPoses,
    JointRoots,
    MissingJointError,
    PosesOverTime,
    Skeleton,
    joint_roots,
    of_wings,
    opened_poses,
    skeleton_of,
    still_poses,
)
from featherfx.shot.roots import RootFrames
from featherfx.shot.types import Motion, Shot

# feathers, their roots, and (3,) m of the shoulder
_Wing = tuple[Sequence[Placement], JointRoots, Array]
_MAX_BEND = math.radians(150.0)  # of an elbow or wrist without a hinge
_BISECTIONS = 24  # of a factor of folds
# fits that are remembered: grooms, what their beats are asked for, and beats
_KNOWN = deque[tuple["ReferenceType[Groom]", str, tuple[Flap, Wings]]](maxlen=16)


def fitted_beat(
    values: Mapping[str, Any], groom: Groom, skeleton: Skeleton, source: str
) -> tuple[Flap, Wings]:
    """Make the beat that values of a motion describe, fitted to the wings of a groom. source: for
    messages."""
    flap = Flap.read(values)
    asked = repr(sorted((k, v) for k, v in values.items() if k not in ("heave", "pitch")))
    for known, key, (fitted, wings) in tuple(_KNOWN):
        if known() is groom and key == asked:
            return replace(fitted, numbers=flap.numbers), wings
    wings = Wings.find(groom, skeleton)
    if values["span_ratio"] is not None:
        times, ratios = track_of(values["span_ratio"])
        fit = BeatFit(flap, wings, groom, skeleton, source)
        flap = replace(flap, fold_factors=(times, [fit.factor(each) for each in ratios]))
    _KNOWN.append((ref(groom), asked, (flap, wings)))
    return flap, wings


@dataclass(frozen=True)
class BeatFit:
    """A beat on the wings of a groom. source: for messages."""

    flap: Flap
    wings: Wings
    groom: Groom
    skeleton: Skeleton
    source: str

    def factor(self, ratio: float) -> float:
        """Return the factor of the folds that gives a span ratio; where wings do not fold so far,
        the largest, and warn."""
        phases = [k / BEAT_SAMPLES for k in range(BEAT_SAMPLES)]
        farthest = [
            max(abs(math.radians(self.flap.curves[joint.role](phase))) for phase in phases)
            / (float(np.linalg.norm(self.wings.hinges.get(number, 0.0))) or _MAX_BEND)
            for number, joint in enumerate(self.groom.joints, 1)
            if joint.side and joint.role in ("elbow", "wrist")
        ]
        high = 1.0 / max(farthest) if any(farthest) else 0.0
        if self._ratio(high) > ratio:
            least = f"{math.ceil(100.0 * self._ratio(high)) / 100.0:g}"
            message = f"motion.span_ratio: {ratio:g} is less than these wings reach, folded as far"
            message += f" as they go; {least} is taken. Give as much, or more of elbow and wrist"
            warnings.warn(f"{self.source}: {message}", InputWarning, stacklevel=2)
            return high
        low = 0.0
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._ratio(middle) > ratio else (low, middle)
        return high

    def _ratio(self, factor: float) -> float:
        """Reach in the middle of the upstroke over that in the middle of the downstroke."""
        down, up = (self._reach(phase, factor) for phase in (0.25, 0.75))
        return up / down

    def _reach(self, phase: float, factor: float) -> float:
        flap = replace(self.flap, fold_factors=((0.0,), (factor,)))
        feathers, roots, shoulder = self._whole
        frames = self._posed(flap, roots, phase, 0.0)
        lengths = np.array([each.kind.length for each in feathers])
        away = frames.positions + lengths[:, None] * frames.rotations[:, :, 0] - shoulder
        return float(np.linalg.norm(away[:, 1:], axis=1).max(initial=1e-12))

    def _posed(self, flap: Flap, roots: JointRoots, phase: float, time: float) -> RootFrames:
        """Roots of opened wings at a phase of a beat."""
        beat = self.wings.poses(flap, phase, time, eased(*flap.fold_factors, time))
        from featherfx.shot.motion.act import PoseComposer  # only for wings that fold

        pose = PoseComposer.of(self.skeleton)(opened_poses(self.groom), beat)
        return replace(roots, poses=lambda _: pose).frames(0.0)

    @cached_property
    def _whole(self) -> _Wing:
        """Feathers of one wing, their roots, and (3,) m of its shoulder."""
        joints, below = self.groom.joints, self.skeleton.below
        first = next(k for k, each in enumerate(joints, 1) if each.role == "shoulder" and each.side)
        borne = {joints[k - 1].name for k in below(first)}
        own = tuple(each for each in self.groom.feathers if each.joint in borne)
        still = still_poses(len(self.skeleton.names))
        roots = joint_roots(replace(self.groom, feathers=own), self.skeleton, lambda _: still)
        return own, roots, np.asarray(joints[first - 1].position)


def flapping(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of a groom's joints that beat.

    A joint in the middle (side 0) has no wing to move and is driven as a body, as the groom itself
    is. Raises MissingJointError where the groom has no shoulder on either side. Wings that do not
    reach a span ratio come as near as they do, with a warning.
    """
    groom, source = shot.groom, str(shot.source)
    if not any(joint.role == "shoulder" and joint.side for joint in groom.joints):
        message = 'a flap needs a joint with role = "shoulder" and side = 1 or -1 in the groom'
        raise MissingJointError(Problem(source, "motion.kind", message))
    flap, wings = fitted_beat(motion.values, groom, skeleton, source)
    weight = float(np.linalg.norm(shot.gravity))
    up = -shot.gravity / weight if weight else np.zeros(3)
    shoulders = [each.position for each in groom.joints if each.role == "shoulder" and each.side]
    middle = np.mean(shoulders, axis=0) * (1.0, 0.0, 1.0) / motion.clock.size

    def poses(time: float) -> JointPoses:
        found = wings.poses(flap, flap.phase(time), time, eased(*flap.fold_factors, time))
        height, pitch = flap.heave(time, weight)
        turn = from_rotation_vector(np.array((0.0, -pitch, 0.0)))
        found.displacements[0] = height * up + middle - turn @ middle
        found.rotations[0] = turn
        return found

    return poses


def folded(motion: Motion, shot: Shot, _skeleton: Skeleton) -> PosesOverTime:
    """Poses of joints that fold, as a shot asks for it."""
    return folding(shot.groom, motion.values, str(shot.source))


def folding(groom: Groom, values: Mapping[str, Any], source: str) -> PosesOverTime:
    """Poses of the joints that fold. values: of the motion. source: of the shot, for messages.

    Raises MissingJointError where none of the joints meant folds.
    """
    pattern, keys = values["joints"], values["folds"]
    hinged = [
        (number, joint)
        for number, joint in enumerate(groom.joints, 1)
        if joint.hinge is not None and fnmatch.fnmatchcase(joint.name, pattern)
    ]
    if not hinged:
        known = ", ".join(joint.name for joint in groom.joints if joint.hinge is not None)
        message = f"'{pattern}' is no joint that folds. Those of wings, tails and crests do"
        raise MissingJointError(
            Problem(source, "motion.joints", f"{message}: {known or 'there are none'}")
        )
    times, folds = ([key[name] for key in keys] for name in ("time", "fold"))

    def poses(time: float) -> JointPoses:
        found = still_poses(len(groom.joints) + 1)
        fold = eased(times, folds, time)
        for number, joint in hinged:
            found.folds[number], found.aims[number] = fold - joint.fold, 1.0
        return found

    return poses


class Build(NamedTuple):
    """volume: m^3, of the body's skin. span: m, from tip to tip of open wings. area: m^2, of their
    outline from above, with the body between them. 0 where a groom does not tell."""

    volume: float
    span: float
    area: float


# of a surface's area, seen from anywhere, that may be a hole of what encloses a body
_OPEN = 0.05
# of samples/first_bird, on which motions were set, as its preset was then
PIGEON = Build(1.53e-3, 0.847, 0.1006)


def fitted(clock: Clock, groom: Groom) -> Clock:
    """A clock whose tempo and size are as its fit asks for a groom."""
    if clock.fit == "none":
        return clock
    build = build_of(groom)
    size, beat = size_of(build), beat_of(build)
    tempo = beat if clock.fit == "beat" else size**-0.5
    return replace(clock, tempo=clock.tempo * tempo, size=clock.size * size, fit="none")


def size_of(build: Build) -> float:
    """Return how many times as long as a pigeon a body is."""
    if build.volume > 0.0:
        return float(np.cbrt(build.volume / PIGEON.volume))
    return build.span / PIGEON.span if build.span > 0.0 else 1.0


def beat_of(build: Build) -> float:
    """Return how many times as often as a pigeon's wings beat."""
    size = size_of(build)
    if build.span == 0.0:
        return size**-0.5
    mass, span, area = size**3, build.span / PIGEON.span, build.area / PIGEON.area
    return float(mass ** (3 / 8) * span ** (-23 / 24) * area ** (-1 / 3))


def build_of(groom: Groom) -> Build:
    """Measure a groom's skin, and its wings, opened."""
    volume = 0.0 if groom.skin is None else _volume(groom.skin)
    wings = _opened(groom)
    if wings is None:
        return Build(volume, 0.0, 0.0)
    from scipy.spatial import ConvexHull  # heavy, and only for this

    # in the plane a hull's volume is its area
    return Build(volume, float(np.ptp(wings[:, 1])), float(ConvexHull(wings).volume))


def _volume(corners: Array) -> float:
    """m^3 within triangles (T, 3, 3); 0 where they do not close, but for holes."""
    first, second, third = np.moveaxis(corners - corners.mean(axis=(0, 1)), 1, 0)
    normals = np.cross(second - first, third - first)
    whole = float(np.linalg.norm(normals, axis=1).sum())
    if float(np.linalg.norm(normals.sum(axis=0))) > _OPEN * whole:
        return 0.0
    return abs(float(dots(first, np.cross(second, third)).sum())) / 6.0


def _opened(groom: Groom) -> Array | None:
    """(P, 2) m, from above: ends of the feathers of both wings, opened; of one wing, and its mirror
    image. None where there are none that open."""
    own = of_wings(groom)
    folds = {joint.name for joint in groom.joints if joint.hinge is not None and joint.side}
    if not own.any() or not folds:
        return None
    open_ = {"joints": "*", "folds": [{"time": 0.0, "fold": 0.0}]}
    poses = folding(groom, open_, str(groom.source))
    roots = joint_roots(groom, skeleton_of(groom), poses).frames(0.0)
    lengths = np.array([each.kind.length for each in groom.feathers])[:, None]
    tips = roots.positions + lengths * roots.rotations[:, :, 0]
    ends = np.vstack([roots.positions[own], tips[own]])[:, :2]
    return np.vstack([ends, ends * (1.0, -1.0)])
