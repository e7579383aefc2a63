"""Shapes of pose targets: whether a file's mesh or curve is one of a feather, and its nodes.

A shaft may lie along a drawn curve. The curve gives the form alone: it is taken to the root and to
the shaft's own length. Vanes are carried along without turning about the shaft: a row whose tangent
is t at rest and t' in the shape, the first ones t_0 and t_0', turns by

    T'(t_0' to t') R(t_0 to t_0') T(t_0 to t)^T

with T the turns along a curve that do not twist about it, and R the shortest turn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from featherfx.algebra.rotation import from_rotation_vector, start_tangent, transported
from featherfx.algebra.types import Array
from featherfx.algebra.vectors import arc_lengths
from featherfx.errors import Problem, require
from featherfx.feather.density import density_map
from featherfx.feather.types import Feather, RowPoints
from featherfx.shot.patterns import fits
from featherfx.shot.roots import Roots
from featherfx.shot.types import Shot, Target

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
