"""The procedural wing beat: joint angles over a beat's phase.

Frame: x forward, y to the left, z up. Phase p runs from 0 to 1 over a beat: 0 is the top of the
stroke, 1/2 its bottom. A beat whose downstroke takes the fraction d of its time t has

    tan(pi (p - 1/4)) = tan(pi (t - d/2)) / tan(pi d/2),

a smooth map of the circle onto itself. Angles are curves over the phase: Fourier series, or
monotone cubics through keys. Positive angles, on either side, turn the left wing by

    shoulder  R_x(elevation) R_z(sweep) R_y(twist)    raise it, lead it back, lower its leading edge
    elbow     folds the forearm forwards
    wrist     folds the hand backwards
    tip       turns the hand over about its length, in the upstroke

about the axes of a body whose trunk rises as a standing pigeon's, from the root of its tail to its
shoulders: on one that rises otherwise axes lean with the trunk. The stroke a of an arm runs in a
plane that leans back by s against that body's transverse plane,

    sin(sweep) = sin(a) sin(s),    tan(elevation) = tan(a) cos(s).

Elbow and wrist turn about their own hinges, where they have any, as those of wings from one table:
in the wing's plane feathers stay over each other. Those of other joints lean from the vertical, so
that a folding wing also flexes downwards. The reach of a wing is how far its farthest tip is from
the line through the shoulder along the body. The span ratio is the reach in the middle of the
upstroke over that in the middle of the downstroke; both folds are scaled to it.

A body heaves under the lift of its wings. Quasi-steady, all of it in the downstroke, as of slow
flight (Tobalske 2007, Journal of Experimental Biology 210: 3135-3146), a half sine of time, with
the weight as its mean over a beat of frequency f:

    z'' = g (pi / (2 d) sin(pi t / d) - 1)  for t < d,    z'' = -g  for t > d,    z = g / f^2 h(t)

with t in beats. h is the integral whose mean and whose rate's mean are 0. That a half sine has no
lift left for the upstroke, nor drag for its wings, is an estimate. A body pitches about the middle
between its shoulders.

Beats without an end have none before the start either. A number of beats starts and ends at rest:
over a ramp of r beats they speed up, and stay r / 2 behind. The phase is the integral of the
frequency, and numbers that change over time do so smoothly: modes of flight follow each other
without a jump.

Besides beats, joints swing: a groom along a line, or joints about an axis. Trunks are levelled.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.interpolation import eased, eased_integral, monotone, smooth_step
from featherfx.algebra.types import Array
from featherfx.algebra.vectors import from_rotation_vector
from featherfx.errors import Problem
from featherfx.groom.types import Groom, Joint
from featherfx.shot.motion.joints import (
    HEAD,
    NECK,
    TARSI,
    JointPoses,
    MissingJointError,
    PosesOverTime,
    Skeleton,
    opened_poses,
    still_poses,
)
from featherfx.shot.types import Motion, Shot

TAIL = "tail"  # the joint that a tail hangs on


def shaken(motion: Motion, _shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of a groom that swings along a line as a whole, from rest."""
    values, joints = motion.values, len(skeleton.names)
    axis = np.asarray(values["direction"], dtype=np.float64)
    way = values["amplitude"] / np.linalg.norm(axis) * axis

    def poses(time: float) -> JointPoses:
        found = still_poses(joints)
        periods = max(time, 0.0) * values["frequency"]
        swing = math.sin(2.0 * math.pi * periods) * smooth_step(periods / values["ramp_periods"])
        found.displacements[0] = swing * way
        return found

    return poses


