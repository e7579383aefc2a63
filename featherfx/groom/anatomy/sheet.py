"""Sheet of a folded wing: the surface, over a body or of its own, on which its feathers lie.

A folded wing is no board. Its plan, drawn in the plane of its bones, is laid on a sheet that has
one curvature across its feathers and one along them. Each feather touches it at its middle, as
hollow and as arched, so that feathers that lay on each other in the plan still do. Each carries
along how the sheet bends it; by how far the sheet stands off the shoulder goes with the body. An
open wing is flat at its shoulder, and comes to the sheet in proportion to its fold.

Over a body the sheet is that nearest to an envelope: ellipses, one in each section of the trunk, a
clearance off the skin. There the plan goes by Fermi's coordinates: u along the middle of the back,
v along geodesics from there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import frames_from, rotation_part, unit, vectors_to_frames

_STATIONS = 25  # sections of a trunk
_DEGREE = 3  # of their sizes along it
_REAR = -0.5  # of the trunk's length, the last of them, on the tail
_FRONT = 1.05  # of the trunk's length, from where on it is told no more
_FADE = 0.1  # of the trunk's length, over which it comes to that
_OUTSIDE = 70  # percentile of sections that it encloses
_THINNEST = 0.17  # of the trunk's length
_HIGH = 1.0  # of the way from its middle to a shoulder: necks are no part of it
_LOW = 0.3  # of the trunk's length, below its line: legs are no part of a section
_FLATTEST = 0.6  # of its breadth, that a section is high
_STEP = 0.01  # of the trunk's length, of a geodesic and between them
_ACROSS = 0.12  # of the trunk's length, beyond the middle of the back


@dataclass(frozen=True)
class Sheet:
    """A sheet under the plan of a wing.

    origin: (3,) m and axes: (3, 3), columns along the feathers, across to the outer ones and
    dorsal, of the plane that touches it there. bend: 1/m, across, up to edge: m, outwards.
    curvature: 1/m, along, of all shafts. shift: (3,) m, to there from where the bones have the
    plan.
    """

    origin: Array
    axes: Array
    bend: float
    edge: float
    curvature: float
    shift: Array

    def places(self, plan: Array) -> tuple[Array, Array]:
        """Points (N, 3) m and frames (N, 3, 3), along, across and dorsal, of a plan (N, 2) m."""
        x, y = plan.T
        inner, zero = np.minimum(y, self.edge), np.zeros_like(x)
        about = vectors_to_frames(np.stack([-self.bend * inner, zero, zero], axis=1))
        arcs = vectors_to_frames(np.stack([zero, self.curvature * x, zero], axis=1))
        wide, low = _arc(inner, self.bend)
        far, deep = _arc(x, self.curvature)
        local = np.stack([zero, wide, -low], axis=1) + (y - inner)[:, None] * about[:, :, 1]
        local = local + far[:, None] * about[:, :, 0] - deep[:, None] * about[:, :, 2]
        return self.origin + local @ self.axes.T, self.axes @ about @ arcs

    def plan(self, points: Array) -> Array:
        """(N, 3) m, of points (N, 3) m in the plane of the bones."""
        return np.asarray((points + self.shift - self.origin) @ self.axes)

    def lay(self, roots: Array, ways: Array, lengths: Array) -> tuple[Array, Array, Array]:
        """Return roots (N, 3) m, frames (N, 3, 3) and how far their middles are within
        its edge, (N,) m, of feathers that lie on it.

        roots: (N, 3) m in the plan, over which they are as high, as straight ways (N, 3). lengths:
        (N,) m.
        """
        half = 0.5 * lengths
        middles = self.plan(roots + half[:, None] * ways)
        points, frames = self.places(middles[:, :2])
        along = np.einsum("nij,nj->ni", frames[:, :, :2], ways @ self.axes[:, :2])
        about = np.zeros((len(half), 3))
        about[:, 1] = -self.curvature * half
        own = frames_from(along, frames[:, :, 2]) @ vectors_to_frames(about)
        forward, down = _arc(half, self.curvature)
        points = points + middles[:, 2:] * frames[:, :, 2]
        points = points - forward[:, None] * own[:, :, 0] + down[:, None] * own[:, :, 2]
        return points, own, self.edge - middles[:, 1]

    def mirrored(self, middle: Array, normal: Array) -> Sheet:
        """That of the other wing. middle: (3,) m, of the plane of symmetry. normal: (3,)."""
        flip = np.eye(3) - 2.0 * np.outer(normal, normal)
        origin = middle + flip @ (self.origin - middle)
        return replace(self, origin=origin, axes=flip @ self.axes, shift=flip @ self.shift)


def _arc(ways: Array, curvature: float) -> tuple[Array, Array]:
    """(N,) m each, forward and down, at ways (N,) m along an arc."""
    turned = curvature * ways
    down = 0.5 * ways * turned * np.sinc(0.5 * turned / np.pi) ** 2
    return ways * np.sinc(turned / np.pi), down


def nearest_sheet(trunk: Envelope, plan: Array, start: Array, angle: float) -> tuple[Sheet, Array]:
    """Find the sheet of the right wing nearest to an envelope.

    plan: (N, 2) m, places of its feathers. start: (2,) m, u and v of the plan's origin. angle:
    rad, from u to the plan's first axis. Returns the sheet, and where the plan's origin is on it.
    """
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    u, v = (plan @ turn.T + start).T
    onto = trunk.axes * (1.0, -1.0, 1.0)
    points = np.stack([each.ev(u, v) for each in trunk.net], axis=1)
    ways = [np.stack([each.ev(u, v, *d) for each in trunk.net], axis=1) for d in ((1, 0), (0, 1))]
    own = [turn[0, k] * ways[0] + turn[1, k] * ways[1] for k in range(2)]
    step, bends = 1e-3 * trunk.length, []
    for way in own:
        ends = [trunk.drawn(points + sign * step * way)[1] for sign in (-1.0, 1.0)]
        turned = ((ends[1] - ends[0]) * way).sum(axis=1) / (2.0 * step)
        bends.append(max(float((turned / (way * way).sum(axis=1)).mean()), 0.0))
    centre = plan.mean(axis=0)
    sheet = Sheet(np.zeros(3), np.eye(3), bends[1], np.inf, bends[0], np.zeros(3))
    local, laid = sheet.places(plan - centre)[0], points @ onto.T
    axes = rotation_part((laid - laid.mean(axis=0)).T @ (local - local.mean(axis=0)))
    origin = trunk.middle + laid.mean(axis=0) - axes @ local.mean(axis=0)
    return replace(sheet, origin=origin, axes=axes), -centre


@dataclass(frozen=True)
class Envelope:
    """Ellipses around a trunk: y = a sin t, z = h - b + b cos t, with parabolas of x.

    middle: (3,) m and axes: (3, 3) as of a body. sizes: (3, n) coefficients of a, h and b by powers
    of x over length, from the highest. length: m, of the trunk.
    """

    middle: Array
    axes: Array
    sizes: Array
    length: float

    def at(self, x: Array) -> Array:
        """(3, N) m, a, b and the height of the middle."""
        places = _FRONT - _FADE * np.logaddexp(0.0, (_FRONT - x / self.length) / _FADE)
        places = 2.0 * _REAR + _FADE * np.logaddexp(0.0, (places - 2.0 * _REAR) / _FADE)
        a, top, b = (np.polyval(each, places) for each in self.sizes)
        least, soft = _THINNEST * self.length, 0.3 * _THINNEST * self.length
        a, b = (least + soft * np.logaddexp(0.0, (each - least) / soft) for each in (a, b))
        return np.stack([a, b, top - b])

    @cached_property
    def net(self) -> tuple[Any, ...]:
        """Splines of x, y and z (m, in its own axes) by u, from the shoulders back, and v, to the
        left."""
        from scipy.interpolate import RectBivariateSpline

        step = _STEP * self.length
        back = np.arange(1.5 * self.length, -1.3 * self.length, -step)
        ridge, _ = self.drawn(np.stack([back, 0.0 * back, self.at(back)[1:].sum(axis=0)], axis=1))
        u = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(ridge, axis=0), axis=1)))
        u -= np.interp(-self.length, -back, u)
        v = np.arange(0.0, 0.9 * self.length, step)
        rows, points = [ridge], ridge
        ways = np.tile([0.0, 1.0, 0.0], (len(back), 1))
        for _ in v[1:]:
            points, normals = self.drawn(points + step * ways)
            ways = unit(ways - (ways * normals).sum(axis=1)[:, None] * normals)
            rows.append(points)
        half = np.stack(rows, axis=1)
        count = round(_ACROSS / _STEP)
        over = half[:, count:0:-1] * (1.0, -1.0, 1.0)
        whole = np.concatenate([over, half], axis=1)
        across = np.concatenate([-v[count:0:-1], v])
        return tuple(RectBivariateSpline(u, across, whole[:, :, k], kx=3, ky=3) for k in range(3))

    def drawn(self, points: Array) -> tuple[Array, Array]:
        """Points (N, 3), in its own axes, drawn onto it across the trunk, and its normals there."""
        a, b, c = self.at(points[:, 0])
        y, z = points[:, 1], points[:, 2] - c
        size = np.sqrt((y / a) ** 2 + (z / b) ** 2)
        on = np.stack([points[:, 0], y / size, z / size + c], axis=1)
        h = 1e-4 * self.length
        slopes = (self.at(points[:, 0] + h) - self.at(points[:, 0] - h)) / (2.0 * h)
        y, z = on[:, 1], on[:, 2] - c
        lean = -(y**2 / a**3) * slopes[0] - (z**2 / b**3) * slopes[1] - z / b**2 * slopes[2]
        return on, unit(np.stack([lean, y / a**2, z / b**2], axis=1))


def envelope_of(
    corners: Array, axes: Array, middle: Array, shoulder: Array, clearance: float
) -> Envelope:
    """Fit ellipses around a trunk from the root of its tail to its shoulders.

    corners: (T, 3, 3) m. middle, shoulder: (3,) m, the root and one of these. clearance: m, of all
    of it from the skin.
    """
    front, aside, _ = (shoulder - middle) @ axes
    grid = [(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]
    weights = np.array(grid) / 4.0
    points = (np.einsum("kc,tcx->tkx", weights, corners).reshape(-1, 3) - middle) @ axes
    points = points[(points[:, 2] > -_LOW * front) & (points[:, 2] < _HIGH * abs(aside))]
    points[:, 1] = np.abs(points[:, 1])
    stations = np.linspace(_REAR * front, front, _STATIONS)
    half = 0.75 * (stations[1] - stations[0])
    found, at = [], []
    for station in stations:
        y, z = points[np.abs(points[:, 0] - station) <= half][:, 1:].T
        if not len(y):
            continue
        a, top, oblique = y.max(), z.max(), ((y + z) / np.sqrt(2.0)).max()
        high = np.linspace(_FLATTEST, 1.2, 25) * a  # the one whose oblique support fits
        off = (top - high) / np.sqrt(2.0) + np.sqrt(0.5 * (a**2 + high**2)) - oblique
        found.append((a, top, high[np.abs(off).argmin()]))
        at.append(station / front)
    places, measured = np.array(at), np.array(found)
    measured[:, 1] = _arched(places, measured[:, 1])  # a back is straight or arched, never hollow
    sizes = np.polyfit(places, measured, _DEGREE)
    off = measured - np.stack([np.polyval(each, places) for each in sizes.T], axis=1)
    sizes[-1] += clearance + np.percentile(off, _OUTSIDE, axis=0) * (1.0, 1.0, 0.0)
    return Envelope(middle, axes, sizes.T, float(front))


def _arched(x: Array, y: Array) -> Array:
    """(N,) the least function over (x, y) that is nowhere hollow. x: (N,) ascending."""
    slopes = (y[None] - y[:, None]) / np.where(x[None] > x[:, None], x[None] - x[:, None], np.inf)
    found = y.copy()
    for k in range(1, len(x) - 1):
        chords = y[:k, None] + slopes[:k, k + 1 :] * (x[k] - x[:k, None])
        found[k] = max(y[k], chords.max())
    return found
