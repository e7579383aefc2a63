"""Beats that are fitted to a groom: how far its wings fold, and how far they go beside its body.

A span ratio is met by the folds of elbow and wrist. A stroke ends where inner feathers would enter
the body at rest, below it or behind its back, if that is before the amplitude has it: birds differ
in how broad they are about their shoulders. What was found is remembered by groom.
"""

from __future__ import annotations

import math
import warnings
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any
from weakref import ReferenceType, ref

import numpy as np

from featherfx.algebra.interpolation import eased
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots, face_products, unit
from featherfx.errors import InputWarning
from featherfx.groom.skin.field import search_tree
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
_ENDS = 0.5, 0.0  # phases of a stroke's bottom and top
# phases about an end that are looked at, and bisections of where it is
_PHASES, _END_BISECTIONS = tuple(0.03 * k for k in range(-4, 5)), 6
# s, about a beat: knots that are farther apart have others between them, up to so many parts
_APART, _PARTS = 0.12, 4
# places on a feather, over its length and its width, by which those near the body are found
_PLACES = np.array([(x, y) for x in (0.4, 0.7, 1.0) for y in (-0.6, 0.0, 0.6)])
# rows and columns of their shapes, and the first row that keeps off the body
_ROWS, _COLUMNS, _FIRST = 8, 2, 3
# of the body's size, by which they do, as they move on between the phases; by eye
_CLEARANCE = 0.0036
_ROUGHLY = 4.0  # times that, within which feathers are near
_NEAR = 30.0  # times that, within which faces are looked for
# cosine of the angle at which a way to the nearest face leaves that face, so that it counts
_FACING = 0.5
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
    if groom.skin is not None:
        flap = BeatFit(flap, wings, groom, skeleton, source).kept_off()
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

    def kept_off(self) -> Flap:
        """The beat whose strokes end before inner feathers would enter the body; where that is a
        degree or more before its amplitude has it, warn."""
        numbers = self.flap.numbers
        knots = sorted({*numbers["stroke_amplitude"][0], *numbers["stroke_plane"][0]})
        times = knots[:1]
        for a, b in pairwise(knots):
            parts = min(math.ceil((b - a) / _APART), _PARTS)
            times += np.linspace(a, b, parts + 1)[1:].tolist()
        raised, lowered = ([self._shortened(end, time) for time in times] for end in _ENDS)
        told = [
            f"{what} by {math.degrees(max(found)):.2g} degrees"
            for what, found in (("raised at the bottom", raised), ("lowered at the top", lowered))
            if math.degrees(max(found)) >= 1.0
        ]
        if told:
            message = f"motion.stroke_amplitude: strokes are {' and '.join(told)}: inner feathers"
            message += " would enter the body. Give a smaller amplitude"
            warnings.warn(f"{self.source}: {message}", InputWarning, stacklevel=2)
        return replace(self.flap, raised=(times, raised), lowered=(times, lowered))

    def _shortened(self, end: float, time: float) -> float:
        """Return rad, by which an end of a stroke that enters the body is nearer to its middle, so
        that inner feathers keep off it, or come as near as there. end: phase."""
        phases, way = [end + each for each in _PHASES], np.equal(_ENDS, end)
        clearance, everyone = self._body[3], np.arange(len(self._inner[0]))
        rough = self._gaps(everyone, self._places, phases, time, 0.0 * way)
        near = np.flatnonzero(rough < _ROUGHLY * clearance)
        if not len(near):
            return 0.0
        shapes = self._shapes(near)

        def gap(phases: Sequence[float], rad: float) -> float:
            found = self._gaps(near, shapes, phases, time, rad * way)
            return min(float(found.min()), clearance)

        wanted = gap((0.25,), 0.0)
        if gap(phases, 0.0) >= wanted:
            return 0.0
        low, high = 0.0, 0.5 * math.radians(eased(*self.flap.numbers["stroke_amplitude"], time))
        if gap(phases, high) < wanted:
            return 0.0
        for _ in range(_END_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if gap(phases, middle) >= wanted else (middle, high)
        return high

    def _gaps(
        self, members: Indices, places: Array, phases: Sequence[float], time: float, ends: Array
    ) -> Array:
        """(M,) m, between the body and inner feathers, if it is less than they are near. places:
        (M, 3, P) m, on each of members (M,). ends: (2,) rad, by which the stroke is raised and
        lowered."""
        raised, lowered = (((0.0,), (float(each),)) for each in ends)
        flap = replace(self.flap, raised=raised, lowered=lowered)
        tree, centres, normals, clearance = self._body
        far = _ROUGHLY * clearance
        low, high = tree.mins - far, tree.maxes + far
        nearest = np.full(len(members), far)
        for phase in phases:
            frames = self._posed(flap, self._inner[1], phase, time)
            own = frames.rotations[members] @ places
            at = (frames.positions[members, :, None] + own).swapaxes(1, 2)
            which, there = np.nonzero(((low < at) & (at < high)).all(axis=2))
            away, found = tree.query(at[which, there], distance_upper_bound=_NEAR * far)
            is_near = away < np.inf
            which, there, found = which[is_near], there[is_near], found[is_near]
            height = dots(at[which, there] - centres[found], normals[found])
            facing = np.abs(height) > _FACING * away[is_near]
            np.minimum.at(nearest, which[facing], height[facing])
        return nearest

    @cached_property
    def _places(self) -> Array:
        """(F, 3, P) m, places on flat inner feathers, in their own frames."""
        size = np.array([(each.kind.length, each.kind.width) for each in self._inner[0]])
        flat = size.reshape(-1, 2, 1) * _PLACES.T
        return np.concatenate([flat, np.zeros_like(flat[:, :1])], axis=1)

    def _shapes(self, members: Indices) -> Array:
        """(M, 3, P) m, places on the outer part of inner feathers (M,), as they are shaped."""
        from featherfx.feather.shapes import build_plane_feathers  # only where one is near

        built = build_plane_feathers([self._inner[0][k] for k in members], _ROWS, _COLUMNS)
        nodes = [each.rest.nodes[_FIRST:].reshape(-1, 3).T for each in built]
        return np.array(nodes).reshape(len(members), 3, -1)

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