def swung(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of joints that swing about an axis, from rest.

    Raises MissingJointError where none of the joints is there.
    """
    values = motion.values
    pattern = values["joints"]
    moved = [k for k, name in enumerate(skeleton.names) if fnmatch.fnmatchcase(name, pattern)]
    if not moved:
        known = ", ".join(skeleton.names[1:]) or "none"
        message = f"'{pattern}' is no joint of the groom. There are: {known}"
        raise MissingJointError(Problem(str(shot.source), "motion.joints", message))
    axis = math.radians(values["angle"]) * np.asarray(values["axis"], dtype=np.float64)

    def poses(time: float) -> JointPoses:
        found = still_poses(len(skeleton.names))
        swings = max(time, 0.0) * values["frequency"]
        way = math.sin(2.0 * math.pi * (swings - values["phase"]))
        way *= smooth_step(swings / values["ramp_periods"])
        found.rotations[moved] = from_rotation_vector(way * axis)
        return found

    return poses


def levelled(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of a groom whose trunk rises no steeper than by an angle, from the root of its tail to
    the middle between its shoulders, and its neck no steeper than by another; tarsi and the head
    keep their direction.

    Raises MissingJointError where it has no tail or no shoulders.
    """
    trunk = trunk_of(shot.groom)
    if trunk is None:
        told = f"levels a trunk, and the groom lacks shoulders or the joint '{TAIL}'"
        raise MissingJointError(Problem(str(shot.source), "motion.kind", told))
    middle, rise = trunk
    down = max(rise - math.radians(motion.values["trunk_angle"]), 0.0)
    found = still_poses(len(skeleton.names))
    found.rotations[0] = _nose_down(down)
    tarsi = [k for k, name in enumerate(skeleton.names) if name in TARSI]
    found.rotations[tarsi] = found.rotations[0].T
    found.displacements[0] = (middle - found.rotations[0] @ middle) / motion.clock.size
    if HEAD in skeleton.names and NECK in skeleton.names:
        neck, head = skeleton.names.index(NECK), skeleton.names.index(HEAD)
        way, tail = skeleton.pivots[head] - skeleton.pivots[neck], skeleton.names.index(TAIL)
        steeper = math.atan2(way[2], way[0]) - down - math.radians(motion.values["neck_angle"])
        # short necks bend no tighter than round the length of the trunk
        most = np.linalg.norm(way) / np.linalg.norm(middle - skeleton.pivots[tail])
        bent = min(max(steeper, 0.0), float(most))
        found.rotations[neck], found.rotations[head] = _nose_down(bent), _nose_down(-bent)
    return lambda _: found


def _nose_down(angle: float) -> Array:
    """(3, 3) turn by an angle (rad) about the axis to the left."""
    return from_rotation_vector(np.array((0.0, angle, 0.0)))


def trunk_of(groom: Groom) -> tuple[Array, float] | None:
    """(3,) m, the middle between the shoulders of a groom, and rad, by which its trunk rises to
    there from the root of its tail; None where it lacks either."""
    shoulders = [each.position for each in groom.joints if each.role == "shoulder" and each.side]
    tails = [each.position for each in groom.joints if each.name == TAIL]
    if not (shoulders and tails):
        return None
    middle = np.mean(shoulders, axis=0) * (1.0, 0.0, 1.0)
    ahead, _, up = middle - tails[0]
    return middle, math.atan2(up, ahead)


_HINGE_LEAN = math.radians(20.0)
_RISE = math.radians(21.0)  # of a standing pigeon's trunk: samples/pigeon
_RAMP = 2.0  # beats, so that feathers are not thrown: docs/decisions/tried.md
# What mirroring at the plane of symmetry (y -> -y) does to the entries of a rotation matrix.
MIRROR = np.outer((1.0, -1.0, 1.0), (1.0, -1.0, 1.0))

# samples of a beat, by which extremes of curves are found
BEAT_SAMPLES = 256
_CURVES = ("elevation", "sweep", "twist", "elbow", "wrist")
# numbers in degrees that may change over time, and all of them
_TURNS = ("stroke_amplitude", "stroke_plane", "tip_reversal", "turn")
_NUMBERS = ("wingbeat_frequency", "downstroke", "heave", "pitch", *_TURNS)
# an angle in degrees at a phase from 0 to 1
_Curve = Callable[[float], float]
# times (s) and values
Track = tuple[Sequence[float], Sequence[float]]


def _curve(given: float | Mapping[str, Any] | Sequence[Sequence[float]]) -> _Curve:
    """The curve that a key of a flap describes: a number, a Fourier series or keys."""
    if isinstance(given, int | float):
        return lambda _: given
    if isinstance(given, Mapping):
        mean, harmonics = (
            given["mean"],
            np.array(given["harmonics"], dtype=np.float64).reshape(-1, 2),
        )
        orders = 2.0 * math.pi * np.arange(1, len(harmonics) + 1)

        def series(phase: float) -> float:
            turns = orders * phase
            return float(mean + np.cos(turns) @ harmonics[:, 0] + np.sin(turns) @ harmonics[:, 1])

        return series
    phases, values = np.array(given).T
    # three beats side by side, of which the middle one counts
    places = np.concatenate([phases - 1.0, phases, phases + 1.0])
    angles = np.tile(values, 3)[:, None]
    return lambda phase: float(monotone(places, angles, np.array([phase]))[0, 0])


def track_of(given: float | Sequence[tuple[float, float]]) -> Track:
    """Times (s) and values of a number that may change over time."""
    if isinstance(given, int | float):
        return (0.0,), (float(given),)
    times, values = zip(*given, strict=True)
    return times, values


def beats_in_time(beats: float) -> tuple[float, float]:
    """Return the ramp of a number of beats, and how many others take as much time."""
    ramp = min(_RAMP, beats)
    return ramp, beats + ramp


def _sped_up(beats: float, ramp: float) -> float:
    """Beats done after a start from rest, their speed a smooth step; ramp / 2 behind after it."""
    u = min(max(beats / ramp, 0.0), 1.0)
    return ramp * u**4 * (2.5 + u * (u - 3.0)) + max(beats - ramp, 0.0)


class _Angles(NamedTuple):
    """Angles of a wing, rad. tip: by which the hand is turned over."""

    elevation: float
    sweep: float
    twist: float
    elbow: float
    wrist: float
    tip: float


@dataclass(frozen=True)
class Flap:
    """A wing beat. curves: by joint. numbers: times (s) and values of those that may change.

    middle, half: of the stroke's curve. beats: from rest to rest; 0: it beats on and on.

    fold_factors: times (s) and factors of the folds of elbow and wrist.
    """

    curves: Mapping[str, _Curve]
    numbers: Mapping[str, Track]
    middle: float
    half: float
    beats: float
    fold_factors: Track = ((0.0,), (1.0,))

    @classmethod
    def read(cls, values: Mapping[str, Any]) -> Flap:
        """Make the beat that values of a motion describe, by their names in the shot file."""
        curves = {name: _curve(values[name]) for name in _CURVES}
        stroke = [curves["elevation"](k / BEAT_SAMPLES) for k in range(BEAT_SAMPLES)]
        low, high = min(stroke), max(stroke)
        numbers = {name: track_of(values[name]) for name in _NUMBERS}
        return cls(curves, numbers, 0.5 * (low + high), 0.5 * (high - low), values["beats"])

    def phase(self, time: float) -> float:
        """Return the phase, whole beats included, at a time (s)."""
        return _warped(self._beats_done(time), eased(*self.numbers["downstroke"], time))

    def heave(self, time: float, gravity: float) -> tuple[float, float]:
        """Return height (m) and pitch (rad, nose up) of the body over their means at a time (s).

        The lift that heaves the body acts at a constant lever, so that both go alike. gravity:
        m/s2.
        """
        share, pitch = (eased(*self.numbers[name], time) for name in ("heave", "pitch"))
        if share == 0.0 == pitch:
            return 0.0, 0.0
        frequency = eased(*self.numbers["wingbeat_frequency"], time)
        downstroke = eased(*self.numbers["downstroke"], time)
        height = _heave(self._beats_done(time) % 1.0, downstroke)
        pitched = math.radians(pitch) * height / _heave_range(downstroke)
        return share * gravity / frequency**2 * height, pitched

    def heave_range(self, time: float, gravity: float) -> float:
        """Return the way (m) from the lowest to the highest of the beat's heave at a time (s)."""
        names = "heave", "wingbeat_frequency", "downstroke"
        share, frequency, downstroke = (eased(*self.numbers[name], time) for name in names)
        return share * gravity / frequency**2 * _heave_range(downstroke)

    def _beats_done(self, time: float) -> float:
        since = (eased_integral(*self.numbers["wingbeat_frequency"], each) for each in (time, 0.0))
        done = next(since) - next(since)
        if self.beats <= 0.0:
            return done
        ramp, whole = beats_in_time(self.beats)
        if done < 0.5 * whole:
            return _sped_up(done, ramp)
        return self.beats - _sped_up(whole - done, ramp)

    def angles(self, phase: float, time: float, inside: float, factor: float) -> _Angles:
        """Return the angles of a wing. inside: 1 of the wing inside a turn, -1 outside. factor: of
        the folds."""
        number = {name: math.radians(eased(*self.numbers[name], time)) for name in _TURNS}
        at = {name: math.radians(curve(phase % 1.0)) for name, curve in self.curves.items()}
        middle = math.radians(self.middle)
        beat = (at["elevation"] - middle) / math.radians(self.half) if self.half else 0.0
        lean = number["stroke_plane"]
        arm = middle + 0.5 * beat * number["stroke_amplitude"]
        turn = inside * number["turn"]
        upstroke = max(-math.sin(2.0 * math.pi * phase), 0.0)
        return _Angles(
            math.atan2(math.sin(arm) * math.cos(lean), math.cos(arm)),
            math.asin(math.sin(arm) * math.sin(lean)) + at["sweep"] + turn,
            at["twist"] + turn,
            factor * at["elbow"],
            factor * at["wrist"],
            number["tip_reversal"] * upstroke**3,
        )


def _warped(beats: float, downstroke: float) -> float:
    """Phase, whole beats included, of a beat whose downstroke takes a fraction of its time."""
    if downstroke == 0.5:
        return beats
    quarter = 0.5 * downstroke
    whole = math.floor(beats - quarter + 0.5)
    tangent = math.tan(math.pi * (beats - quarter - whole)) / math.tan(math.pi * quarter)
    return whole + 0.25 + math.atan(tangent) / math.pi


def _heave(time: float, downstroke: float) -> float:
    """h at a time in beats, from 0 to 1."""
    d = downstroke
    rate = -0.5 * (1.0 - d)
    falling = d**2 / 4.0 - d**3 / 6.0 + rate * d**2 / 2.0 - d**2 / math.pi**2
    rising = 0.5 * (1.0 + rate) * (1.0 - d**2) - (1.0 - d**3) / 6.0 - 0.5 * d * (1.0 - d)
    found = -falling - rising - 0.5 * time**2 + rate * time
    if time < d:
        return found + 0.5 * time - d / (2.0 * math.pi) * math.sin(math.pi * time / d)
    return found + time - 0.5 * d


@lru_cache(64)
def _heave_range(downstroke: float) -> float:
    """h at its highest less that at its lowest."""
    return float(np.ptp([_heave(k / BEAT_SAMPLES, downstroke) for k in range(BEAT_SAMPLES)]))


@dataclass(frozen=True)
class Wings:
    """Joints of a groom that beat. hinges, hands: by number of the joint, of those that have one.

    In opened wings and the groom's axes: the hinge's turn (rad), the direction of the hand. axes:
    (3, 3), to those of shoulders."""

    joints: Sequence[Joint]
    hinges: Mapping[int, Array]
    hands: Mapping[int, Array]
    axes: Array

    @classmethod
    def find(cls, groom: Groom, skeleton: Skeleton) -> Wings:
        carriers, _ = skeleton.carriers(opened_poses(groom))
        hinges, hands = {}, {}
        for number, joint in enumerate(groom.joints, 1):
            hinge = joint.hinge
            if (
                joint.side
                and joint.role in ("elbow", "wrist")
                and hinge is not None
                and hinge.any()
            ):
                hinges[number] = carriers[number] @ hinge
                if joint.bone is not None:
                    hand = carriers[number] @ (np.asarray(joint.bone) - joint.position)
                    hands[number] = hand / np.linalg.norm(hand)
        return cls(groom.joints, hinges, hands, wing_axes(groom))

    def poses(self, flap: Flap, phase: float, time: float, factor: float) -> JointPoses:
        """Return the poses of all joints at a phase of the beat."""
        wings = {side: flap.angles(phase, time, side, factor) for side in (1, -1)}
        found = still_poses(len(self.joints) + 1)
        for number, joint in enumerate(self.joints, 1):
            if not joint.side or joint.role == "body":
                continue
            angles = wings[joint.side]
            if number not in self.hinges:
                turn = self.axes.T @ _turn(joint.role, angles) @ self.axes
                found.rotations[number] = turn if joint.side > 0 else turn * MIRROR
                continue
            hinge, bend = self.hinges[number], getattr(angles, joint.role)
            whole = float(np.linalg.norm(hinge))
            found.bends[number] = bend / whole
            if joint.role == "wrist" and angles.tip and number in self.hands:
                hand = from_rotation_vector(bend / whole * hinge) @ self.hands[number]
                found.rotations[number] = from_rotation_vector(-joint.side * angles.tip * hand)
        return found


def wing_axes(groom: Groom) -> Array:
    """(3, 3) turn from the axes of a groom to those about which its shoulders turn."""
    trunk = trunk_of(groom)
    lean = 0.0 if trunk is None else trunk[1] - _RISE
    return from_rotation_vector(np.array((0.0, lean, 0.0)))


def _turn(role: str, angles: _Angles) -> Array:
    """(3, 3) turn of a joint of the left wing that has no hinge."""
    about_x, about_y, about_z = np.eye(3)
    if role == "shoulder":
        raised = from_rotation_vector(angles.elevation * about_x)
        swept = from_rotation_vector(angles.sweep * about_z)
        return raised @ swept @ from_rotation_vector(angles.twist * about_y)
    lean = np.array((-math.sin(_HINGE_LEAN), 0.0, math.cos(_HINGE_LEAN)))
    if role == "elbow":
        return from_rotation_vector(angles.elbow * lean * (1.0, 0.0, -1.0))
    return from_rotation_vector(angles.wrist * lean) @ from_rotation_vector(-angles.tip * about_y)
