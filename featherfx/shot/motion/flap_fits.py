"""Beats that are fitted to a groom: how far its wings fold.

A span ratio is met by the folds of elbow and wrist. What was found is remembered by groom.
"""

from __future__ import annotations

import math
import warnings
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any
from weakref import ReferenceType, ref

import numpy as np

from featherfx.algebra.interpolation import eased
from featherfx.algebra.types import Array
from featherfx.errors import InputWarning
from featherfx.groom.types import Groom, Placement
from featherfx.shot.motion.act import PoseComposer
from featherfx.shot.motion.beat import BEAT_SAMPLES, Flap, Wings, track_of
from featherfx.shot.motion.joints import (
    JointRoots,
    Skeleton,
    joint_roots,
    opened_poses,
    still_poses,
)
from featherfx.shot.roots import RootFrames

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
