"""The shape of a feather whose shaft lies along a drawn curve.

The curve gives the form alone: it is taken to the root and to the shaft's own length. Vanes are
carried along without turning about the shaft: a row whose tangent is t at rest and t' in the shape,
the first ones t_0 and t_0', turns by

    T'(t_0' to t') R(t_0 to t_0') T(t_0 to t)^T

with T the turns along a curve that do not twist about it, and R the shortest turn.
"""

from __future__ import annotations

import math

import numpy as np

from featherfx.algebra.rotation import from_rotation_vector, transported
from featherfx.algebra.types import Array
from featherfx.feather.types import RowPoints

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
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    scale = station[-1] / way[-1]
    places = [np.interp(station, scale * way, scale * (each - each[0])) for each in line.T]
    shaft = np.stack(places, axis=1)
    first, own = (_start(each, station) for each in (axis, shaft))
    turn = transported(shaft, station) @ _shortest(first, own)
    back = transported(axis, station) @ turn.transpose(0, 2, 1)
    moved = shaft[:, None] + (nodes - nodes[:, :1]) @ back
    return RowPoints(moved, rest.directors @ back)


def _start(points: Array, station: Array) -> Array:
    """(3,) unit tangent at the first of points on a curve, as turns along it are taken from."""
    way = np.gradient(points, station, axis=0, edge_order=2)[0]
    return np.asarray(way / np.linalg.norm(way))


def _shortest(first: Array, second: Array) -> Array:
    """The shortest turn (3, 3) from one unit vector to another; of opposite ones, one of many."""
    axis = np.cross(first, second)
    sine, cosine = float(np.linalg.norm(axis)), float(first @ second)
    if cosine < 0.0 and sine < 1e-6:  # the axis is of rounding alone
        across = np.cross(first, np.eye(3)[np.argmin(np.abs(first))])
        half = from_rotation_vector(across * (math.pi / np.linalg.norm(across)))
        return _shortest(-first, second) @ half
    return from_rotation_vector(axis * (math.atan2(sine, cosine) / sine if sine > 0.0 else 1.0))
