"""Figures that change along the shaft and along the barbs, as factors place by place."""

from __future__ import annotations

import numpy as np

from featherfx.feather.types import Array, Feather
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
    shaft, barb = middles(kind, feather)
    return np.outer(at_places(profile.rachis, shaft), at_places(profile.barb, barb))[..., None]


def barb_bending(vane: VaneMaterial, places: Array) -> Array:
    """(K,) factors of the bending of barbs at places (K,) from their roots."""
    thick = at_places(vane.thickness_profile.barb, places)
    return np.asarray(at_places(vane.along_barbs_profile.barb, places) * thick**3)
