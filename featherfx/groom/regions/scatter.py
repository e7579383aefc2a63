"""Blue noise on a skin that keeps its points when it grows denser.

Candidates are an endless sequence, the same for the same skin and seed: triangle by area and place
within it come from hashes of the candidate's number. Dart throwing (Cook 1986) runs through levels
of density: at each, the least distance shrinks a little, the sequence is read a little further,
and every candidate that has room is accepted. What one level accepts, the next ones keep. So each
candidate has a density at which it appears, and thinning by that density gives blue noise of any
density that varies over the skin, a denser one containing a sparser one (hierarchical Poisson-disk
sampling, as McCool and Fiume 1992).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Indices
from featherfx.groom.skin.points import SkinSurface, SurfacePoints

Words = NDArray[np.uint64]

# points per area of a dart-throwing pattern that has no room left, times the squared distance
_SATURATED = 0.7
# levels in which the density doubles; candidates read at a density, per point that fits
_LEVELS_PER_DOUBLING = 4
_CANDIDATES_PER_POINT = 6
_FIRST_DENSITY = 4.0  # points on the whole skin
_LATTICE = 2**20  # of the skin's size
_NORMAL_STEPS = 1000.0
# how much smaller than the largest a density may be and still count
_MIN_PRESENCE = 1e-3


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


def scatter(
    surface: SkinSurface, presence: Callable[[SurfacePoints], Array], count: int, seed: int
) -> Scattered:
    """Up to `count` points whose density is proportional to `presence` (0 to 1).

    With the same surface, presence and seed, the points of a smaller count come first among those
    of a larger one. Fewer are returned only where the presence is zero nearly everywhere.
    """
    if count == 0:
        return Scattered(_candidates(surface, seed, 0, 0), np.zeros(0, dtype=np.int64))
    pool = _Pool(surface, presence, seed)
    for density in _densities(surface):
        pool.fill(density)
        if pool.complete(density) >= count or pool.exhausted(density, count):
            break
    return pool.first(count)


def _densities(surface: SkinSurface) -> Iterator[float]:
    """Points per m^2 of one level after the other."""
    density = _FIRST_DENSITY / float(surface.areas.sum())
    while True:
        yield density
        density *= 2.0 ** (1.0 / _LEVELS_PER_DOUBLING)


def _candidates(surface: SkinSurface, seed: int, start: int, end: int) -> SurfacePoints:
    """Candidates with numbers from start to end - 1, uniform over the skin's area."""
    number = np.arange(start, end)
    summed = np.cumsum(surface.areas)
    place = uniform(seed, 0, number) * summed[-1]
    triangle = np.minimum(np.searchsorted(summed, place, side="right"), len(summed) - 1)
    # uniform within the triangle: the square root makes the area, not the height, uniform
    root, along = np.sqrt(uniform(seed, 1, number)), uniform(seed, 2, number)
    barycentric = np.stack([1.0 - root, root * (1.0 - along), root * along], axis=1)
    return surface.at(triangle, barycentric)


class _Pool:
    """Candidates read so far that may appear at all, with the density at which they do."""

    def __init__(
        self, surface: SkinSurface, presence: Callable[[SurfacePoints], Array], seed: int
    ) -> None:
        self._surface, self._presence, self._seed = surface, presence, seed
        self._area = float(surface.areas.sum())
        self._read = 0
        self._points = _candidates(surface, seed, 0, 0)
        self._number = np.zeros(0, dtype=np.int64)
        self._present = np.zeros(0)
        self._appears = np.zeros(0)
        self._accepted = np.zeros(0, dtype=np.bool_)
        corners = surface.corners.reshape(-1, 3)
        self._low = corners.min(axis=0)
        self._unit = max(float(np.ptp(corners, axis=0).max()), 1e-300) / _LATTICE
        self._before = 0.0

    def fill(self, density: float) -> None:
        """Accept all that have room at a density."""
        from featherfx.groom.regions.scatter_kernels import throw_darts

        self._extend(int(_CANDIDATES_PER_POINT * density * self._area) + 1)
        count = len(self._number)
        positions = np.floor((self._points.position - self._low) / self._unit).astype(np.int64)
        normals = np.round(self._points.normal * _NORMAL_STEPS).astype(np.int64)
        cell = max(int(np.sqrt(_SATURATED / density) / self._unit), 1)
        heads = np.empty(1 << max(int(self._accepted.sum() + 1).bit_length() + 1, 10), np.int64)
        links, taken = np.empty(count, np.int64), np.empty(count, np.int64)
        new = throw_darts(positions, normals, self._accepted, cell, heads, links, taken)
        ranks = (np.arange(new) + 0.5) / max(new, 1)
        self._appears[taken[:new]] = self._before + (density - self._before) * ranks
        self._before = density

    def _extend(self, end: int) -> None:
        fresh = _candidates(self._surface, self._seed, self._read, end)
        number, self._read = np.arange(self._read, end), max(end, self._read)
        present = self._presence(fresh)
        kept = present > _MIN_PRESENCE
        fresh, old = fresh.some(kept), self._points
        self._points = SurfacePoints(
            self._surface,
            *(
                np.concatenate([getattr(old, name), getattr(fresh, name)])
                for name in ("triangle", "barycentric", "position", "normal")
            ),
        )
        added = int(kept.sum())
        self._number = np.concatenate([self._number, number[kept]])
        self._present = np.concatenate([self._present, present[kept]])
        self._appears = np.concatenate([self._appears, np.full(added, np.inf)])
        self._accepted = np.concatenate([self._accepted, np.zeros(added, dtype=np.bool_)])

    def complete(self, density: float) -> int:
        """Points that no later level can come before."""
        return int((self._appears <= density * self._present).sum())

    def exhausted(self, density: float, count: int) -> bool:
        """Return True if the presence is too small everywhere to go on."""
        return len(self._number) == 0 and density * self._area > 1000.0 * (count + 100)

    def first(self, count: int) -> Scattered:
        """The first `count` to appear where the density is the presence times a growing number."""
        found = np.flatnonzero(self._accepted)
        order = np.lexsort((self._number[found], self._appears[found] / self._present[found]))
        chosen = found[order[:count]]
        return Scattered(self._points.some(chosen), self._number[chosen])
