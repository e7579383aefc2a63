"""Barbs of one vane at rest, traced on the flattened feather and carried onto the rachis.

A barb leaves its row's rachis point at the barb angle and turns at a constant rate, by `curl`
within the vane and by `camber` towards ventral over its whole length. Because the whole turning
is given, and not its rate, the end of a flat barb of any length lies on one ray from its root: the
chord, half a curl off the root's direction. Where that ray meets the outline gives the length
without iteration.

A barb is carried onto the curved shaft as a clamped barb would be: as a whole, in the frame of
its own row. That keeps the length and shape of every barb exactly (docs/barb_grid.md compares it
with bending the flattened vane along the shaft).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.curve import turn
from featherfx.feather.outline import distance_outside, outline_curve, ray_lengths
from featherfx.groom.types import BarbGuide, FeatherKind, VaneShape

Array = NDArray[np.float64]

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
    """(3, n) rad: barb angle, curl and camber at positions (n,), shares of the vane's length.

    Monotone cubic between guides, constant before the first and after the last.
    """
    values = np.radians([[g.angle, g.curl, g.camber] for g in guides])
    if len(guides) == 1:
        return np.repeat(values.T, len(position), axis=1)
    from scipy.interpolate import PchipInterpolator

    places = np.array([guide.position for guide in guides])
    clipped = np.clip(position, places[0], places[-1])
    return np.ascontiguousarray(PchipInterpolator(places, values)(clipped).T)


def trace_barbs(
    kind: FeatherKind, vane: VaneShape, station: Array, first_vane_row: int, columns: int
) -> tuple[Barbs, list[str]]:
    """Trace the barbs of one vane at the rows with the given stations (n,) m.

    Returns the barbs and what is wrong with them (messages with the position along the vane).
    """
    rows = len(station)
    if not vane.outline:
        return _place(np.zeros((3, rows)), np.zeros(rows), np.zeros(rows), columns), []
    vane_length = (1.0 - kind.calamus) * kind.length
    x = station - station[first_vane_row]
    angles = interpolate_guides(vane.guides, x / vane_length)
    curve = outline_curve(vane.outline) * [vane_length, kind.length]
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
    kept = (x >= 0.0) & ~backward & (arc_length >= SHORTEST_BARB * kind.length)
    barbs = _place(angles, np.where(kept, arc_length, 0.0), x, columns)
    messages += _bulges(barbs, curve, x / vane_length, kind.length)
    return barbs, messages


def _place(angles: Array, arc_length: Array, x: Array, columns: int) -> Barbs:
    angle, curl, camber = angles
    axis = np.zeros((len(angle), 3))
    axis[:, 2] = angle
    root_frame, _ = turn(axis)
    share = np.linspace(0.0, 1.0, columns + 1)
    along = arc_length[:, None, None] * share[:, None]
    bent, bent_tangent = turn(_outer(np.stack((0.0 * curl, camber, -curl), -1), share))
    _, flat_tangent = turn(_outer(np.stack((0.0 * curl, 0.0 * curl, -curl), -1), share))
    flat = np.einsum("nab,njb->nja", root_frame, along * flat_tangent)
    flat[..., 0] += x[:, None]
    return Barbs(
        arc_length=arc_length,
        local=np.einsum("nab,njb->nja", root_frame, along * bent_tangent),
        dorsal=np.einsum("nab,njb->nja", root_frame, bent[..., 2]),
        flat=flat,
    )


def _outer(vector: Array, share: Array) -> Array:
    """(n, 3), (m,) to (n, m, 3)."""
    return vector[:, None] * share[:, None]


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
