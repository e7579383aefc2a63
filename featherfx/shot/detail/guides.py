"""Guides of guided feathers, and the weights with which each feather follows them.

Guides are chosen within a region by farthest points: the first is the feather nearest to the
middle of the roots, each next one the farthest from those before, until every n-th feather is a
guide or none is farther from one than a spacing. Feathers of the region that are simulated anyway
guide as well.

A follower at distances d_g along the skin from its guides has the weights (Franke and Little)

    w_g ~ ((R - d_g) / (R d_g))^2   for d_g < R,   0 beyond,   normalised,

R the distance of its fifth nearest guide: compact, smooth over the skin, and 1 where a guide is.

Distances are ways over a graph whose nodes are the skin's points and the roots. Its edges are those
of the skin's triangles, from every root to the corners of the triangle that it is nearest to, and
straight between roots near each other whose triangles share a corner. Such ways are never shorter
than geodesics and, on even meshes, up to about a tenth longer; weights that fall smoothly need no
more. They do not leap from a leg to the belly, as straight distances do; those are taken where
there is no skin.

Levels of detail by the size of feathers in the image, and the guides of guided feathers.

A feather's size in the image, in pixels, times 1 + motion a / g, a the acceleration of its root
and of its tip were it rigid, chooses the level by its largest value over the shot's frames. The
quality's lengths may ask for a coarser one; [[detail]] and what pulls a feather decide alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy

from featherfx.algebra.triangulation import weld
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import distinct
from featherfx.errors import InputError, Problem
from featherfx.files.disk_cache import digest, kept
from featherfx.groom.skin.field import search_tree
from featherfx.groom.skin.skin import closest
from featherfx.limits import refuse_beyond_memory
from featherfx.shot.options import ShotOptions
from featherfx.shot.patterns import LEVELS, UNSOLVED_LEVELS
from featherfx.shot.roots import RootFrames, Roots, sampled_rates
from featherfx.shot.sources import relative_sizes
from featherfx.shot.types import LevelOfDetail, Shot

# a follower has up to that many guides
MAX_GUIDES = 4
# ways along the skin are followed as far as this many times the straight distance
_DETOUR = 3.0
# m, distances below count as none
_SAME_PLACE = 1e-9
# roots near a root that may be joined to it by an edge
_NEAR_ROOTS = 12
# corners of one point of the skin may differ by rounding, m
_WELD_DIGITS = 9
# rows of distances that are held at once
_SOURCES_AT_ONCE = 256


class GuideRule(NamedTuple):
    """Number of guides: every n-th feather (0: none chosen), or none farther than spacing (m)."""

    every: int
    spacing: float | None


def with_guides(shot: Shot, levels: Sequence[str], rules: Sequence[GuideRule]) -> list[str]:
    """Levels of all feathers, some of those that were to be guided made "full": the guides.

    rules: of every feather. Raises InputError for regions whose guided feathers have no guide.
    """
    chosen = list(levels)
    groups: dict[tuple[str, GuideRule], list[int]] = {}
    for f, (level, rule) in enumerate(zip(levels, rules, strict=True)):
        if level == "guided":
            groups.setdefault((shot.groom.feathers[f].region, rule), []).append(f)
    for (_, rule), members in groups.items():
        for f in _spread(_roots(shot, members), rule):
            chosen[members[f]] = "full"
    simulated = {
        placement.region
        for placement, level in zip(shot.groom.feathers, chosen, strict=True)
        if level not in UNSOLVED_LEVELS
    }
    lacking = sorted({region for region, _ in groups} - simulated)
    if lacking:
        problems = [
            Problem(
                str(shot.source),
                "detail",
                f"no guide for the guided feathers of region '{region}': give every = 1 or more, "
                "a spacing, or simulate some of its feathers",
            )
            for region in lacking
        ]
        raise InputError(*problems)
    return chosen


def uses_guides(shot: Shot) -> bool:
    """Return whether a shot asks for guided feathers."""
    rules = shot.level_of_detail
    seen = rules is not None and (rules.guided_below > 0.0 or rules.outside == "guided")
    by_length = shot.quality.guided_below > 0.0
    return seen or by_length or any(each.level == "guided" for each in shot.details)


def guide_weights(shot: Shot, followers: Indices, simulated: Indices) -> tuple[Indices, Any]:
    """The guides among simulated feathers that are followed, (G,), and sparse weights (F, G).

    followers, simulated: numbers of feathers in the groom.
    """
    roots = _roots(shot, range(len(shot.groom.feathers)))
    regions = [placement.region for placement in shot.groom.feathers]
    inputs = [roots, regions, followers, simulated, shot.skin_corners()]
    found = kept("guide-weights", inputs, lambda: _guide_weights(shot, followers, simulated))
    parts = found["value"], found["column"], found["start"]
    return found["guides"], scipy.sparse.csr_array(
        parts, shape=(len(followers), len(found["guides"]))
    )


def _guide_weights(shot: Shot, followers: Indices, simulated: Indices) -> dict[str, Any]:
    """The guides, and the parts of their weights as a compressed sparse matrix."""
    regions = np.array([placement.region for placement in shot.groom.feathers], dtype=object)
    every = _roots(shot, range(len(regions)))
    skin = make_skin_graph(every, shot.skin_corners())
    rows, columns, values = [], [], []
    for region in dict.fromkeys(regions[followers]):
        own = np.flatnonzero(regions[followers] == region)
        guides = simulated[regions[simulated] == region]
        row, column, value = _weights(shot, followers[own], guides, skin)
        rows.append(own[row])
        columns.append(guides[column])
        values.append(value)
    used, place = np.unique(np.concatenate(columns), return_inverse=True)
    entries = np.concatenate(values), (np.concatenate(rows), place)
    weights = scipy.sparse.coo_array(entries, shape=(len(followers), len(used))).tocsr()
    parts = {"value": weights.data, "column": weights.indices, "start": weights.indptr}
    return {"guides": used, **parts}


def _weights(
    shot: Shot, followers: Indices, guides: Indices, skin: SkinGraph | None
) -> tuple[Indices, Indices, Array]:
    """Follower, guide and weight of every pair within one region."""
    own, other = _roots(shot, followers), _roots(shot, guides)
    few = min(MAX_GUIDES + 1, len(guides))
    straight, near = search_tree(other).query(own, k=few)
    straight, near = straight.reshape(-1, few), near.reshape(-1, few)
    reach = _DETOUR * float(straight.max()) + _SAME_PLACE
    sources = len(own) + np.arange(len(guides))
    if skin is not None:
        skin = skin._replace(under=skin.under[np.concatenate([followers, guides])])
    guide, follower, way = root_distances(np.concatenate([own, other]), sources, skin, reach)
    kept = follower < len(own)
    guide, follower, way = guide[kept], follower[kept], way[kept]
    # those that no way leads to take the guide that is nearest by air
    lost = np.setdiff1d(np.arange(len(own)), follower)
    guide, follower = np.append(guide, near[lost, 0]), np.append(follower, lost)
    way = np.append(way, straight[lost, 0])
    order = np.lexsort((guide, way, follower))
    guide, follower, way = guide[order], follower[order], way[order]
    return _franke_little(follower, guide, np.maximum(way, _SAME_PLACE), len(own))


def _franke_little(
    follower: Indices, guide: Indices, way: Array, count: int
) -> tuple[Indices, Indices, Array]:
    """Normalised weights of pairs that are sorted by follower, then distance."""
    first = np.searchsorted(follower, np.arange(count + 1))
    each = np.diff(first)
    rank = np.arange(len(follower)) - first[follower]
    last = way[first[:-1] + np.minimum(each - 1, MAX_GUIDES)]
    # with fewer guides than would bound the circle, none is at its rim
    radius = np.where(each > MAX_GUIDES, last, 2.0 * last)[follower]
    kept = rank < MAX_GUIDES
    value = np.where(kept, (np.maximum(radius - way, 0.0) / (radius * way)) ** 2, 0.0)
    # guides that are all equally far are at the rim together
    total = np.bincount(follower, value, count)
    value = np.where((total[follower] == 0.0) & kept, 1.0, value)
    total = np.bincount(follower, value, count)
    kept = value > 0.0
    return follower[kept], guide[kept], value[kept] / total[follower[kept]]


def _spread(roots: Array, rule: GuideRule) -> list[int]:
    """Numbers of roots (N, 3) spread evenly, by farthest points."""
    if not rule.every and rule.spacing is None:
        return []
    most = -(-len(roots) // rule.every) if rule.every else len(roots)
    spacing = rule.spacing or 0.0
    chosen = [int(np.argmin(np.linalg.norm(roots - roots.mean(axis=0), axis=1)))]
    distance = np.linalg.norm(roots - roots[chosen[0]], axis=1)
    while len(chosen) < most and distance.max() > spacing:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(roots - roots[chosen[-1]], axis=1))
    return chosen


def _roots(shot: Shot, members: Sequence[int] | Indices) -> Array:
    positions = [shot.groom.feathers[f].position for f in members]
    return np.array(positions, dtype=np.float64).reshape(-1, 3)


class SkinGraph(NamedTuple):
    """A skin and F roots on it. points: (V, 3) m, each once. edges: (E, 2) of points, each once.
    under: (F, 3) points, corners of the triangle nearest to each root."""

    points: Array
    edges: Indices
    under: Indices


def make_skin_graph(roots: Array, corners: Array | None) -> SkinGraph | None:
    """The graph of a skin with corners (T, 3, 3) m under roots (F, 3) m, None without one."""
    if corners is None or not len(corners):
        return None
    points, triangles = weld(np.round(corners, _WELD_DIGITS))
    ends = np.sort(np.concatenate([triangles[:, (k, (k + 1) % 3)] for k in range(3)]), axis=1)
    edge = distinct(ends[:, 0] * len(points) + ends[:, 1])
    edges = np.stack(np.divmod(edge, len(points)), axis=1)
    return SkinGraph(points, edges, triangles[closest(roots, corners)[0]])


def root_distances(
    roots: Array, sources: Indices, skin: SkinGraph | None, reach: float
) -> tuple[Indices, Indices, Array]:
    """Ways from some of the roots, by their numbers, to all roots (F, 3) m that are within reach.

    Returns source (K,), its place in sources; root (K,); and distance (K,) m. skin: of these roots,
    None for straight distances. reach: m. Parts of a skin that do not hang together are out of
    reach of each other.
    """
    graph = None if skin is None else _graph(roots, skin)
    found = []
    for start in range(0, len(sources), _SOURCES_AT_ONCE):
        some = sources[start : start + _SOURCES_AT_ONCE]
        ways = _straight(roots, some) if graph is None else _along(*graph, some, reach)
        source, root = np.nonzero(ways <= reach)
        found.append((start + source, root, ways[source, root]))
    source, root, way = (np.concatenate(part) for part in zip(*found, strict=True))
    return source, root, way


def _straight(roots: Array, sources: Indices) -> Array:
    from scipy.spatial.distance import cdist

    return np.asarray(cdist(roots[sources], roots))


def _along(graph: Any, first: int, sources: Indices, reach: float) -> Array:
    from scipy.sparse.csgraph import dijkstra

    ways = dijkstra(graph, directed=False, indices=first + sources, limit=reach)
    return np.asarray(ways[:, first:])


def _graph(roots: Array, skin: SkinGraph) -> tuple[Any, int]:
    """Sparse graph of lengths, and the number of the first root's node."""
    first, count = len(skin.points), len(skin.points) + len(roots)
    every, own = first + np.arange(len(roots)), skin.under
    ends = [skin.edges, *(np.column_stack([every, own[:, k]]) for k in range(3))]
    _, near = search_tree(roots).query(roots, k=min(_NEAR_ROOTS + 1, len(roots)))
    near = near.reshape(len(roots), -1)
    pairs = np.column_stack([np.repeat(np.arange(len(roots)), near.shape[1]), near.ravel()])
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    numbers = np.unique(np.sort(pairs, axis=1) @ [len(roots), 1])
    pairs = np.stack(np.divmod(numbers, len(roots)), axis=1)
    shared = (own[pairs[:, 0], :, None] == own[pairs[:, 1], None, :]).any(axis=(1, 2))
    ends.append(first + pairs[shared])
    edges, places = np.concatenate(ends), np.concatenate([skin.points, roots])
    lengths = np.linalg.norm(places[edges[:, 0]] - places[edges[:, 1]], axis=1)
    # an edge without length would be no edge to the graph's routines
    lengths = np.maximum(lengths, 1e-12)
    graph = scipy.sparse.coo_array((lengths, (edges[:, 0], edges[:, 1])), shape=(count, count))
    return graph.tocsr(), first


