"""Colours of a feather as functions of its own coordinates.

Of a place on a vane, by the rest shape and row by row against the row's own frame,

    a   distance from the follicle along the rachis, to the foot of the place on it, m
    l   distance from the rachis, and that of the barb's end, m
    e   distance from the vane's edge along the barb, m
    c   l on the leading vane, -l on the trailing one, m

so that bars run straight across a feather whose barbs are oblique, or aslant by a + c tan(slant),
and spots are round. With d the distance from a pattern's middle and r its extent, both m, it covers
what is below it by

    strength * smooth((r - d) / (soft r) + 1/2),    smooth(x) = 3 x^2 - 2 x^3 within 0 and 1.

Colours are mixed as light, then filtered by pigments (groom/materials.py). What numbers look like
on a living bird is chosen by eye in presets.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import radians, tan

import numpy as np

from featherfx.algebra.interpolation import faded, linear_weights
from featherfx.algebra.types import Array
from featherfx.feather.types import LEADING, RACHIS_PART, TRAILING, BarbCurves, Feather, barb_slice
from featherfx.files.disk_cache import stable_number
from featherfx.groom.materials import (
    DEFAULT_PATTERN_SIZES,
    PIGMENTS,
    RACHIS_COLOUR,
    SHADING,
    VANE_COLOUR,
    Colour,
    Pattern,
    filtered,
    linear,
)
from featherfx.groom.types import FeatherKind

# of the vanes' colour, what a rachis without one of its own has; chosen by eye
_RACHIS_SHADE = 0.55


@dataclass(frozen=True)
class FeatherColours:
    """Linear colours of one feather: points (V, 3) of its mesh, rachis (3,), barbs (K, 3) of all
    points of its barbs, where these are drawn. shading, barb_shading: (V,), (K,) values by those
    names of SHADING that any feather of the groom has."""

    points: Array
    rachis: Array
    barbs: Array | None = None
    shading: Mapping[str, Array] = field(default_factory=dict)
    barb_shading: Mapping[str, Array] = field(default_factory=dict)


def colour_feather(
    kind: FeatherKind,
    feather: Feather,
    barbs: BarbCurves | None,
    id: str,
    shading: Sequence[str] = (),
) -> FeatherColours:
    """Colour a feather of a kind, at any size; id: by which its brightness varies. shading: names
    of SHADING that are wanted."""
    rachis, light = _rachis(kind.colour), brightness(kind.colour, id)
    # (V, 5) of the mesh's points, as of _row_places
    surface, columns = feather.surface, feather.columns
    side = np.where(surface.node > columns, TRAILING, LEADING)
    place = np.where(surface.node > columns, surface.node - columns, surface.node)
    points, values = _vane_colours(kind, np.asarray(_row_places(feather)[side, surface.row, place]))
    on_rachis = np.zeros(len(points), dtype=np.bool_)
    on_rachis[surface.triangles[surface.part == RACHIS_PART]] = True
    points[on_rachis] = rachis
    for name in (each for each in shading if each not in PIGMENTS):
        values[name][on_rachis] = 0.0
    found = FeatherColours(
        np.clip(light * points, 0, 1),
        np.clip(light * rachis, 0, 1),
        shading={name: values[name] for name in shading},
    )
    if barbs is not None:
        points, values = _vane_colours(kind, _barb_places(feather, barbs))
        found = replace(
            found,
            barbs=np.clip(light * points, 0, 1),
            barb_shading={name: values[name] for name in shading},
        )
    return found


def at_nodes(colours: FeatherColours, feather: Feather) -> Array:
    """(n, 1 + 2 m, 3) linear colours of a feather's nodes, from those of its mesh; of nodes without
    a point that of the rachis."""
    found = np.tile(colours.rachis, (feather.rows, 1 + 2 * feather.columns, 1))
    surface = feather.surface
    # of lips at one place the barb's own, which come first, count
    own = np.flatnonzero(surface.node > 0)[::-1]
    found[surface.row[own], surface.node[own]] = colours.points[own]
    return found


def charted(kind: FeatherKind, feather: Feather, across: Array, along: Array) -> Array:
    """(H, W, 3) linear colours of both vanes at texture coordinates, across (W,) and along (H,),
    of a kind whose feathers are equally bright."""
    grid = _row_places(feather)
    rows = linear_weights(feather.station / feather.station[-1], along)
    columns = linear_weights(np.linspace(0.0, 1.0, feather.columns + 1), np.abs(2.0 * across - 1.0))
    sides = [np.einsum("hn,wm,nmx->hwx", rows, columns, grid[k], optimize=True) for k in (0, 1)]
    places = np.where((across >= 0.5)[:, None], sides[LEADING], sides[TRAILING])
    return _vane_colours(kind, places.reshape(-1, 5))[0].reshape(*places.shape[:2], 3)


def uniform(kind: FeatherKind) -> FeatherKind:
    """The same kind, all of whose feathers are equally bright."""
    return replace(kind, colour=replace(kind.colour, brightness_variation=0.0))


def brightness(colour: Colour, id: str) -> float:
    """By a number that the id alone decides, evenly spread about 1 with the deviation `vary`."""
    fraction = stable_number(id) / 2.0**63
    return max(1.0 + colour.brightness_variation * 3.0**0.5 * (2.0 * fraction - 1.0), 0.0)


def _barb_places(feather: Feather, barbs: BarbCurves) -> Array:
    """(K, 5) of the points of barbs, as of _row_places."""
    along, places = np.linspace(0.0, 1.0, feather.columns + 1), _row_places(feather)
    found = np.zeros((*barbs.st.shape[:2], 5))
    for side in (LEADING, TRAILING):
        own = barbs.side == side
        rows = linear_weights(feather.station / feather.station[-1], barbs.st[own, 0, 1])
        columns = linear_weights(along, np.abs(2.0 * barbs.st[own][0, :, 0] - 1.0))
        found[own] = np.einsum("bn,km,nmx->bkx", rows, columns, places[side])
    return barbs.drawn(found.reshape(-1, 5))


def _row_places(feather: Feather) -> Array:
    """(2, n, m + 1, 5) a, l, that of the barb's end, e and c at the nodes of each vane, all over
    the length."""
    rest, columns, length = feather.rest, feather.columns, feather.station[-1]
    tangent = np.cross(rest.directors[:, 0], rest.directors[:, 1])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    found = np.zeros((2, feather.rows, columns + 1, 5))
    found[:, :, 0, 0] = feather.station
    for side in (LEADING, TRAILING):
        way = rest.nodes[:, barb_slice(side, columns)] - rest.nodes[:, :1]
        ahead = np.einsum("nmx,nx->nm", way, tangent)
        off = np.linalg.norm(way - ahead[..., None] * tangent[:, None], axis=2)
        found[side, :, 1:, 0] = feather.station[:, None] + ahead
        found[side, :, 1:, 1] = off
        found[side, :, :, 2] = off[:, -1:]
        inwards = np.linspace(1.0, 0.0, columns + 1)
        found[side, :, :, 3] = feather.barb_length[side][:, None] * inwards
        found[side, :, 1:, 4] = off if side == LEADING else -off
    return found / length


def _vane_colours(kind: FeatherKind, places: Array) -> tuple[Array, dict[str, Array]]:
    """(P, 3) linear colours at places (P, 5) of _row_places, and (P,) each of SHADING."""
    base = kind.colour.base
    found = np.tile(VANE_COLOUR if base is None else linear(np.array(base)), (len(places), 1))
    values = {name: np.full(len(places), getattr(kind.colour, name)) for name in SHADING}
    for pattern in kind.colour.patterns:
        cover = pattern.strength * _cover(pattern, kind.calamus, places)
        if pattern.colour is not None:
            found += cover[:, None] * (linear(np.array(pattern.colour)) - found)
        for name, value in values.items():
            own = getattr(pattern, name)
            if own is not None:  # between two films is none, which would have another colour
                value += (cover > 0.5 if name == "film" else cover) * (own - value)
    present = set(PIGMENTS).intersection(kind.colour.shading)
    return filtered(found, {name: values[name] for name in present}), values


def _rachis(colour: Colour) -> Array:
    if colour.rachis is not None:
        return linear(np.array(colour.rachis))
    own = np.array(
        RACHIS_COLOUR if colour.base is None else _RACHIS_SHADE * linear(np.array(colour.base))
    )
    amounts = {name: np.array([getattr(colour, name)]) for name in PIGMENTS}
    return filtered(own[None], amounts)[0]


def _cover(pattern: Pattern, calamus: float, places: Array) -> Array:
    """(P,) how far a pattern covers places, without its strength."""
    along, off, reach, inwards, beside = places.T
    start, end = (calamus + (1.0 - calamus) * each for each in (pattern.start, pattern.end))
    spacing = (end - start) / pattern.count
    middle = _nearest_middle(along, start, spacing, pattern.count)
    size = DEFAULT_PATTERN_SIZES.get(pattern.kind, 0.0) if pattern.size is None else pattern.size
    match pattern.kind:
        case "gradient":
            return faded((along - start) / (end - start))
        case "bars":
            along = along - tan(radians(pattern.slant)) * beside
            middle = _nearest_middle(along, start, spacing, pattern.count)
            distance, size = np.abs(along - middle), 0.5 * size * spacing
        case "spots":
            distance = np.hypot(along - middle, off - 0.5 * reach)
        case "eye":
            distance = np.hypot(along - 0.5 * (start + end), off)
        case "fringe":
            distance = np.where((along >= start) & (along <= end), inwards, np.inf)
        case _:
            distance = np.where((along >= start) & (along <= end), off, np.inf)
    width = max(pattern.soft * size, 1e-9)
    return faded((size - distance) / width + 0.5)


def _nearest_middle(along: Array, start: float, spacing: float, count: int) -> Array:
    nearest = np.clip(np.round((along - start) / spacing - 0.5), 0, count - 1)
    return np.asarray(start + (nearest + 0.5) * spacing)
