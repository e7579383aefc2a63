"""The rachis at rest, profiles along it and along barbs, and the fraction of hooked barbules.

What a strip between two rows has of the stiffness of a whole one is not the share in its middle.
The barbs that it stands for hang one on the next, so compliances add up: over a strip from a to b

    share = (b - a) / integral ds / h(s),    h the share along the rachis,

and where some of them are loose, the next row hangs on nothing, however wide the strip is. Along a
barb stiffnesses add up, and the middle of a triangle tells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from featherfx.feather.types import Array, Feather
from featherfx.groom.course import shaft
from featherfx.groom.materials import Curve, Profile, VaneMaterial
from featherfx.groom.types import FeatherKind


def at_places(curve: Curve, places: Array) -> Array:
    """(K,) values at places (K,), straight between its points and constant beyond; 1 without."""
    return np.interp(places, *np.transpose(curve)) if curve else np.ones(len(places))


def vane_shares(kind: FeatherKind, station: Array) -> Array:
    """(K,) shares of the vane's length, negative on the calamus. station: (K,) m, up to the tip."""
    base = kind.calamus * station[-1]
    return np.asarray((station - base) / (station[-1] - base))


def middles(kind: FeatherKind, feather: Feather) -> tuple[Array, Array]:
    """(n-1,) shares of the vane's length, and (m,) of the barbs, in the middle of the cells."""
    shares = vane_shares(kind, feather.station)
    along_barb = (np.arange(feather.columns) + 0.5) / feather.columns
    return 0.5 * (shares[1:] + shares[:-1]), along_barb


def in_cells(profile: Profile, kind: FeatherKind, feather: Feather) -> Array:
    """(n-1, m, 1) factors of a profile in the middle of each cell."""
    rachis, barb = middles(kind, feather)
    return np.outer(at_places(profile.rachis, rachis), at_places(profile.barb, barb))[..., None]


def barb_bending(vane: VaneMaterial, places: Array) -> Array:
    """(K,) factors of the bending of barbs at places (K,) from their roots."""
    thick = at_places(vane.thickness_profile.barb, places)
    return np.asarray(at_places(vane.along_barbs_profile.barb, places) * thick**3)


# shares are not less along the rachis, so that loose barbs are compliant, not apart; what is left
# of a strip then counts as nothing below this
_MIN_FRACTION, _NOTHING = 1e-6, 1e-4


def hooked_fraction(kind: FeatherKind, feather: Feather) -> Array:
    """(2, n-1, m, 2) share of hooked barbules, 0 to 1, in the middle of each triangle.

    feather: of that kind, at any size.
    """
    along_rachis, along_barb = middles(kind, feather)
    sides = [
        np.outer(
            at_places(each.hooked.rachis, along_rachis), at_places(each.hooked.barb, along_barb)
        )
        for each in (kind.leading, kind.trailing)
    ]
    return np.repeat(np.stack(sides)[..., None], 2, axis=3)


def hooked_stiffness(kind: FeatherKind, feather: Feather) -> Array:
    """(2, n-1, m, 2) what is hooked has of each triangle's stiffness, 0 to 1."""
    ends, (_, along_barb) = vane_shares(kind, feather.station), middles(kind, feather)
    sides = [
        np.outer(in_series(each.hooked.rachis, ends), at_places(each.hooked.barb, along_barb))
        for each in (kind.leading, kind.trailing)
    ]
    return np.repeat(np.stack(sides)[..., None], 2, axis=3)


def in_series(curve: Curve, ends: Array) -> Array:
    """(n-1,) shares of the strips between places (n,), of what hangs one on the next."""
    if not curve:
        return np.ones(len(ends) - 1)
    corners = np.array([place for place, _ in curve])
    inside = (corners > ends[0]) & (corners < ends[-1])
    places = np.unique(np.concatenate([ends, corners[inside]]))
    share = np.maximum(at_places(curve, places), _MIN_FRACTION)
    low, high = np.minimum(share[1:], share[:-1]), np.maximum(share[1:], share[:-1])
    rise = high / low - 1.0
    # of 1 / h where h is linear
    mean = np.divide(np.log1p(rise), rise, out=np.ones_like(rise), where=rise > 0.0) / low
    strip = np.searchsorted(ends, places[:-1], side="right") - 1
    compliance = np.bincount(strip, np.diff(places) * mean, minlength=len(ends) - 1)
    found = np.diff(ends) / compliance
    return np.where(found < _NOTHING, 0.0, found)


# A barb's stiffness is floored at 5 % of its root's, and goes with its diameter to the fourth.
_THINNEST = 0.05**0.25


def barb_diameters(kind: FeatherKind, along: Array) -> Array:
    """(K,) m, diameters of a barb at places (K,) from 0, its root, to 1."""
    material = kind.vane_material
    thinning = np.maximum((1.0 - along) ** (0.25 * material.barb_taper), _THINNEST)
    thick = at_places(material.thickness_profile.barb, along)
    return np.asarray(material.thickness * thinning * thick)


@dataclass(frozen=True)
class Rachis:
    """The rachis sampled at n rows.

    station: (n,) m, arc length. position: (n, 3) m. frame: (n, 3, 3), columns d1, d2, d3.
    width, height: (n,) m, outer section along d2 and d3.
    first_vane_row: the row at which calamus and vane meet.
    """

    station: Array
    position: Array
    frame: Array
    width: Array
    height: Array
    first_vane_row: int


def row_stations(length: float, calamus: float, rows: int) -> tuple[Array, int]:
    """(rows,) m, near-equal arc lengths of the rows, and the row where the vane begins.

    A row falls exactly on the end of the calamus; calamus and vane are each divided equally, with
    rows in proportion to their lengths as nearly as possible (each at least one segment).
    """
    bare = min(max(round(calamus * (rows - 1)), 1), rows - 2) if calamus > 0.0 else 0
    end = calamus * length
    below = np.linspace(0.0, end, bare + 1)
    above = np.linspace(end, length, rows - bare)
    return np.concatenate((below[:-1], above)), bare


def build_rachis(kind: FeatherKind, rows: int) -> Rachis:
    """Sample the rachis of a kind at near-equal arc lengths; rows >= 3."""
    shape = kind.rachis
    station, first_vane_row = row_stations(kind.length, kind.calamus, rows)
    along = station / kind.length
    frame, mean_tangent = shaft(shape, along)
    difference = shape.diameter_base - shape.diameter_tip
    width = shape.diameter_tip + difference * (1.0 - along) ** shape.taper
    width = width * at_places(shape.diameter_profile, along)
    return Rachis(
        station=station,
        position=station[:, None] * mean_tangent,
        frame=frame,
        width=width,
        height=kind.rachis_material.flattening * width,
        first_vane_row=first_vane_row,
    )


def held_by_hooks(kind: FeatherKind, feather: Feather, static: bool) -> Array | None:
    """(T,) share of hooked barbules at each triangle; None where all are hooked.

    static: whether splits stay open.
    """
    loose = any((*vane.hooked.rachis, *vane.hooked.barb) for vane in (kind.leading, kind.trailing))
    split = static and feather.split.size > 0
    if not loose and not split:
        return None
    fractions = hooked_fraction(kind, feather)
    if split:
        fractions = np.where(feather.split, 0.0, fractions)
    return on_faces(feather, fractions)


def on_faces(feather: Feather, values: Array) -> Array:
    """(T,) what cells (2, n-1, m, 2) have; 1 on the shaft."""
    faces = np.ones(len(feather.surface.triangles))
    # faces of vanes come first, in the order of cells
    faces[: np.count_nonzero(feather.cell)] = values[feather.cell]
    return faces
