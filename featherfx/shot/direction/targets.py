"""Pose targets: some feathers are brought to a shape by springs, held, and let go again.

Every node x_i, of mass m_i with the air that it carries, is pulled to its place y_i in the shape,
which its root carries along:

    E = sum_i 1/2 m_i w(h)^2 max(|x_i - y_i| - s, 0)^2
    1 / w(h)^2 = (1 - h) / (h w_1^2) + 1 / w(1)^2,     w(1)^2 = SAFETY (g + 1/2 w_1^2 L) / (d L)

h: hold, 0 to 1, smooth between its keys. w_1: the feather's first natural frequency: a
constant force displaces it by w_1^2 / (w_1^2 + w^2) of what it would without springs, so h is the
share of the way to the shape. L: length, d: tolerance. 1/2 w_1^2 L is about the acceleration with
which a feather leaves a shape that is bent by half of its length, g that of gravity. s: how
far a node is free around its place: half of `within`, in whose other half, if d L is no less,
springs stop it, so that an outline stays within all of it, but for the error of a step, which
`tolerance` of the quality bounds. (Springs that hold the whole feather at one node, of its whole
mass, keep it no nearer and bounce: 14 times the time.)

A shape is a file's mesh or curve, if it is one of the feather. A shaft may lie along a drawn curve.
The curve gives the form alone: it is taken to the root and to the shaft's own length. Vanes are
carried along without turning about the shaft: a row whose tangent is t at rest and t' in the shape,
the first ones t_0 and t_0', turns by

    T'(t_0' to t') R(t_0 to t_0') T(t_0 to t)^T

with T the turns along a curve that do not twist about it, and R the shortest turn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import arc_lengths, from_rotation_vector, start_tangent, transported
from featherfx.errors import Problem, as_figure, require, warn_input
from featherfx.feather.density import density_map
from featherfx.feather.types import Feather, RowPoints, stacked
from featherfx.mechanics.model import Loads, Model
from featherfx.shot.detail.guided import Turns
from featherfx.shot.direction.channels import Curve, ShownTurns, scaled_turns
from featherfx.shot.frames import FeatherPose
from featherfx.shot.loop.groups import FeatherGroup, GroupLoad
from featherfx.shot.loop.run import ShotLoad, ShotRun, Stage
from featherfx.shot.patterns import Target, fits
from featherfx.shot.roots import Roots, arrived
from featherfx.shot.types import Shot
from featherfx.solver.damping import first_frequency

# over a shaft's length: how long a curve may be, and how far from the root it may begin
LENGTHS, AWAY = (0.5, 2.0), 0.25


def why_no_shaft(line: Array, length: float) -> str:
    """Explain why a curve (k, 3) m, in a root's frame, is no rachis of a length (m); empty where it
    is one."""
    own = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    away = [float(np.linalg.norm(line[k])) for k in (0, -1)]
    least, most = LENGTHS
    if not least * length <= own <= most * length:
        return (
            f"is {own:.3g} m long, its shaft {length:.3g} m. Draw it {least:g} to {most:g}"
            " times as long"
        )
    if away[0] > AWAY * length:
        turned = ". It ends there: is it reversed?" if away[1] <= AWAY * length else ""
        return f"begins {away[0]:.3g} m from its root, more than {AWAY * length:.3g} m{turned}"
    return ""


def along_line(rest: RowPoints, station: Array, line: Array) -> RowPoints:
    """A feather whose shaft has the form of a curve (k, 3) m. rest: its pose, in the same axes.
    station: (n,) m, arc lengths of its rows."""
    nodes, axis = rest.nodes, rest.nodes[:, 0]
    way = arc_lengths(line)
    scale = station[-1] / way[-1]
    places = [np.interp(station, scale * way, scale * (each - each[0])) for each in line.T]
    shaft = np.stack(places, axis=1)
    first, own = (start_tangent(each, station) for each in (axis, shaft))
    turn = transported(shaft, station) @ _shortest(first, own)
    back = transported(axis, station) @ turn.transpose(0, 2, 1)
    moved = shaft[:, None] + (nodes - nodes[:, :1]) @ back
    return RowPoints(moved, rest.directors @ back)


def _shortest(first: Array, second: Array) -> Array:
    """The shortest turn (3, 3) from one unit vector to another; of opposite ones, one of many."""
    axis = np.cross(first, second)
    sine, cosine = float(np.linalg.norm(axis)), float(first @ second)
    if cosine < 0.0 and sine < 1e-6:  # the axis is of rounding alone
        across = np.cross(first, np.eye(3)[np.argmin(np.abs(first))])
        half = from_rotation_vector(across * (math.pi / np.linalg.norm(across)))
        return _shortest(-first, second) @ half
    return from_rotation_vector(axis * (math.atan2(sine, cosine) / sine if sine > 0.0 else 1.0))


def refuse_other_shapes(shot: Shot, drawn: Sequence[Feather], motion: Roots) -> None:
    """Raise InputError with a problem of every target whose file lacks feathers, or has other
    shapes than theirs.

    drawn: all feathers of the shot on the meshes' grid.
    """
    problems = []
    for number, target in enumerate(shot.targets):
        own = [f for f, each in enumerate(shot.groom.feathers) if fits(target, each)]
        faults = [why for f in own if (why := _fault(shot, target, f, drawn[f], motion))]
        if faults:
            dot = "" if faults[0].endswith("?") else "."
            more = f"{dot} {len(faults) - 1} more of its feathers do not fit" if faults[1:] else ""
            key = f"target[{number}].shape"
            problems.append(Problem(str(shot.source), key, faults[0] + more))
    require(*problems)


def _fault(shot: Shot, target: Target, f: int, drawn: Feather, motion: Roots) -> str:
    """Explain why the file of a target gives no shape of a feather; empty where it does."""
    name, meshes, lines = shot.groom.feathers[f].id, target.points or {}, target.lines or {}
    if target.points is None and target.lines is None:
        return ""
    if name in meshes:
        found, own = len(meshes[name]), len(drawn.surface.row)
        if found == own:
            return ""
        mesh = f"'{name}' in {target.shape} has {found} points; this shot's mesh has {own}"
        return f"{mesh}, of the quality's rows and columns"
    if name in lines:
        wrong = why_no_shaft(_on_root(shot, target, f, lines[name], motion), drawn.station[-1])
        return f"the curve of '{name}' in {target.shape} {wrong}" if wrong else ""
    return f"{target.shape} has no feather '{name}'"


def _on_root(shot: Shot, target: Target, f: int, points: Array, motion: Roots) -> Array:
    """Points (..., 3) m of a target's file as a feather's root sees them."""
    position, rotation = shot.groom.feathers[f].position, shot.groom.feathers[f].rotation
    if target.frame is not None:
        frames = motion.frames(shot.time_of(target.frame))
        position, rotation = frames.positions[f], frames.rotations[f]
    return np.asarray((points - position) @ rotation)


def shape_of(
    shot: Shot, target: Target, f: int, drawn: Feather, own: Feather, motion: Roots
) -> RowPoints:
    """A target's shape in the root frame of a feather, as it is drawn and as it is simulated, on
    the grid of the latter. What fits has been asked before."""
    name = shot.groom.feathers[f].id
    if target.points is not None and name in target.points:
        shape = _row_points(_on_root(shot, target, f, target.points[name], motion), drawn)
        same = drawn.cell.shape == own.cell.shape
        return shape if same else density_map(drawn, own)(shape)
    if target.lines is not None and name in target.lines:
        line = _on_root(shot, target, f, target.lines[name], motion)
        return along_line(own.rest, own.station, line)
    return own.rest


def _row_points(points: Array, feather: Feather) -> RowPoints:
    """Nodes, and directors (fitted to the tube of the shaft), of a mesh's points (V, 3).

    Nodes that the mesh does not show are carried along by the directors of their row.
    """
    rest, surface = feather.rest, feather.surface
    on_node = np.flatnonzero((surface.offset == 0.0).all(axis=1))[::-1]
    shaft = rest.nodes[:, 0].copy()
    of_shaft = on_node[surface.node[on_node] == 0]
    shaft[surface.row[of_shaft]] = points[of_shaft]
    directors = rest.directors.copy()
    for row in range(feather.rows):
        around = np.flatnonzero((surface.row == row) & (surface.offset != 0.0).any(axis=1))
        if len(around) >= 2:
            apart = points[around] - shaft[row]
            directors[row] = np.linalg.lstsq(surface.offset[around], apart, rcond=None)[0]
    before, after = (
        np.concatenate([np.cross(each[:, :1], each[:, 1:]), each], axis=1)
        for each in (rest.directors, directors)
    )
    parts = (rest.nodes - rest.nodes[:, :1]) @ np.linalg.inv(before)
    nodes = shaft[:, None] + parts @ after
    nodes[surface.row[on_node], surface.node[on_node]] = points[on_node]
    return RowPoints(nodes, directors)


# so that feathers are within the tolerance in the first frame of full hold, though they arrive in
# motion (with 16 a beating secondary that is bent by a fifth of its length was 1.1 times off)
SAFETY = 24.0
GRAVITY = 9.81  # m/s^2
# of `within`: 48 runs of a beating feather, thrown out of it by 17 to 34 times as much without
# springs, end in 0.98 of it at most; with 2/3 free in 1.4
FREE = 0.5


@dataclass(frozen=True)
class Pull:
    """Springs of one target on a batch of feathers.

    target: of the shot. hold: over time. members: (K,) places in the batch. local: (K, n, 1 + 2 m,
    3) m, nodes of the shape in root frames. mass: (K, n, 1 + 2 m) kg and air_volume: the same, m^3,
    as of a Model. length: (K,) m. first, most: (K,) 1/s^2, w_1^2 and w(1)^2.
    """

    target: Target
    hold: Curve
    members: Indices
    local: Array
    mass: Array
    air_volume: Array
    length: Array
    first: Array
    most: Array

    def stiffness(self, hold: float, loads: Loads) -> Array:
        """(K, n, 1 + 2 m) N/m of the springs, hold above 0."""
        square = 1.0 / ((1.0 - hold) / (hold * self.first) + 1.0 / self.most)
        mass = self.mass
        if loads.added_mass.size:
            carried = loads.air[0] * loads.added_mass[self.members]
            mass = mass + carried[:, None, None] * self.air_volume
        return mass * square[:, None, None]


class Pulls(GroupLoad):
    """All targets of a batch; members: (F,) numbers of its feathers in the shot."""

    def __init__(self, found: Sequence[Pull], members: Indices, motion: Roots) -> None:
        self._found, self._members, self._motion = tuple(found), members, motion

    def added(self, loads: Loads, group: FeatherGroup, start: float, end: float) -> Loads:
        """Loads of the batch from start to end (s) with those of the targets, as grips."""
        for pull in self._found:
            hold = pull.hold.value(end)
            if hold > 0.0:
                places = self._world(pull, start, True), self._world(pull, end, False)
                loads = _gripped(loads, pull, hold, places)
        return loads

    def deviations(self, nodes: Array, time: float) -> list[tuple[Target, Indices, Array]]:
        """List the targets that are held in full at a time (s): target, the shot's numbers of its
        feathers, and (K,) how far these are off it, of their lengths. nodes: (F, n, 1 + 2 m, 3)
        m."""
        told = []
        for pull in self._found:
            if pull.hold.value(time) < 1.0:
                continue
            apart = np.linalg.norm(nodes[pull.members] - self._world(pull, time, False), axis=-1)
            apart = np.where(pull.mass == 0.0, 0.0, np.maximum(apart - pull.target.within, 0.0))
            worst = apart.max(axis=(1, 2)) / pull.length
            told.append((pull.target, self._members[pull.members], worst))
        return told

    def _world(self, pull: Pull, time: float, begins: bool) -> Array:
        """(K, n, 1 + 2 m, 3) m, the shape on its roots; begins: after a cut at that time."""
        frames = arrived(self._motion, time) if begins else self._motion.frames(time)
        own = self._members[pull.members]
        turned = np.einsum("kij,krpj->krpi", frames.rotations[own], pull.local)
        return np.asarray(turned + frames.positions[own][:, None, None])


def _gripped(loads: Loads, pull: Pull, hold: float, places: Sequence[Array]) -> Loads:
    """Loads with more grips: (K, n, 1 + 2 m, 3) m places at start and end."""
    feathers, rows, points = len(loads.grip_stiffness), *pull.mass.shape[1:]
    node = np.full((feathers, rows * points, 2), -1, dtype=np.int64)
    stiffness = np.zeros((feathers, rows * points))
    targets = np.zeros((2, feathers, rows * points, 3))
    every = np.indices((rows, points)).reshape(2, -1).T
    own = pull.stiffness(hold, loads).reshape(len(pull.members), -1)
    node[pull.members] = np.where(own[..., None] > 0.0, every, -1)
    stiffness[pull.members] = own
    for target, place in zip(targets, places, strict=True):
        target[pull.members] = place.reshape(len(place), -1, 3)
    return loads._replace(
        grip_node=np.concatenate([loads.grip_node, node], axis=1),
        grip_start=np.concatenate([loads.grip_start, targets[0]], axis=1),
        grip_end=np.concatenate([loads.grip_end, targets[1]], axis=1),
        grip_stiffness=np.concatenate([loads.grip_stiffness, stiffness], axis=1),
        grip_slack=_extended(
            loads.grip_slack, loads, rows * points, FREE * pull.target.within, 0.0
        ),
        max_grip_force=_extended(loads.max_grip_force, loads, rows * points, np.inf, np.inf),
    )


def _extended(before: Array, loads: Loads, count: int, value: float, neutral: float) -> Array:
    """Extend an optional array of the grips of loads by a value of so many more grips. neutral:
    value of grips where the array is empty."""
    if not before.size and value == neutral:
        return before
    own = before if before.size else np.full(loads.grip_stiffness.shape, neutral)
    return np.concatenate([own, np.full((len(own), count), value)], axis=1)


class TargetLoads(ShotLoad):
    """The targets of a shot."""

    def on(self, group: FeatherGroup) -> GroupLoad | None:
        """The targets of a batch; None where no target is about any of its feathers."""
        run, feathers, members = self.run, group.feathers, group.members
        shot, drawn, motion, model = run.shot, run.drawn, run.motion, group.own
        found, known = [], dict[bytes, float]()
        for target in shot.targets:
            chosen = [k for k, f in enumerate(members) if fits(target, shot.groom.feathers[f])]
            if chosen:
                local = [
                    shape_of(shot, target, int(f), drawn[f], feathers[k], motion).nodes
                    for k, f in zip(chosen, members[chosen], strict=True)
                ]
                length = np.array([feathers[k].station[-1] for k in chosen])
                first = np.array([_first_square(model, k, known) for k in chosen])
                strong = GRAVITY + 0.5 * first * length
                reach = target.tolerance / 100.0 * length
                if target.within > 0.0:
                    reach = np.minimum(reach, (1.0 - FREE) * target.within)
                found.append(
                    Pull(
                        target=target,
                        hold=Curve.of_keys(shot, target.keys),
                        members=np.array(chosen, dtype=np.int64),
                        local=np.array(local),
                        mass=model.mass[chosen],
                        air_volume=model.air_volume[chosen],
                        length=length,
                        first=first,
                        most=SAFETY * strong / reach,
                    )
                )
        return Pulls(found, members, motion) if found else None


def depend_on_targets(shot: Shot, _motion: Roots) -> list[Any]:
    """List the targets of every feather of a shot: keys, frame, tolerance and points."""
    found: list[Any] = []
    for placement in shot.groom.feathers:
        own = [
            (
                each.keys,
                each.frame,
                each.tolerance,
                each.within,
                each.points and each.points.get(placement.id),
                each.lines and each.lines.get(placement.id),
            )
            for each in shot.targets
            if fits(each, placement)
        ]
        found.append(own or None)
    return found


def _first_square(model: Model, k: int, known: dict[bytes, float]) -> float:
    """w_1^2 (1/s^2) of a feather of a batch, of dashpots that hold. known: of others like it."""
    keyed = "mass", "rachis_stiffness", "barb_stiffness"
    key = b"".join(getattr(model, name)[k].tobytes() for name in keyed)
    if key not in known:
        stiffening = 1.0 + model.relaxation_weight[k].sum(axis=1).max()
        known[key] = stiffening * first_frequency(model, k) ** 2
    return known[key]


@dataclass(frozen=True)
class LedShapes:
    """Guided and rigid feathers of a target: their turns are led to those of its shape.

    hold: over time. aims: turns of the shape; shapes: (F, n, 1 + 2 m, 3) m, its nodes in root
    frames. lengths: (F,) m.
    """

    target: Target
    hold: Curve
    shown: ShownTurns
    aims: Turns
    shapes: Array
    lengths: Array

    def turns(self, turns: Turns, time: float) -> Turns:
        """Return the turns that are shown at a time (s): those of a pose, on the way to the shape.

        Within its distance from the shape a feather is free."""
        hold = np.full(len(self.shapes), self.hold.value(time))
        if self.target.within > 0.0:
            away = self.lengths * self.deviations(self.shown.shapes.posed(turns).nodes, 0.0)
            hold *= 1.0 - self.target.within / np.maximum(away, self.target.within)
        free, held = scaled_turns(turns, 1.0 - hold), scaled_turns(self.aims, hold)
        return Turns(free.along + held.along, free.barbs + held.barbs)

    def deviations(self, nodes: Array, within: float | None = None) -> Array:
        """(F,) of their lengths, how far nodes in root frames are beyond `within` of the shape."""
        away = np.linalg.norm(nodes - self.shapes, axis=-1).max(axis=(1, 2))
        return (
            np.maximum(away - (self.target.within if within is None else within), 0.0)
            / self.lengths
        )


def _lead(run: ShotRun, number: int) -> LedShapes | None:
    """Guided and rigid feathers of a target of a shot; None where it has none."""
    target, feathers = run.shot.targets[number], run.shot.groom.feathers
    wanted = (f for f in run.wanted.tolist() if fits(target, feathers[f]))
    members = [f for f in wanted if not run.options.feathers[f].is_simulated]
    if not members:
        return None
    shown, drawn = ShownTurns(run, np.array(members)), [run.drawn[f] for f in members]
    aims = stacked(
        [
            shape_of(run.shot, target, f, own, own, run.motion)
            for f, own in zip(members, drawn, strict=True)
        ]
    )
    # roots do not turn: what a shape is turned by against its root is the first interval's
    aims.nodes[:, 0] = [each.rest.nodes[0] for each in drawn]
    aims.directors[:, 0] = [each.rest.directors[0] for each in drawn]
    return LedShapes(
        target=target,
        hold=Curve.of_keys(run.shot, target.keys),
        shown=shown,
        aims=shown.shapes.turns(aims),
        shapes=aims.nodes,
        lengths=np.array([each.station[-1] for each in drawn]),
    )


class TargetStage(Stage):
    """Deviations of feathers from the shapes that they are held in, and those that it leads.

    worst: by target's number, the greatest deviation beyond `within` (of the length), the feather
    and the frame.
    """

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        refuse_other_shapes(run.shot, run.drawn, run.motion)
        self._shot = run.shot
        self._worst: dict[int, tuple[float, str, float]] = {}
        self._led = [each for k in range(len(run.shot.targets)) if (each := _lead(run, k))]

    def note(self, index: int) -> None:
        """Look at all batches at a sample."""
        for group in self.run.groups if index >= 0 else ():
            for pulls in group.acting:
                if isinstance(pulls, Pulls):
                    self._note_batch(pulls, group.state.points.nodes, index)

    def follow(self, index: int, poses: dict[int, FeatherPose]) -> None:
        """Lead guided and rigid feathers at a sample."""
        time = self.run.time(index)
        for led in self._led:
            led.shown.change(index, poses, led.turns)
            if led.hold.value(time) == 1.0:
                members, roots = led.shown.members, self.run.motion.frames(time)
                nodes = np.stack([poses[f].points.nodes for f in members.tolist()])
                nodes = nodes - roots.positions[members][:, None, None]
                apart = led.deviations(nodes @ roots.rotations[members][:, None])
                self._note_worst(led.target, members, apart, index)

    def _note_batch(self, pulls: Pulls, nodes: Array, index: int) -> None:
        for target, members, deviations in pulls.deviations(nodes, self.run.time(index)):
            self._note_worst(target, members, deviations, index)

    def _note_worst(self, target: Target, members: Indices, deviations: Array, index: int) -> None:
        number = next(k for k, each in enumerate(self._shot.targets) if each is target)
        k = int(np.argmax(deviations))
        worst = float(deviations[k])
        if worst > self._worst.get(number, (-1.0,))[0]:
            name = self._shot.groom.feathers[int(members[k])].id
            self._worst[number] = worst, name, self.run.number(index)

    def report(self) -> dict[str, object]:
        """`targets`: of each that was held in full, the worst feather, frame, and its percent."""
        told = [
            {"target": number, "deviation": 100.0 * worst, "feather": name, "frame": frame}
            for number, (worst, name, frame) in sorted(self._worst.items())
        ]
        return {"targets": told} if told else {}

    def finish(self, index: int) -> None:
        """Warn of targets were not reached within their tolerance."""
        for number, (worst, name, frame) in sorted(self._worst.items()):
            allowed = self._shot.targets[number].tolerance
            if 100.0 * worst > allowed:
                message = (
                    f"{self._shot.source}: target[{number}]: '{name}' is"
                    f" {as_figure(100.0 * worst)} % of its length off at frame {frame:g},"
                    f" tolerance = {allowed:g}. A smaller"
                    " tolerance pulls harder, but no shape is reached that stretches shaft or barbs"
                )
                warn_input(message)
