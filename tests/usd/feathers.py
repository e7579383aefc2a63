"""A small feather, written out by hand, for the tests of files and pictures."""

from __future__ import annotations

import numpy as np
import pytest

from featherfx.feather.types import (
    LEADING,
    RACHIS_PART,
    TRAILING,
    Feather,
    FeatherSurface,
    RowPoints,
    both,
    turned,
)
from featherfx.shot.frames import FeatherPose, Frame
from featherfx.usd.types import FeatherEntry

ROWS, COLUMNS, LENGTH, RADIUS = 4, 2, 0.1, 0.001


def rest_points() -> RowPoints:
    """A flat feather of 4 rows along x, barbs at 45 degrees, 2 columns a side."""
    nodes = np.zeros((ROWS, 1 + 2 * COLUMNS, 3))
    for row in range(ROWS):
        nodes[row, 0] = (LENGTH * row / (ROWS - 1), 0, 0)
        for column in range(1, COLUMNS + 1):
            step = 0.01 * column
            nodes[row, column] = nodes[row, 0] + (step, step, 0)
            nodes[row, COLUMNS + column] = nodes[row, 0] + (step, -step, 0)
    return RowPoints(nodes, np.tile(np.eye(3)[1:], (ROWS, 1, 1)))


def surface() -> FeatherSurface:
    """5 vane points a row (trailing end to leading end) and a square tube of 4 points a row."""
    vane_nodes = [2 + COLUMNS, 1 + COLUMNS, 0, 1, 2]
    row, node, offset, st = [], [], [], []
    for i in range(ROWS):
        for k, place in enumerate(vane_nodes):
            row.append(i)
            node.append(place)
            offset.append((0.0, 0.0))
            st.append((k / 4, i / (ROWS - 1)))
        for across, up in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            row.append(i)
            node.append(0)
            offset.append((RADIUS * across, RADIUS * up))
            st.append((0.5, i / (ROWS - 1)))
    triangles, part, direction = [], [], []

    def add(a: int, b: int, c: int, which: int, along: tuple[float, float, float]) -> None:
        triangles.append((a, b, c))
        part.append(which)
        direction.append(along)

    slope = 0.5**0.5
    for i in range(ROWS - 1):
        low, high = 9 * i, 9 * (i + 1)
        for k in (2, 3):
            add(low + k, high + k, low + k + 1, LEADING, (slope, slope, 0))
            add(low + k + 1, high + k, high + k + 1, LEADING, (slope, slope, 0))
        for k in (2, 1):
            add(low + k, low + k - 1, high + k, TRAILING, (slope, -slope, 0))
            add(low + k - 1, high + k - 1, high + k, TRAILING, (slope, -slope, 0))
        for k in range(4):
            a, b = 5 + k, 5 + (k + 1) % 4
            add(low + a, high + a, low + b, RACHIS_PART, (1, 0, 0))
            add(low + b, high + a, high + b, RACHIS_PART, (1, 0, 0))
    result = FeatherSurface(
        np.array(row), np.array(node), np.array(offset), np.array(triangles), np.array(part),
        np.array(direction, dtype=float), np.array(st),
    )  # fmt: skip
    return _outward(result)


def _outward(given: FeatherSurface) -> FeatherSurface:
    """Vanes face dorsal (z), the tube faces away from its axis."""
    points = given.points(rest_points())
    triangles = given.triangles.copy()
    for index, (a, b, c) in enumerate(given.triangles):
        normal = np.cross(points[b] - points[a], points[c] - points[a])
        centre = points[[a, b, c]].mean(axis=0)
        wanted = (0, *centre[1:]) if given.part[index] == RACHIS_PART else (0, 0, 1)
        if normal @ np.array(wanted) < 0:
            triangles[index] = (a, c, b)
    return FeatherSurface(
        given.row, given.node, given.offset, triangles, given.part, given.barb_direction,
        given.st,
    )  # fmt: skip


def feather() -> Feather:
    barbs = np.full((2, ROWS), 0.01 * COLUMNS * 2**0.5)
    return Feather(
        rest=rest_points(),
        station=np.linspace(0, LENGTH, ROWS),
        width=np.full(ROWS, 2 * RADIUS),
        height=np.full(ROWS, 2 * RADIUS),
        barb_length=barbs,
        barb_span=np.full((2, ROWS), LENGTH / ROWS),
        cell=np.ones((2, ROWS - 1, COLUMNS, 2), dtype=bool),
        surface=surface(),
    )


def placed(offset: tuple[float, float, float], angle: float = 0.0) -> RowPoints:
    """The feather turned about y and moved; directors turn only."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    return turned(turn.T, rest_points()).shifted(np.array(offset, dtype=float))


def entries() -> list[FeatherEntry]:
    """Two that move (from frame 1, from frame 3), one that never does, one declared static."""
    one = feather()
    return [
        FeatherEntry("primary/1", "primary", "left wing", one, placed((0, 0.0, 0))),
        FeatherEntry("primary 1", "primary", "left wing", one, placed((0, 0.1, 0))),
        FeatherEntry("covert", "covert", "body", one, placed((0, 0.2, 0))),
        FeatherEntry("tail", "tail feather", "tail", one, placed((0, 0.3, 0)), static=True),
    ]


def frame(number: int, first: int = 1, rate: float = 24.0) -> Frame:
    """A frame of the four feathers: the first flaps from the start, the second from frame 3 on."""
    time = (number - first) / rate
    angles = [0.4 * np.sin(5 * time) + 0.01, max(0.0, 0.05 * (number - first - 1)), 0.0, 0.0]
    rates = [0.4 * 5 * np.cos(5 * time), 0.05 * rate if number - first > 1 else 0.0, 0.0, 0.0]
    offsets = [(0, 0.1 * k, 0) for k in range(4)]
    points = [placed(o, a) for o, a in zip(offsets, angles, strict=True)]
    quarter = [placed((0, 0, 0), a + np.pi / 2) for a in angles]
    # d/dangle of a turn about y is the turned (x, z) plane; y does not move.
    velocities = [
        both(lambda part, r=r: part * (1, 0, 1) * r, t) for t, r in zip(quarter, rates, strict=True)
    ]
    return frame_of(number, time, points, velocities)


def frame_of(number, time, points, velocities) -> Frame:
    """A frame of given points and velocities, without accelerations."""
    still = [both(np.zeros_like, each) for each in points]
    return Frame(number, time, tuple(map(FeatherPose, points, velocities, still)))


def usd_faults(stage):
    """What USD's validators find, but nodes of MaterialX, which usd-core lacks; test_usd_materials
    holds these against MaterialX itself."""
    validation = pytest.importorskip("pxr.UsdValidation")
    registry = validation.ValidationRegistry()
    context = validation.ValidationContext(registry.GetOrLoadAllValidators())
    found = [error.GetErrorAsString() for error in context.Validate(stage)]
    return [each for each in found if "shaderId 'ND_" not in each]
