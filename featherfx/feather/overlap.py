"""Pairs of feathers that may overlap at rest.

Feathers are taken as strips about their shafts: what is found may meet, what is left out cannot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots
from featherfx.groom.course import shaft, turn
from featherfx.groom.skin.field import search_tree
from featherfx.groom.types import Placement, RachisShape

# cosine of the angle between two dorsal sides from which on feathers do not count as layered
_MIN_FACING = 0.5


@dataclass(frozen=True)
class Strips:
    """F feathers as straight strips.

    root: (F, 3) m. shaft: (F, 3) m, root to tip. dorsal: (F, 3) unit. reach: (F,) m, how far the
    vanes go from the straight line to the tip.
    """

    root: Array
    shaft: Array
    dorsal: Array
    reach: Array


def _ends(shapes: Sequence[RachisShape]) -> tuple[Array, Array]:
    """(F, 3) mean tangents of shafts, root to tip, and (F,) how far they leave the line to their
    end, in lengths."""
    total = np.radians([(s.twist, s.camber, -s.sweep) for s in shapes]).reshape(-1, 3)
    _, straight = turn(total)
    # an arc leaves the line to its end by an eighth of its turning
    bow = 0.125 * np.linalg.norm(total[:, 1:], axis=1)
    along = np.linspace(0.0, 1.0, 33)
    for k, shape in enumerate(shapes):
        if shape.course:
            mean = shaft(shape, along)[1]
            straight[k] = mean[-1]
            bow[k] = np.linalg.norm(along[:, None] * (mean - mean[-1]), axis=1).max()
    return straight, bow


def strips_of(placements: Sequence[Placement]) -> Strips:
    """The feathers of a groom as strips."""
    kinds = [p.kind for p in placements]
    outlines = [k.leading.outline + k.trailing.outline for k in kinds]
    widest = [max((y for _, y in outline), default=0.0) for outline in outlines]
    straight, bow = _ends([k.rachis for k in kinds])
    straight[:, 1] *= [-1.0 if p.mirrored else 1.0 for p in placements]
    length = np.array([k.length for k in kinds])
    rotation = np.array([p.rotation for p in placements]).reshape(-1, 3, 3)
    return Strips(
        root=np.array([p.position for p in placements]).reshape(-1, 3),
        shaft=length[:, None] * np.einsum("fij,fj->fi", rotation, straight),
        dorsal=rotation[:, :, 2],
        reach=length * (np.array(widest) + bow),
    )


def near_pairs(strips: Strips) -> Indices:
    """(K, 2) feathers that may meet, in no order of theirs.

    Neighbours come from search trees by classes of length, so that the work grows with the number
    of pairs.
    """
    pairs = _near(strips)
    first, second = pairs.T
    cosine = dots(strips.dorsal[first], strips.dorsal[second])
    pairs = pairs[cosine > _MIN_FACING]
    first, second = pairs.T
    shaft = strips.shaft
    distance = segment_distance(
        strips.root[first], shaft[first], strips.root[second], shaft[second]
    )
    return np.asarray(pairs[distance <= strips.reach[first] + strips.reach[second]])


def _near(strips: Strips) -> Indices:
    """(K, 2) pairs, the smaller number first, whose bounding spheres meet."""
    middle = strips.root + 0.5 * strips.shaft
    radius = 0.5 * np.linalg.norm(strips.shaft, axis=1) + strips.reach
    sizes = np.floor(2.0 * np.log2(radius))
    members = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    trees = [search_tree(middle[each]) for each in members]
    found = [np.zeros((0, 2), dtype=np.int64)]
    for i, larger in enumerate(members):
        for j, smaller in enumerate(members[: i + 1]):
            reach = float(radius[larger].max() + radius[smaller].max())
            near = trees[i].sparse_distance_matrix(trees[j], reach, output_type="ndarray")
            a, b = larger[near["i"]], smaller[near["j"]]
            kept = (near["v"] <= radius[a] + radius[b]) & ((i != j) | (a < b))
            found.append(np.sort(np.stack([a[kept], b[kept]], axis=1), axis=1))
    return np.concatenate(found)


def segment_distance(first: Array, along: Array, second: Array, across: Array) -> Array:
    """(K,) distance of segments from first to first + along and from second to second + across."""

    gap = first - second
    aa, bb, ab = dots(along, along), dots(across, across), dots(along, across)
    ag, bg = dots(along, gap), dots(across, gap)
    determinant = aa * bb - ab * ab
    slanted = determinant > 1e-12 * aa * bb
    s = np.where(slanted, (ab * bg - bb * ag) / np.where(slanted, determinant, 1.0), 0.0)
    s = np.clip(s, 0.0, 1.0)
    t = np.clip((ab * s + bg) / bb, 0.0, 1.0)
    s = np.clip((ab * t - ag) / aa, 0.0, 1.0)
    apart = gap + s[:, None] * along - t[:, None] * across
    return np.sqrt(dots(apart, apart))
