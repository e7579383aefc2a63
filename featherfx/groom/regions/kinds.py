"""The kinds of a region: one, or several that mix by shares and maps.

Feathers on a curved skin: how far it falls off beneath them, and turns that lay them along it.

A feather bends about two axes at most, a skin also twists beneath it: feathers that stand by the
skin at their roots alone are askew on a neck, by 14 deg one way or the other in a tenth of the
pigeon's. So each is raised and rolled by the least squares over some of its places (linearised,
those far off counting less: Huber 1964).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots, unit, vectors_to_frames
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.presets.library import sourced
from featherfx.groom.presets.presets import KindChoice, KindStore
from featherfx.groom.regions.rules import GroomSkin, Rule, presence
from featherfx.groom.regions.scatter import hashed, uniform
from featherfx.groom.skin.points import SkinSurface, SurfacePoints
from featherfx.groom.types import FeatherKind

# a skin that falls off further is not followed
_MAX_TURNING = 45.0  # deg
# in feather lengths, of a contour feather's middle barbs: where one begins on the shaft, its way
# forward and to the side
BARB_SAMPLE_ROW, _BARB = 0.3, (0.3, 0.25)
# places along the shaft and to its sides, in feather lengths
_PLACES = np.array(
    [(0.3, 0.0), (0.6, 0.0), (0.9, 0.0), (0.5, 0.2), (0.5, -0.2), (0.8, 0.2), (0.8, -0.2)]
)
_FAR = 0.1  # of a feather's length, from which on a place counts less
_MAX_LAID = np.radians(20.0)
_ROUNDS = 3


class SkinBends(NamedTuple):
    """Bends of feathers on a skin, (N,) deg. along: rachis to the tip. across: barbs."""

    along: Array
    across: Array


def bends_of_skin(points: SurfacePoints, direction: Array, length: Array) -> SkinBends:
    """Measure how a skin falls off beneath feathers, from root to tip and from rachis to edge.

    At least 0. Where the skin ends before the tip does, what the first half shows counts.
    direction: (N, 3) unit. length: (N,) m.
    """
    surface = points.surface
    half = _fall(surface, points.position, points.normal, 0.5 * length[:, None] * direction)
    whole = _fall(surface, points.position, points.normal, length[:, None] * direction)
    start = points.position + BARB_SAMPLE_ROW * length[:, None] * direction
    normal = surface.normals_near(start)
    forward, side = _BARB
    aside = side * np.cross(points.normal, direction)
    ways = [length[:, None] * (forward * direction + sign * aside) for sign in (1.0, -1.0)]
    across = 0.5 * sum(_fall(surface, start, normal, way) for way in ways)
    return SkinBends(np.minimum(whole, 2.0 * half), np.asarray(across))


def _fall(surface: SkinSurface, start: Array, normal: Array, way: Array) -> Array:
    """(N,) deg, by which the skin's normal leans towards a way (N, 3) m, at its end."""
    ends = surface.normals_near(start + way)
    ahead = dots(ends, unit(way - dots(way, normal)[:, None] * normal))
    return np.clip(np.degrees(np.arctan2(ahead, dots(ends, normal))), 0.0, _MAX_TURNING)


def laid_along(
    points: SurfacePoints, rotations: Array, length: Array, tilt: Array, bends: SkinBends
) -> Array:
    """Frames (N, 3, 3) of feathers, raised and rolled to lie at a tilt (N,) deg to the skin all
    along. length: (N,) m."""
    local = _shape(bends)
    wanted = local[:, :, 0] * np.sin(np.radians(tilt))[:, None]
    for _ in range(_ROUNDS):
        world = points.position[:, None] + length[:, None, None] * np.einsum(
            "nij,nkj->nki", rotations, local
        )
        heights = points.surface.heights_near(world.reshape(-1, 3)).reshape(wanted.shape)
        astray = heights / length[:, None] - wanted
        weights = _FAR / np.maximum(np.abs(astray), _FAR)
        sides = local[:, :, :2]
        normal_matrix = np.einsum("nk,nki,nkj->nij", weights, sides, sides)
        pulls = -np.einsum("nk,nki,nk->ni", weights, sides, astray)
        raised, rolled = np.linalg.solve(normal_matrix, pulls[:, :, None])[:, :, 0].T
        turns = np.stack([rolled, -raised, np.zeros(len(raised))], axis=1)
        size = np.maximum(np.linalg.norm(turns, axis=1, keepdims=True), _MAX_LAID)
        rotations = rotations @ vectors_to_frames(turns * _MAX_LAID / size)
    return rotations


