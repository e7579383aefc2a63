"""A small feather, written out by hand, for the tests of files and pictures."""

from __future__ import annotations

import numpy as np

from featherfx.feather.types import LEADING, RACHIS, TRAILING, Feather, Surface
from featherfx.shot.types import Frame
from featherfx.usd.types import FeatherEntry

ROWS, COLUMNS, LENGTH, RADIUS = 4, 2, 0.1, 0.001


def material_points() -> np.ndarray:
    """(4, 7, 3): a flat feather along x, barbs at 45 degrees, 2 columns a side."""
    points = np.zeros((ROWS, 3 + 2 * COLUMNS, 3))
    for row in range(ROWS):
        points[row, 0] = (LENGTH * row / (ROWS - 1), 0, 0)
        points[row, 1] = (0, 1, 0)
        points[row, 2] = (0, 0, 1)
        for column in range(1, COLUMNS + 1):
            step = 0.01 * column
            points[row, 2 + column] = points[row, 0] + (step, step, 0)
            points[row, 2 + COLUMNS + column] = points[row, 0] + (step, -step, 0)
    return points


def surface() -> Surface:
    """5 vane points a row (trailing end to leading end) and a square tube of 4 points a row."""
    vane_terms = [4 + COLUMNS, 3 + COLUMNS, 0, 3, 4]
    row, terms, weights, st = [], [], [], []
    for i in range(ROWS):
        for k, term in enumerate(vane_terms):
            row.append(i)
            terms.append((term, 0, 0))
            weights.append((1.0, 0.0, 0.0))
            st.append((k / 4, i / (ROWS - 1)))
        for across, up in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            row.append(i)
            terms.append((0, 1, 2))
            weights.append((1.0, RADIUS * across, RADIUS * up))
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
            add(low + a, high + a, low + b, RACHIS, (1, 0, 0))
            add(low + b, high + a, high + b, RACHIS, (1, 0, 0))
    result = Surface(
        np.array(row), np.array(terms), np.array(weights), np.array(triangles), np.array(part),
        np.array(direction, dtype=float), np.array(st),
    )  # fmt: skip
    return _outward(result)


def _outward(given: Surface) -> Surface:
    """Vanes face dorsal (z), the tube faces away from its axis."""
    points = given.points(material_points())
    triangles = given.triangles.copy()
    for index, (a, b, c) in enumerate(given.triangles):
        normal = np.cross(points[b] - points[a], points[c] - points[a])
        centre = points[[a, b, c]].mean(axis=0)
        wanted = (0, *centre[1:]) if given.part[index] == RACHIS else (0, 0, 1)
        if normal @ np.array(wanted) < 0:
            triangles[index] = (a, c, b)
    return Surface(
        given.row, given.terms, given.weights, triangles, given.part, given.barb_direction,
        given.st,
    )  # fmt: skip


def feather() -> Feather:
    barbs = np.full((2, ROWS), 0.01 * COLUMNS * 2**0.5)
    return Feather(
        points=material_points(),
        station=np.linspace(0, LENGTH, ROWS),
        width=np.full(ROWS, 2 * RADIUS),
        height=np.full(ROWS, 2 * RADIUS),
        barb_length=barbs,
        barb_span=np.full((2, ROWS), LENGTH / ROWS),
        cell=np.ones((2, ROWS - 1, COLUMNS, 2), dtype=bool),
        surface=surface(),
    )


def placed(offset: tuple[float, float, float], angle: float = 0.0) -> np.ndarray:
    """Material points turned about y and moved; directors turn only."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    points = material_points() @ turn.T
    points[:, [0, *range(3, 3 + 2 * COLUMNS)]] += offset
    return points


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
    points = tuple(placed(o, a) for o, a in zip(offsets, angles, strict=True))
    turned = (placed((0, 0, 0), a + np.pi / 2) for a in angles)
    # d/dangle of a turn about y is the turned (x, z) plane; y does not move.
    velocities = tuple(t * (1, 0, 1) * r for t, r in zip(turned, rates, strict=True))
    return Frame(number, time, points, velocities)