def add_guides(shot: Shot, options: ShotOptions, own: Sequence[str]) -> list[str]:
    """Texts of what feathers depend on; of those that follow guides with those of the guides."""
    result, guided = list(own), options.at_level("guided")
    if not len(guided):
        return result
    guides, weights = guide_weights(shot, guided, options.leading)
    for row, f in enumerate(guided.tolist()):
        some = slice(weights.indptr[row], weights.indptr[row + 1])
        followed = guides[weights.indices[some]].tolist()
        parts = [own[g] for g in followed]
        result[f] = digest(own[f], parts, weights.data[some])
    return result


_NUMBER = {level: number for number, level in enumerate(LEVELS)}
# m/s^2, accelerations are measured in
_GRAVITY = 9.81
# of a feather and frame while levels are chosen: root frames, sizes, accelerations
_BYTES_PER_FEATHER_FRAME = 300


def refine_levels(
    shot: Shot,
    motion: Roots,
    levels: Sequence[tuple[str, str]],
    entries: Sequence[int],
    pinned: Sequence[bool],
) -> list[tuple[str, str]]:
    """Return levels of all feathers with their sources, coarser where a feather is seen small, and
    full where it guides others.

    entries: of each the [[detail]] that fits, -1 for none. pinned: which no camera changes. Raises
    InputError for regions whose guided feathers have no guide.
    """
    found = list(levels)
    if (rules := shot.level_of_detail) is not None:
        for f, (level, source) in enumerate(_levels_by_size(shot, rules, motion)):
            if not pinned[f] and _NUMBER[level] > _NUMBER[found[f][0]]:
                found[f] = level, source
    details, every = shot.details, shot.quality.guided_every
    guide_rules = [
        GuideRule(details[k].every, details[k].spacing) if k >= 0 else GuideRule(every, None)
        for k in entries
    ]
    own = [level for level, _ in found]
    for f, level in enumerate(with_guides(shot, own, guide_rules)):
        if level != own[f]:
            found[f] = level, f"guide of region {shot.groom.feathers[f].region!r}"
    return found