def _shape(bends: SkinBends) -> Array:
    """(N, K, 3) places of feathers whose shafts and barbs are arcs, in lengths, in their frames."""
    x, y = _PLACES.T
    along = np.radians(bends.along)[:, None]
    # a barb that goes forward as well bends away from the shaft's tangent where it begins
    across = np.radians(bends.across)[:, None] / np.hypot(*_BARB)
    aside = np.abs(y)
    ahead = _BARB[0] / _BARB[1] * aside
    root = x - ahead
    low = 0.5 * along * root**2 + along * root * ahead + 0.5 * across * (ahead**2 + aside**2)
    return np.stack(np.broadcast_arrays(x, y, -low), axis=2)


_STREAM = 24  # of the draws of kinds


@dataclass(frozen=True)
class RegionKinds:
    """K kinds of a region. choices, kinds: (K). amounts: K rules, how much of each there is."""

    choices: tuple[KindChoice, ...]
    kinds: tuple[FeatherKind, ...]
    amounts: tuple[Rule, ...]

    @property
    def lengths(self) -> Array:
        """(K,) m."""
        return np.array([kind.length for kind in self.kinds])

    @property
    def cambers(self) -> Array:
        """(K,) deg, of the shafts."""
        return np.array([kind.rachis.camber for kind in self.kinds])

    @property
    def barb_cambers(self) -> Array:
        """(K,) deg, of the barbs that end where vanes are widest, means of both vanes."""
        return np.array([np.mean(_cambers_at(BARB_SAMPLE_ROW, kind)) for kind in self.kinds])

    def weights(self, points: SurfacePoints) -> Array:
        """(N, K) probabilities of the kinds at places; the first kind where there is none."""
        raw = np.stack([amount(points) for amount in self.amounts], axis=1)
        raw[~(raw > 0.0).any(axis=1), 0] = 1.0
        return raw / raw.sum(axis=1, keepdims=True)

    def drawn(self, points: SurfacePoints, seed: int, numbers: Indices) -> Indices:
        """(N,) kinds of feathers with numbers (N,), each by its own draw."""
        if len(self.kinds) == 1:
            return np.zeros(len(points), dtype=np.int64)
        bounds = np.cumsum(self.weights(points), axis=1)[:, :-1]
        draw = uniform(seed, _STREAM, numbers)
        return np.asarray((draw[:, None] >= bounds).sum(axis=1))


def region_kinds(
    entry: dict[str, Any], place: Place, skin: GroomSkin, store: KindStore
) -> RegionKinds:
    """The kinds of a region with checked keys. Raises InputError."""
    problems = Problems()
    changes: tuple[int, ...] = ()
    if entry["overrides"]:
        at = place.child("overrides")
        changes = (store.change(sourced(entry["overrides"], place.source), at),)
    given = entry["kind"]
    single = not isinstance(given, tuple)
    entries = [_as_table(each) for each in ((given,) if single else given)]
    choices, kinds, amounts = [], [], []
    for number, each in enumerate(entries):
        at = place.child("kind") if single else place.child("kind").item(number)
        choice = KindChoice((each["name"],), 0.0, changes, place if single else at)
        choices.append(choice)
        with problems.collecting():
            kinds.append(store.kind(choice))
        with problems.collecting():
            amounts.append(_scaled(presence(each["where"], skin, at.child("where")), each["share"]))
    problems.hand_on()
    if not any(each["share"] > 0.0 for each in entries):
        place.child("kind").refuse("has no share above 0. Give one share above 0")
    return RegionKinds(tuple(choices), tuple(kinds), tuple(amounts))


