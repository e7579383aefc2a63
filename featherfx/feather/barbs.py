"""Barbs of one vane at rest, traced on the flattened feather and carried onto the rachis.

A barb leaves its row's rachis point at the barb angle and turns at a constant rate, by `curl`
within the vane and by `camber` towards ventral over its whole length. Because the whole turning
is given, and not its rate, the end of a flat barb of any length lies on one ray from its root: the
chord, half a curl off the root's direction. Where that ray meets the outline gives the length
without iteration. The outline near a vane's base is steeper than barbs are, so the first ones
would cut it off in a straight edge; where the base is rounded they grow to the outline instead, as
a quarter of an ellipse of the way.

A barb is carried onto the curved shaft by turning it, on top of its own curl and camber, as much
as the shaft turns over the stretch that the flat barb reaches forward. Its length and its angle at
the root stay exact, and the vane follows camber, sweep and twist of the shaft without being
squeezed or folded (docs/barb_grid.md compares three ways).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from featherfx.algebra.monotone import monotone
from featherfx.feather.outline import (
    distance_outside,
    opening,
    outline_curve,
    ray_lengths,
)
from featherfx.feather.rachis import Rachis
from featherfx.feather.splits import splay, strips_of
from featherfx.feather.types import LEADING, Array
from featherfx.groom.course import turn, turned
from featherfx.groom.splits import Split
from featherfx.groom.types import BarbGuide, FeatherKind

# Shares of the feather's length: shorter barbs are dropped, and this much of a barb may bulge
# over the outline between its root and its end.
SHORTEST_BARB = 1e-3
_LARGEST_BULGE = 0.02


@dataclass(frozen=True)
class Barbs:
    """Barbs of one vane at n rows, m segments each, as if the vane were the leading one.

    arc_length: (n,) m, zero where there is no barb.
    local: (n, m + 1, 3) m, nodes in the frame of their own row, root first.
    dorsal: (n, m + 1, 3) unit, the vane's upper side at the nodes, in the same frame.
    flat: (n, m + 1, 3) m, nodes on the flattened feather, x from the end of the calamus.
    """

    arc_length: Array
    local: Array
    dorsal: Array
    flat: Array


def interpolate_guides(guides: tuple[BarbGuide, ...], position: Array) -> Array:
    """(3, n) rad: barb angle, curl and camber at positions (n,), 0 to 1 along the vane.

    Monotone cubic between guides, constant before the first and after the last.
    """
    values = np.radians([[g.angle, g.curl, g.camber] for g in guides])
    if len(guides) == 1:
        return np.repeat(values.T, len(position), axis=1)
    places = np.array([guide.position for guide in guides])
    clipped = np.clip(position, places[0], places[-1])
    return np.ascontiguousarray(monotone(places, values, clipped).T)


def trace_barbs(
    kind: FeatherKind, side: int, rachis: Rachis, columns: int, splits: Sequence[Split]
) -> tuple[Barbs, list[str]]:
    """Trace the barbs of one vane (LEADING or TRAILING) at the rows of the rachis.

    splits: beside which the barbs give way. Returns the barbs and what is wrong with them (messages
    with the position along the vane).
    """
    vane = kind.leading if side == LEADING else kind.trailing
    # The trailing vane is traced as its mirror image, in which rotations in y alone keep sign.
    signs = np.array([1.0, 1.0, 1.0] if side == LEADING else [-1.0, 1.0, -1.0])
    x = rachis.station - rachis.station[rachis.first_vane_row]

    def turning(way: Array) -> Array:
        return signs * turned(kind.rachis, rachis.station / kind.length, way / kind.length)

    if not vane.outline:
        return _place(np.zeros((3, len(x))), np.zeros(len(x)), x, turning, columns), []
    vane_length = (1.0 - kind.calamus) * kind.length
    angles = interpolate_guides(vane.guides, x / vane_length)
    curve = outline_curve(vane.outline, vane.rounded_tip) * [vane_length, kind.length]
    if splits:
        angles[1] += _splay(kind, splits, x, angles, curve)
    chord_angle = angles[0] - 0.5 * angles[1]
    backward = (np.sin(chord_angle) <= 0.0) & (x >= 0.0)
    messages = [
        f"barbs turn back across the rachis at position {x[i] / vane_length:.3g}: "
        f"angle {np.degrees(angles[0, i]):g} deg, curl {np.degrees(angles[1, i]):g} deg; "
        "allowed: 0 < angle - curl / 2 < 180 deg"
        for i in np.flatnonzero(backward)[:1]
    ]
    chord = ray_lengths(curve, x, chord_angle, 1e-9 * kind.length)
    arc_length = chord / np.sinc(angles[1] / (2.0 * np.pi))
    if vane.rounded_base > 0.0:
        begin = max(vane.outline[0][0], 0.0)
        arc_length = arc_length * opening((x / vane_length - begin) / vane.rounded_base)
    kept = (x >= 0.0) & ~backward & (arc_length >= SHORTEST_BARB * kind.length)
    barbs = _place(angles, np.where(kept, arc_length, 0.0), x, turning, columns)
    return barbs, messages + _bulges(barbs, curve, x / vane_length, kind.length)


def _splay(
    kind: FeatherKind, splits: Sequence[Split], x: Array, angles: Array, curve: Array
) -> Array:
    """(n,) rad, curl that splits add to barbs with roots at x (n,) m; angles: as in _place."""
    straight = angles[0] - 0.5 * angles[1]
    length = ray_lengths(curve, x, straight, 1e-9 * kind.length)
    grown = (x >= 0.0) & (length >= SHORTEST_BARB * kind.length)
    strips = strips_of(splits, x / ((1.0 - kind.calamus) * kind.length), grown)
    across = np.concatenate(([0.0], np.cumsum(np.diff(x) * np.sin(straight[1:]))))
    return splay(strips, across, np.where(grown, length, 0.0), kind.length)


def without_barb(barbs: Barbs, row: int) -> Barbs:
    """The same barbs with the one of a row shrunk to its root."""
    arc_length, local, flat = barbs.arc_length.copy(), barbs.local.copy(), barbs.flat.copy()
    arc_length[row], local[row], flat[row] = 0.0, 0.0, flat[row, 0]
    return replace(barbs, arc_length=arc_length, local=local, flat=flat)


def _place(
    angles: Array,
    arc_length: Array,
    x: Array,
    turning: Callable[[Array], Array],
    columns: int,
) -> Barbs:
    """Barbs from their angles (3, n) rad, lengths (n,) m and roots (n,) m.

    turning: (n, 3) rad that the shaft turns by from the roots on over ways (n,) m.
    """
    angle, curl, camber = angles
    none = np.zeros_like(angle)
    root_frame, _ = turn(np.stack((none, none, angle), axis=-1))
    along = np.linspace(0.0, 1.0, columns + 1)[:, None]
    arc = arc_length[:, None, None] * along
    _, tangent = turn(np.stack((none, none, -curl), axis=-1)[:, None] * along)
    flat = np.einsum("nab,njb->nja", root_frame, arc * tangent)
    forward = flat[:, -1, 0]
    followed = np.einsum("nba,nb->na", root_frame, turning(forward))
    bent, tangent = turn((np.stack((none, camber, -curl), axis=-1) + followed)[:, None] * along)
    flat[..., 0] += x[:, None]
    return Barbs(
        arc_length=arc_length,
        local=np.einsum("nab,njb->nja", root_frame, arc * tangent),
        dorsal=np.einsum("nab,njb->nja", root_frame, bent[..., 2]),
        flat=flat,
    )


def _bulges(barbs: Barbs, curve: Array, position: Array, length: float) -> list[str]:
    """A message for the barb that bulges farthest over the outline, if it does so visibly."""
    grown = np.flatnonzero(barbs.arc_length > 0.0)
    inner = barbs.flat[grown, 1:-1, :2]
    if inner.size == 0:
        return []
    outside = distance_outside(curve, inner.reshape(-1, 2)).reshape(inner.shape[:2]).max(axis=1)
    worst = int(np.argmax(outside))
    if outside[worst] <= _LARGEST_BULGE * length:
        return []
    return [
        f"the barb at position {position[grown[worst]]:.3g} leaves the outline by "
        f"{outside[worst] / length:.3g} of the feather's length; allowed: {_LARGEST_BULGE:g}"
    ]