def _levels_by_size(shot: Shot, rules: LevelOfDetail, motion: Roots) -> list[tuple[str, str]]:
    """Return the levels of all feathers by their largest size in the image, weighted by their
    motion, and the keys that these follow from."""
    frames, count = shot.last_frame - shot.first_frame + 1, len(shot.groom.feathers)
    what = f"levels of {count} feathers in {frames} frames"
    needed = _BYTES_PER_FEATHER_FRAME * frames * count
    refuse_beyond_memory(needed, str(shot.source), "level_of_detail", what)
    times = np.arange(frames) / shot.frames_per_second
    lengths = np.array([p.kind.length for p in shot.groom.feathers])
    roots = [motion.frames(float(time)) for time in times]
    sizes = np.stack(
        [_pixels(rules, t, each.positions, lengths) for t, each in zip(times, roots, strict=True)]
    )
    if rules.motion > 0.0 and frames > 2:
        sizes = sizes * (1.0 + rules.motion / _GRAVITY * _accelerations(shot, roots, lengths))
    return [_level_of_size(rules, size) for size in sizes.max(axis=0).tolist()]


def _level_of_size(rules: LevelOfDetail, size: float) -> tuple[str, str]:
    if size == 0.0:
        return rules.outside, "[level_of_detail] outside"
    for level in ("rigid", "guided", "rachis", "coarse"):
        if size < getattr(rules, f"{level}_below"):
            return level, f"[level_of_detail] {level}_below"
    return "full", "[level_of_detail]"


def _pixels(rules: LevelOfDetail, time: float, roots: Array, lengths: Array) -> Array:
    if rules.camera is None:
        return (rules.pixels_per_metre or 0.0) * lengths
    view = rules.camera.view(time)
    return rules.image_height * relative_sizes(view, roots, lengths, rules.margin)


def _accelerations(shot: Shot, roots: Sequence[RootFrames], lengths: Array) -> Array:
    """(frames, F) m/s^2, the larger of roots and of tips that are rigid."""
    found = []
    for reach in (np.zeros_like(lengths), lengths):
        places = np.stack([p + reach[:, None] * r[:, :, 0] for p, r in roots])
        _, acceleration = sampled_rates(places, np.arange(len(roots), dtype=float), shot)
        found.append(np.linalg.norm(acceleration, axis=2))
    return np.maximum(*found)