def _cambers_at(position: float, kind: FeatherKind) -> list[float]:
    """deg, of the vanes that a kind has. position: along the shaft, 0 to 1."""
    return [
        float(np.interp(position, [g.position for g in guides], [g.camber for g in guides]))
        for guides in (kind.leading.guides, kind.trailing.guides)
        if guides
    ]


def _as_table(given: str | dict[str, Any]) -> dict[str, Any]:
    """A kind as a table with all its keys."""
    if isinstance(given, dict):
        return given
    return {"name": given, "share": 1.0, "where": ()}


def _scaled(rule: Rule, factor: float) -> Rule:
    return lambda points: factor * rule(points)


MAX_DEVIATIONS = 3.0  # standard deviations
RANDOM_STREAMS = {"length": 10, "width": 12, "curl": 14, "tilt": 16, "turn": 18, "roll": 20}
_VARIANT_STREAM = 22
# steps in which a blend between regions passes, so that shapes repeat there, too
_WIDTH_STEP = 0.1
_CURL_STEP = 10.0  # deg
_HOLLOW_STEP = 5.0  # deg


def normal_draws(entry: dict[str, Any], name: str, numbers: Indices) -> Array:
    """(N,) normal draws of one quantity (Box and Muller 1958), by its deviation, limited."""
    stream, seed = RANDOM_STREAMS[name], entry["seed"]
    radius = np.sqrt(-2.0 * np.log(uniform(seed, stream, numbers)))
    wave = np.cos(2.0 * np.pi * uniform(seed, stream + 1, numbers))
    return np.asarray(
        entry["variation"][name] * np.clip(radius * wave, -MAX_DEVIATIONS, MAX_DEVIATIONS)
    )


def shapes(
    entry: dict[str, Any],
    blend: dict[str, Array],
    direction: Array,
    points: SurfacePoints,
    numbers: Indices,
    cambers: tuple[Array, Array],
) -> tuple[Array, Array, Array]:
    """Factors of the width, changes of the camber of shafts and of barbs (deg).

    They take few different values where the region has variants. entry: checked keys of the
    region. blend: (N,) width, curl and length of each feather. direction: (N, 3). numbers: (N,)
    of the candidates. cambers: (N,) deg, of shafts and barbs by their kinds.
    """
    own, variants, follow = numbers, entry["variants"], entry["follow"]
    width, curl = blend["width"], blend["curl"]
    hollow = np.zeros(len(points))
    if follow:
        along, across = bends_of_skin(points, direction, blend["length"])
        curl = curl + follow * (along - cambers[0])
        hollow = follow * (across - cambers[1])
    spread = normal_draws(entry, "width", own)
    if variants:
        own = (hashed(entry["seed"], _VARIANT_STREAM, own) % np.uint64(variants)).astype(np.int64)
        spread = entry["variation"]["width"] * _even_draws(variants)[own]
        width = entry["width"] + _stepped(width - entry["width"], _WIDTH_STEP)
        curl = entry["curl"] + _stepped(curl - entry["curl"], _CURL_STEP)
        hollow = _stepped(hollow, _HOLLOW_STEP)
    width = width * (1.0 + spread)
    return np.maximum(width, 0.01), curl + normal_draws(entry, "curl", own), hollow


def _even_draws(count: int) -> Array:
    """(count,) quantiles of a normal distribution of mean 0, with a deviation of 1."""
    found = ndtri((np.arange(count) + 0.5) / count)
    return np.asarray(found / max(float(found.std()), 1e-9))


def _stepped(values: Array, step: float) -> Array:
    return np.asarray(step * np.round(values / step))
