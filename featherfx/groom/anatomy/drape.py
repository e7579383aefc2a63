"""A folded wing over a body: its plan comes to the middle of the back, on a sheet off the skin.

Tertials, secondaries and the hand lie on each other in the plan. Where that goes follows from where
its inner edge and the tip of its longest primary shall be; the bones go along with the feathers.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import from_rotation_vector
from featherfx.groom.anatomy.remiges import Remiges, folded, frames_at, lying, plan_axes, remiges_of
from featherfx.groom.anatomy.sheet import Sheet, envelope_of, nearest_sheet
from featherfx.groom.keys.anatomy import WingType
from featherfx.groom.skin.skin import Body

_ALONG = np.linspace(0.0, 1.0, 6)  # of shafts, places that are told
_NEAREST = 7.0  # percentile of places of shafts that are as near as the clearance
_NEAR = 0.06  # of the longest feather, up to which a wing leaves no room for feathers below
_INNER = np.array([0.25, 0.5, 0.7, 0.85])  # of a shaft, beside which its inner edge is told
_AHEAD = 0.03  # of the longest feather, of a folded shoulder before its landmark; by eye
_EDGE = 0.2  # of a feather's length, from its shaft to the edge of its inner vane
_MAX_ANGLE = 40.0  # deg, by which the plan is turned on its sheet
_MISS = 0.05  # of the longest feather, by which a folded wing misses what its type asks for unsaid
_TRIES = 8  # in which its ends come to where they shall be, half of the way each


def lie_on(
    kind: WingType, shoulder: Array, scale: float, body: Body, below: float
) -> tuple[WingType, Sheet, list[str]]:
    """The type as its right folded wing lies on a body, the sheet that bears it, and what it misses
    of its type.

    below: m, that coverts below its flight feathers take up.
    """
    lengths = scale * np.array([kind.humerus, kind.forearm, kind.hand])
    bones = folded(kind, shoulder, lengths, body.axes, False, 1.0)
    remiges, longest = remiges_of(kind, bones, scale), scale * max(kind.primaries.lengths)
    shafts = frames_at(bones, remiges.angles)[:, :, 0]
    axes, origin = plan_axes(bones, remiges, shafts), remiges.roots[0]
    roots, ways = (remiges.roots - origin) @ axes, shafts @ axes
    clearance = below + kind.body_clearance * longest
    trunk = envelope_of(body.corners, body.axes, body.middle, shoulder, clearance)
    hinge = (shoulder - origin) @ axes
    plan = roots[:, None] + np.multiply.outer(remiges.lengths, _ALONG)[:, :, None] * ways[:, None]
    plan = plan.reshape(-1, 3)[:, :2]
    edges, tip = _ends(remiges, roots, ways)
    wanted = longest * np.array([kind.back_gap, kind.tip_gap])
    aside = wanted.copy()
    for _ in range(_TRIES):
        v, angle = _place(edges, tip, aside)
        u = np.sin(angle) * hinge[1] - np.cos(angle) * hinge[0] - _AHEAD * longest
        sheet, start = nearest_sheet(trunk, plan, np.array([u, v]), angle)
        for _ in range(_TRIES):
            sheet = _settled(sheet, plan + start, body, clearance)
        ends = sheet.places(np.vstack([edges, tip]) + start)[0]
        away = (body.middle - ends) @ body.axes[:, 1]
        found = np.array([away[:-1].min(), away[-1]])
        aside += 0.5 * (wanted - found)
    gaps = body.gaps(sheet.places(plan + start)[0])
    reached = np.append(found, np.percentile(gaps, _NEAREST) - below) / longest
    misses = [
        f"{key} = {reached[k]:.2f}, not {getattr(kind, key):.3g}"
        for k, key in enumerate(("back_gap", "tip_gap", "body_clearance"))
        if abs(reached[k] - getattr(kind, key)) > _MISS
    ]
    # the plane of the bones goes along with its feathers
    camber = float(np.degrees(sheet.curvature * longest))
    hung = _hung(replace(kind, camber=camber), sheet.axes @ axes.T @ bones.frames[0], body.axes)
    place = sheet.origin + sheet.axes @ (hinge + np.append(start, 0.0))
    return hung, replace(sheet, shift=place - shoulder), misses


def _settled(sheet: Sheet, plan: Array, body: Body, clearance: float) -> Sheet:
    """A sheet lifted and pitched so that both halves of a plan (N, 2) m come nearer to a clearance,
    m."""
    gaps, x = body.gaps(sheet.places(plan)[0]), plan[:, 0]
    ahead = x < np.median(x)
    # half of the way, since tips move more than the middle of the rear
    front, rear = (
        0.5 * (clearance - np.percentile(gaps[own], _NEAREST)) for own in (ahead, ~ahead)
    )
    middle = x[ahead].mean(), x[~ahead].mean()
    pitch = (rear - front) / (middle[1] - middle[0])
    turn = from_rotation_vector(np.array([0.0, -pitch, 0.0]))
    lift = (front - pitch * middle[0]) * sheet.axes[:, 2]
    return replace(sheet, origin=sheet.origin + lift, axes=sheet.axes @ turn)


def _ends(remiges: Remiges, roots: Array, ways: Array) -> tuple[Array, Array]:
    """(K, 2) m, places of the inner vanes of a folded arm, and (2,) m, the tip of the longest
    primary. roots, ways: (N, 3) in the plan."""
    inner = np.stack([ways[:, 1], -ways[:, 0]], axis=1)
    stations = _INNER[:, None] * ways[:, None, :2] + _EDGE * inner[:, None]
    edges = roots[:, None, :2] + remiges.lengths[:, None, None] * stations
    tips = roots + remiges.lengths[:, None] * ways
    return edges[remiges.bone < 2].reshape(-1, 2), tips[remiges.lengths.argmax(), :2]


def _place(edges: Array, tip: Array, aside: Array) -> tuple[float, float]:
    """Find the place of a wing's plan on its sheet: v (m) of its origin, and its turn, rad.

    aside: (2,) m, v of the innermost of edges (K, 2) and of the tip (2,).
    """

    def apart(angle: float) -> float:
        lean = np.array([np.sin(angle), np.cos(angle)])
        return float(tip @ lean - (edges @ lean).min() - (aside[1] - aside[0]))

    low, high = np.radians(-_MAX_ANGLE), np.radians(_MAX_ANGLE)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if apart(middle) > 0.0 else (middle, high)
    lean = np.array([np.sin(low), np.cos(low)])
    return float(aside[0] - (edges @ lean).min()), float(low)


def _hung(kind: WingType, arm: Array, axes: Array) -> WingType:
    """The type with the folded upper arm of the right wing in a frame (3, 3). axes: (3, 3)."""
    forward, sideways, up = arm[:, 2] @ axes
    roof = np.arctan2(np.hypot(forward, sideways), up)
    tuck = np.arctan2(-forward, -sideways)
    ahead = np.cos(tuck) * axes[:, 0] - np.sin(tuck) * axes[:, 1]
    outwards = np.cross(ahead, arm[:, 2])
    back = np.arctan2(-arm[:, 0] @ ahead, arm[:, 0] @ outwards)
    roof, tuck, back = np.degrees([roof, tuck, back]).tolist()
    return replace(
        kind,
        roof=(kind.roof[0], roof),
        tuck=(kind.tuck[0], tuck),
        shoulder=(kind.shoulder[0], back),
    )


class Beneath(NamedTuple):
    """Places of a folded wing, (K, 3) m each. well: within its outline, near the body. front: of
    its leading edge. low: of its lower edge, near the body."""

    well: Array
    front: Array
    low: Array


def beneath(
    kind: WingType, shoulder: Array, scale: float, body: Body, left: bool, sheet: Sheet | None
) -> Beneath:
    """Find the part of a body that a folded wing hides, by places of it."""
    lengths = scale * np.array([kind.humerus, kind.forearm, kind.hand])
    bones = folded(kind, shoulder, lengths, body.axes, left, 1.0)
    points = lying(kind, bones, scale, sheet)
    arm = len(points) - kind.primaries.count
    near = _NEAR * scale * max(kind.primaries.lengths)

    def close(places: Array, gap: float) -> Array:
        flat = places.reshape(-1, 3)
        return np.asarray(flat[body.gaps(flat) < gap])

    low = points[[arm - 1, len(points) - 1], 1:6] - 1.5 * near * body.axes[:, 2]
    return Beneath(close(points[:arm, 2:5], 2.0 * near), points[:arm, 0], close(low, 4.0 * near))
