"""Blue noise on a skin that keeps its points when it grows denser, and when the mesh changes.

Candidates are where fixed lines cross the skin (scatter_kernels.py), in its own space, from an
origin of its shape. A candidate's place and number come from its line, so that neither the order
nor the size of faces matters, and an edit of the mesh moves the candidates on it alone. Candidates
are thinned by how squarely the line crosses, which makes them even on faces of any slant.

Dart throwing (Cook 1986) runs through levels of density: at each, the least distance shrinks a
little, a few more candidates are read, and each that has room is accepted. What one level accepts,
the next ones keep. So each candidate has a density at which it appears, and thinning by that
density gives blue noise of any density that varies over the skin, a denser one containing a sparser
one (hierarchical Poisson-disk sampling, as McCool and Fiume 1992). Candidates just outside of a
region count as well, so that its border is no denser than the rest.

Ids of a region's feathers from an earlier publish, by the places of their roots.

Pairs of a root and an earlier one within a spacing of the latter are taken in the order of their
distance, each root once. A feather without a pair keeps its own id unless an earlier one has it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots
from featherfx.groom.keys.groom import USD_KEYS
from featherfx.groom.keys.problems import Place, nearest
from featherfx.groom.read.space import DrawnFeather, SceneReader
from featherfx.groom.regions.rules import Presence
from featherfx.groom.skin.field import search_tree
from featherfx.groom.skin.points import SkinSurface, SurfacePoints
from featherfx.phases import LeftOut, StageRead, note_read

Words = NDArray[np.uint64]

# points per area that these levels give on a closed skin, times the squared distance
_SATURATED = 0.522
_LEVELS_PER_DOUBLING = 4  # of the density
_CANDIDATES_PER_POINT = 8  # as dense as throwing more would hardly fill gaps
# width of the strip along open edges of a mesh that would hold the points crowded there, distances
_BORDER_WIDTH = 0.4
_NORMAL_STEPS = 1000.0
_LATTICE = 2**20  # of the skin's size
# how much smaller than the largest a density may be and still count
_MIN_PRESENCE = 1e-3
# points on the whole skin at the first level: fewer would carry an edit of the mesh far about
_FIRST_COUNT = 64
_NUMBER_BITS = 40  # of a candidate's number, ten hexadecimal digits of an id
_FIRST_OCTAVE = -1024  # below any density, so that numbers of octaves are positive
_MAX_DENSITY = 1e300  # points per m^2


@dataclass(frozen=True)
class Scattered:
    """Points of a scatter, the first to appear first. number: (N,) of their candidates."""

    points: SurfacePoints
    number: Indices


def hashed(seed: int, stream: int, numbers: Indices) -> Words:
    """(N,) 64 well-mixed bits of seed, stream and each number (splitmix64, Steele 2014)."""
    with np.errstate(over="ignore"):
        words = numbers.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        words += np.uint64((seed * 0xD1342543DE82EF95 + stream * 0xAF251AF3B0F025B5) % 2**64)
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            words = (words ^ (words >> np.uint64(shift))) * np.uint64(factor)
        return words ^ (words >> np.uint64(31))


def uniform(seed: int, stream: int, numbers: Indices) -> Array:
    """(N,) numbers within (0, 1), the same on every machine."""
    words = hashed(seed, stream, numbers) >> np.uint64(11)
    return (words.astype(np.float64) + 0.5) / 2.0**53


def expected_count(surface: SkinSurface, density: Callable[[SurfacePoints], Array]) -> float:
    """Integral of a density (points per m^2) over a skin, by four points of each triangle."""
    total = sum(density(points) / len(surface.samples) for points in surface.samples)
    return float((total * surface.areas).sum())


def scatter(presence: Presence, count: int, seed: int) -> Scattered:
    """Up to `count` points whose density is proportional to `presence` (0 to 1).

    With the same presence and seed, the points of a smaller count come first among those
    of a larger one. Fewer are returned only where the presence is zero nearly everywhere.
    """
    pool = _Pool(presence, seed)
    while pool.count_within(pool.density) < count and not pool.is_exhausted(count):
        pool.fill()
    return pool.pick(count=count)


def scatter_by_density(presence: Presence, density: float, seed: int) -> Scattered:
    """Points of a density per m^2, times `presence` (0 to 1), as scatter.

    Each appears by what is near it alone, so that an edit of the skin changes none elsewhere.
    """
    surface, area = presence.surface, expected_count(presence.surface, presence)
    if area == 0.0:
        return _Pool(presence, seed).pick()
    # d (area + width of the strip x its length) points, the width falling with the root of d
    middles, lengths = surface.borders
    strip = 0.5 * _BORDER_WIDTH * np.sqrt(_SATURATED) * float(lengths @ presence(middles)) / area
    density = (np.sqrt(strip**2 + density) - strip) ** 2
    pool = _Pool(presence, seed, density)
    while pool.density < density:
        pool.fill()
    return pool.pick(density=density)


def _candidates(
    presence: Presence, octave: int, many: float, seed: int, share: float
) -> tuple[SurfacePoints, Indices]:
    """Return candidates of an octave of density that may matter, in their order, and their numbers.

    many: per m^2. share: of the presence, up to which no more points appear.
    """
    from featherfx.groom.regions.scatter_kernels import cross_lines

    surface, domain = presence.surface, presence.surface.domain
    # what is farther from the region crowds none within it. A candidate is left out again at the
    # cost of some four distances of triangles
    reach = np.sqrt(_SATURATED * _CANDIDATES_PER_POINT / many)
    wanted = presence.reached(reach, share, 4.0 * domain.area * many < len(surface.areas))
    word = int(hashed(seed, 0, np.array([octave - _FIRST_OCTAVE])).astype(np.int64)[0])
    room, found = 64 + int(4.0 * domain.area * many), -1
    while found < 0 or found > room:
        room = max(room, found)
        triangle, line = np.empty(room, np.int64), np.empty(room, np.int64)
        weights, marks = np.empty((room, 2)), np.zeros(1 << (4 * room).bit_length(), np.bool_)
        pitch = many**-0.5
        found = cross_lines(domain.corners, wanted, pitch, word, marks, triangle, weights, line)
    triangle, line, weights = triangle[:found], line[:found], weights[:found]
    barycentric = np.column_stack([1.0 - weights.sum(axis=1), weights])
    axis = line & 3
    depth = dots(barycentric, domain.corners[triangle, :, axis])
    along = domain.normals[triangle, axis]
    up = along > 0.0
    # those of one line that face one way are told apart by their order along it
    order = np.lexsort((depth, up, line))
    triangle, barycentric = triangle[order], barycentric[order]
    line, up = line[order], up[order].astype(np.int64)
    first = np.flatnonzero((np.diff(line, prepend=-1) != 0) | (np.diff(up, prepend=-1) != 0))
    rank = np.arange(found) - np.repeat(first, np.diff(first, append=found))
    own = wanted[triangle]
    triangle, line, up, rank = (each[own] for each in (triangle, line, up, rank))
    barycentric, along = barycentric[own], along[order][own]
    words = hashed(seed, 1, line) + (2 * rank + up).astype(np.uint64)
    number = (hashed(0, 2, words.astype(np.int64)) >> np.uint64(64 - _NUMBER_BITS)).astype(np.int64)
    # of crossings per area, |n| along each axis, as many again are kept: |n|^2 add up to 1
    kept = np.flatnonzero(uniform(seed, 3, number) < np.abs(along))
    kept = kept[np.argsort(number[kept], kind="stable")]
    return surface.at(triangle[kept], barycentric[kept]), number[kept]


class _Pool:
    """Candidates read so far that matter, with the density at which they appear."""

    def __init__(self, presence: Presence, seed: int, most: float = np.inf) -> None:
        """Prepare a pool. most: points per m^2, where the presence is 1."""
        self._presence, self._seed, self._most = presence, seed, most
        self._surface = surface = presence.surface
        self._points = surface.at(np.zeros(0, np.int64), np.zeros((0, 3)))
        self._number, self._places = np.zeros(0, np.int64), np.zeros((0, 3), np.int64)
        self._present, self._appears = np.zeros(0), np.zeros(0)
        self._accepted = np.zeros(0, np.bool_)
        area = surface.domain.area
        self._unit = 2.0 ** np.floor(0.5 * np.log2(area)) / _LATTICE
        octave = int(np.log2(_FIRST_COUNT / area))
        self._level = _LEVELS_PER_DOUBLING * octave
        self._octave = self._read(octave, 0.0)
        self._accept(*self._octave, 0.0)

    @property
    def density(self) -> float:
        """Points per m^2 of the last level."""
        return float(2.0 ** (self._level / _LEVELS_PER_DOUBLING))

    def _read(self, octave: int, before: float) -> tuple[SurfacePoints, Indices]:
        """Return candidates of an octave that appear from a density before on."""
        many, share = _CANDIDATES_PER_POINT * self.density, before / self._most
        return _candidates(self._presence, octave, many, self._seed, share)

    def fill(self) -> None:
        """Read the candidates of the next level, and accept all that have room."""
        before, octave = self.density, self._level // _LEVELS_PER_DOUBLING
        if self._level % _LEVELS_PER_DOUBLING == 0:
            self._octave = self._read(octave + 1, before)
        self._level += 1
        start, end = (density / 2.0**octave - 1.0 for density in (before, self.density))
        points, number = self._octave
        draw = uniform(self._seed, 4, number)
        now = (draw > start) & (draw <= end)
        self._accept(points.some(now), number[now], before)

    def _accept(self, fresh: SurfacePoints, number: Indices, before: float) -> None:
        """Throw darts at more candidates. before: density of the level before."""
        from featherfx.groom.regions.scatter_kernels import throw_darts

        self._extend(fresh, number)
        count = len(self._number)
        cell = max(int(np.sqrt(_SATURATED / self.density) / self._unit), 1)
        heads = np.empty(1 << max(int(self._accepted.sum() + 1).bit_length() + 1, 10), np.int64)
        links, taken = np.empty(count, np.int64), np.empty(count, np.int64)
        new = throw_darts(self._places, self._normals(), self._accepted, cell, heads, links, taken)
        draw = uniform(self._seed, 5, self._number[taken[:new]])
        self._appears[taken[:new]] = before + (self.density - before) * draw

    def _normals(self) -> Indices:
        return np.round(self._points.normal * _NORMAL_STEPS).astype(np.int64)

    def _extend(self, fresh: SurfacePoints, number: Indices) -> None:
        """Add candidates that are within the region, or so near that they crowd those that are."""
        present = self._presence(fresh)
        inside = present > _MIN_PRESENCE
        near = inside.copy()
        if inside.any() or len(self._number):
            known = self._points.position[self._present > _MIN_PRESENCE]
            tree = search_tree(np.concatenate([known, fresh.position[inside]]))
            reach = np.sqrt(_SATURATED / self.density)
            distance, _ = tree.query(fresh.position[~inside], distance_upper_bound=reach)
            near[~inside] = np.isfinite(distance)
        old, fresh = self._points, fresh.some(near)
        domain = self._surface.domain.corners[fresh.triangle]
        place = np.einsum("nk,nkc->nc", fresh.barycentric, domain)
        self._places = np.concatenate([self._places, np.floor(place / self._unit).astype(np.int64)])
        self._points = SurfacePoints(
            self._surface,
            *(
                np.concatenate([getattr(old, name), getattr(fresh, name)])
                for name in ("triangle", "barycentric", "position", "normal")
            ),
        )
        self._number = np.concatenate([self._number, number[near]])
        self._present = np.concatenate([self._present, present[near]])
        self._appears = np.concatenate([self._appears, np.full(len(fresh), np.inf)])
        self._accepted = np.concatenate([self._accepted, np.zeros(len(fresh), dtype=np.bool_)])

    def _within(self, density: float) -> Flags:
        """(N,) whether candidates appear where the density is so much times the presence."""
        return (self._present > _MIN_PRESENCE) & (self._appears <= density * self._present)

    def count_within(self, density: float) -> int:
        """Points up to a density, which no later level can come before."""
        return int(self._within(density).sum())

    def is_exhausted(self, count: int) -> bool:
        """Return True if the presence is too small everywhere to go on."""
        expected = self.density * self._surface.domain.area
        return len(self._number) == 0 and expected > 1000.0 * (count + 100)

    def pick(self, count: int | None = None, density: float = _MAX_DENSITY) -> Scattered:
        """Return the points up to a density, or the first `count`, in the order of appearance."""
        found = np.flatnonzero(self._accepted & self._within(density))
        order = np.lexsort((self._number[found], self._appears[found] / self._present[found]))
        chosen = found[order]
        # two may have one number by chance: the first keeps it
        chosen = chosen[np.sort(np.unique(self._number[chosen], return_index=True)[1])][:count]
        return Scattered(self._points.some(chosen), self._number[chosen])


_MAX_CANDIDATES = 8  # earlier roots near one that are looked at
# ids that a warning names
_MAX_NAMED = 5
_NUMBER = re.compile(r"_([0-9a-f]{10})$")


def read_previous(
    entry: dict[str, Any], folder: Path, place: Place, read: SceneReader
) -> list[DrawnFeather]:
    """Return a region's feathers in the file that its key ids_from names, none without the key.

    place: of the region. Raises InputError, also where the file holds no feather of the region.
    """
    if entry["ids_from"] is None:
        return []
    keys = {name: key.default for name, key in USD_KEYS.items()} | {"file": entry["ids_from"]}
    at = place.child("ids_from")
    path, feathers = read(keys, folder, at)
    own = [each for each in feathers if each.region == entry["id"] and each.id]
    if not own:
        known = nearest(entry["id"], {each.region for each in feathers} - {""})
        at.refuse(f"{path} holds no feather of region '{entry['id']}', {known}")
    return own


def take_ids(
    entry: dict[str, Any], fresh: Scattered, previous: Sequence[DrawnFeather], names: Sequence[str]
) -> tuple[Scattered, list[str]]:
    """Return the points of a region with the numbers of earlier feathers at their places, and ids.

    A number is what a feather's variation is drawn by. entry: checked keys of the region. names:
    ids by the points' own numbers.
    """
    pairs = _pair_roots(fresh.points.position, np.stack([each.points[0] for each in previous]))
    earlier = [each.id for each in previous]
    free = set(earlier) - {earlier[k] for k in pairs.values()}
    known, ids, numbers, new = set(earlier), [], fresh.number.copy(), []
    for k, name in enumerate(names):
        if k in pairs:
            name = earlier[pairs[k]]
        elif name in free:  # the same candidate, which the surface has carried away
            free.remove(name)
        else:
            while name in known:
                words: Indices = np.array([numbers[k]], dtype=np.int64)
                numbers[k] = int(hashed(0, 6, words)[0] >> np.uint64(24))
                name = f"{entry['id']}_{numbers[k]:010x}"
            new.append(name)
            known.add(name)
        ids.append(name)
        if found := _NUMBER.search(name):
            numbers[k] = int(found[1], 16)
    _note(entry, len(ids) - len(new), new, sorted(free))
    return Scattered(fresh.points, numbers), ids


def _pair_roots(roots: Array, earlier: Array) -> dict[int, int]:
    """Return the number of the earlier root (M, 3) for those of the roots (N, 3) that have one."""
    tree = search_tree(earlier)
    apart = tree.query(earlier, k=2)[0][:, 1]
    reach = float(np.median(apart[np.isfinite(apart)])) if len(earlier) > 1 else np.inf
    distance, near = tree.query(roots, k=min(_MAX_CANDIDATES, len(earlier)))
    distance, near = distance.reshape(len(roots), -1), near.reshape(len(roots), -1)
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for place in np.argsort(distance, axis=None, kind="stable"):
        k, j = divmod(int(place), distance.shape[1])
        other = int(near[k, j])
        if distance[k, j] > reach:
            break
        if k not in pairs and other not in taken:
            pairs[k] = other
            taken.add(other)
    return pairs


def _note(entry: dict[str, Any], count: int, new: Sequence[str], gone: Sequence[str]) -> None:
    """Tell how many ids stay, which feathers are new and which are gone."""
    more = ", ..." if len(new) > _MAX_NAMED else ""
    named = f" ({', '.join(new[:_MAX_NAMED])}{more})" if new else ""
    left = tuple(LeftOut(name, "earlier ids", "no feather has") for name in gone)
    fresh = f"{len(new)} new{named}"
    path = f"region '{entry['id']}'"
    note_read(StageRead(entry["ids_from"], path, "kept id", count, left, lambda: fresh))
