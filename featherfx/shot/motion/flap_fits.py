"""Beats that are fitted to a groom: how far its wings fold, and how low they go beside its body.

A span ratio is met by the folds of elbow and wrist. The bottom of a stroke is where inner feathers
would enter the body at rest, if that is higher than the amplitude has it: birds differ in how broad
they are below their shoulders.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from featherfx.algebra.interpolation import eased
from featherfx.algebra.types import Array
from featherfx.algebra.vectors import dots, face_products, unit
from featherfx.errors import InputWarning
from featherfx.groom.skin.field import search_tree
from featherfx.groom.types import Groom, Placement
from featherfx.shot.motion.act import PoseComposer
from featherfx.shot.motion.beat import BEAT_SAMPLES, Flap, Track, Wings
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
# phases about the bottom of a stroke that are looked at, and bisections of where it is
_LOW_PHASES, _LOW_BISECTIONS = (0.36, 0.43, 0.5, 0.57, 0.64), 6
# places on a feather, over its length and its width, that keep off the body
_PLACES = np.array([(x, y, 0.0) for x in (0.4, 0.7, 1.0) for y in (-0.5, 0.0, 0.5)])
# of the body's size, by which they do, so that curved ones do too; by eye
_CLEARANCE = 0.012
_NEAR = 30.0  # times that, within which faces are looked for
# cosine of the angle at which a way to the nearest face leaves that face, so that it counts
_FACING = 0.5


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

    def raised(self) -> Track:
        """Return times (s) and rad, by which strokes end higher than their amplitude has them; from
        a degree on, warn."""
        numbers = self.flap.numbers
        times = sorted({*numbers["stroke_amplitude"][0], *numbers["stroke_plane"][0]})
        found = [self._raise(time) for time in times]
        if (most := math.degrees(max(found))) >= 1.0:
            message = f"motion.stroke_amplitude: the bottom of strokes is raised by {most:.2g}"
            message += " degrees: inner feathers would enter the body. Give a smaller amplitude"
            warnings.warn(f"{self.source}: {message}", InputWarning, stacklevel=2)
        return times, found

    def _raise(self, time: float) -> float:
        """Return rad, by which the bottom of a stroke that enters the body is raised, so that inner
        feathers keep off it, or come as near as in the middle of the stroke."""
        wanted = min(self._gap((0.25,), time, 0.0), self._body[3])
        if self._gap(_LOW_PHASES, time, 0.0) >= min(wanted, 0.0):
            return 0.0
        low, high = 0.0, math.radians(eased(*self.flap.numbers["stroke_amplitude"], time))
        for _ in range(_LOW_BISECTIONS):
            middle = 0.5 * (low + high)
            is_clear = self._gap(_LOW_PHASES, time, middle) >= wanted
            low, high = (low, middle) if is_clear else (middle, high)
        return high

    def _gap(self, phases: Sequence[float], time: float, raised: float) -> float:
        """m, between the body and feathers of arm and forearm, if it is less than they keep off."""
        flap = replace(self.flap, raised=((0.0,), (raised,)))
        feathers, roots, _ = self._inner
        size = np.array([(each.kind.length, each.kind.width, 1.0) for each in feathers]).reshape(
            -1, 3
        )
        tree, centres, normals, clearance = self._body
        nearest = clearance
        for phase in phases:
            frames = self._posed(flap, roots, phase, time)
            own = frames.rotations @ (size[:, :, None] * _PLACES.T)
            places = (frames.positions[:, :, None] + own).swapaxes(1, 2).reshape(-1, 3)
            away, found = tree.query(places, distance_upper_bound=_NEAR * clearance)
            places, found = places[away < np.inf], found[away < np.inf]
            height = dots(places - centres[found], normals[found])
            facing = np.abs(height) > _FACING * away[away < np.inf]
            nearest = min(nearest, float(height[facing].min(initial=clearance)))
        return nearest

    @cached_property
    def _body(self) -> tuple[Any, Array, Array, float]:
        """Search tree of the faces of the skin at rest, their centres and normals, (T, 3), and how
        far (m) feathers keep off it."""
        assert self.groom.skin is not None
        centres = self.groom.skin.mean(axis=1)
        size = float(np.linalg.norm(np.ptp(centres, axis=0)))
        return (
            search_tree(centres),
            centres,
            unit(face_products(self.groom.skin)),
            _CLEARANCE * size,
        )

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
        return self._wing("shoulder", "elbow", "wrist")

    @cached_property
    def _inner(self) -> _Wing:
        return self._wing("shoulder", "elbow")

    def _wing(self, *roles: str) -> _Wing:
        """Feathers of one wing on joints of some roles, their roots, and (3,) m of its shoulder."""
        joints, below = self.groom.joints, self.skeleton.below
        first = next(k for k, each in enumerate(joints, 1) if each.role == "shoulder" and each.side)
        borne = {joints[k - 1].name for k in below(first) if joints[k - 1].role in roles}
        own = tuple(each for each in self.groom.feathers if each.joint in borne)
        still = still_poses(len(self.skeleton.names))
        roots = joint_roots(replace(self.groom, feathers=own), self.skeleton, lambda _: still)
        return own, roots, np.asarray(joints[first - 1].position)
