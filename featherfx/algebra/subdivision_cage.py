"""Cages of subdivision surfaces: faces, edges, and what is sharp, in USD's words (OpenSubdiv)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from featherfx.algebra.types import Array, Flags, Indices

_INFINITE = 10.0  # sharpness from which on an edge or corner stays sharp at every level


class Sharp(NamedTuple):
    """Sharp edges (K, 2) or points (K,) of a mesh, and sharpness (K,): 10 and more is for good."""

    places: Indices
    sharpness: Array


_NO_EDGES = Sharp(np.zeros((0, 2), np.int64), np.zeros(0))
_NO_CORNERS = Sharp(np.zeros(0, np.int64), np.zeros(0))


class Rules(NamedTuple):
    """Rules by which a mesh is subdivided, in USD's words.

    scheme: catmullClark, loop (of triangles alone) or bilinear. boundary: none (faces at open
    borders are not drawn), edgeOnly or edgeAndCorner. smooth_triangles: the rule `smooth` for
    triangles. holes: numbers of faces that are not drawn. is_linear: whether what is refined lies
    between points in lines, whatever the scheme.
    """

    scheme: str = "catmullClark"
    boundary: str = "edgeAndCorner"
    smooth_triangles: bool = False
    holes: Indices = _NO_CORNERS.places
    creases: Sharp = _NO_EDGES
    corners: Sharp = _NO_CORNERS
    is_linear: bool = False


@dataclass(frozen=True)
class Cage:
    """A mesh of F faces, C corners and V points that is subdivided.

    counts: (F,) corners of each face. indices: (C,) their points. rules: of the subdivision, with
    creases as they are at this level. corner_sharpness: (V,). hidden: (F,) faces that are not
    drawn.
    """

    counts: Indices
    indices: Indices
    rules: Rules
    corner_sharpness: Array
    hidden: Flags


class CageEdges:
    """The E edges of a cage of C corners.

    face, after, before, edge: (C,) of each corner its face, the places of the corners after and
    before it in it, and the edge to the one after it.
    ends: (E, 2) points. faces: (E,) how many use an edge. torn: (E,) whether they are more than
    two, or disagree on the outside. given: (E,) sharpness as of the cage; sharpness: (E,), infinite
    at torn edges and at borders."""

    def __init__(self, cage: Cage) -> None:
        self.cage, counts, indices = cage, cage.counts, cage.indices
        size = len(cage.corner_sharpness)
        self.face = np.repeat(np.arange(len(counts)), counts)
        self.after, self.before = find_turns(counts)
        following = indices[self.after]
        low, high = np.minimum(indices, following), np.maximum(indices, following)
        keys, edge = np.unique(low * size + high, return_inverse=True)
        self.edge = edge.reshape(-1).astype(np.int64)
        self.ends = np.stack([keys // size, keys % size], axis=1)
        self.faces = np.bincount(self.edge, minlength=len(keys))
        sense = np.bincount(self.edge, np.where(indices == low, 1.0, -1.0), len(keys))
        self.given = np.zeros(len(keys))
        places, sharpness = cage.rules.creases
        if len(places):
            wanted = places[:, 0] * size + places[:, 1]
            place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
            there = keys[place] == wanted
            np.maximum.at(self.given, place[there], sharpness[there])
        self.is_linear = cage.rules.is_linear or cage.rules.scheme == "bilinear"
        self.torn = (self.faces > 2) | ((self.faces == 2) & (sense != 0.0))
        smooth = (self.faces == 2) & ~self.torn & (not self.is_linear)
        self.sharpness = np.where(smooth, round_sharpness(self.given), np.inf)

    @cached_property
    def centres(self) -> Any:
        """(F, V) means of the faces."""
        weights = np.repeat(1.0 / np.maximum(self.cage.counts, 1), self.cage.counts)
        return make_matrix(
            self.face, self.cage.indices, weights, (len(self.cage.counts), self.size)
        )

    @cached_property
    def around(self) -> Any:
        """(V, F) 1 where a face is at a point."""
        return make_matrix(
            self.cage.indices,
            self.face,
            np.ones(len(self.face)),
            (self.size, len(self.cage.counts)),
        )

    @property
    def size(self) -> int:
        return len(self.cage.corner_sharpness)

    def neighbours(self, chosen: Flags) -> Any:
        """(V, V) 1 where one of the chosen edges (E,) joins two points."""
        first, second = self.ends[chosen].T
        rows, columns = np.concatenate([first, second]), np.concatenate([second, first])
        return make_matrix(rows, columns, np.ones(len(rows)), (self.size, self.size))


def make_cage(counts: Indices, indices: Indices, size: int, rules: Rules) -> Cage:
    """Return the cage of a mesh with `size` points."""
    sharpness = np.zeros(size)
    sharpness[rules.corners.places] = round_sharpness(rules.corners.sharpness)
    places = np.sort(rules.creases.places, axis=1)
    rules = rules._replace(creases=Sharp(places, round_sharpness(rules.creases.sharpness)))
    hidden = np.zeros(len(counts), np.bool_)
    cage = Cage(counts, indices, rules, sharpness, hidden)
    mesh = CageEdges(cage)
    if rules.boundary == "none" and rules.scheme != "bilinear":
        at_border = np.zeros(size, np.bool_)
        at_border[mesh.ends[(mesh.faces == 1) & np.isfinite(mesh.given)]] = True
        hidden[mesh.face[at_border[indices]]] = True
    hidden[rules.holes] = True
    faces = np.bincount(indices, minlength=size)
    if rules.boundary == "edgeAndCorner":
        sharpness[faces == 1] = np.inf
    # points at edges where faces do not go on are sharp, but for those along a fin
    torn, border, every = (
        count_edges(mesh, each) for each in (mesh.torn, mesh.faces == 1, mesh.faces > 0)
    )
    along = (torn == 2) & (border == 0) & (faces > every)
    sharpness[(torn > 0) & ~along] = np.inf
    return cage


def make_value_cage(cage: Cage, values: Indices, rule: str) -> tuple[Cage, Indices]:
    """Return the cage of a face-varying primvar, and (W,) the value of each of its points.

    values: (C,) numbers of the values of the corners. rule: faceVaryingLinearInterpolation of USD:
    none, cornersOnly, cornersPlus1, cornersPlus2, boundaries or all.
    """
    size = len(cage.corner_sharpness)
    span = int(values.max(initial=0)) + 1
    keys, own = np.unique(cage.indices * span + values, return_inverse=True)
    vertex, value, own = keys // span, keys % span, own.reshape(-1).astype(np.int64)
    outer, corners = CageEdges(cage), cage.corner_sharpness[vertex]
    # creases of the mesh count in the plane of the values, too
    creased = np.flatnonzero(outer.given[outer.edge] > 0.0)
    ends = np.stack([own[creased], own[outer.after[creased]]], axis=1)
    creases = Sharp(np.sort(ends, axis=1), outer.given[outer.edge[creased]])
    rules = cage.rules._replace(creases=creases, is_linear=rule == "all")
    inner = Cage(cage.counts, own, rules, corners, cage.hidden)
    if rule == "all":
        return inner, value
    mesh = CageEdges(inner)
    # an edge whose faces disagree on values is a seam; both its ends are at it
    seam = (outer.faces[outer.edge] > 1) & (mesh.faces[mesh.edge] == 1)
    at_seam, at_border = np.zeros(size, np.bool_), np.zeros(size, np.bool_)
    at_seam[outer.ends[outer.edge[seam]]] = True
    at_border[outer.ends[outer.faces == 1]] = True
    siblings = np.bincount(vertex, minlength=size)
    faces = np.bincount(own, minlength=len(vertex))
    lone = np.zeros(size, np.bool_)
    lone[vertex[faces == 1]] = True
    torn = np.zeros(size, np.bool_)
    torn[vertex[count_edges(mesh, np.isinf(mesh.sharpness)) > 2]] = True
    corner = np.zeros(len(vertex), np.bool_)
    if rule != "none":
        corner |= (faces == 1) & (at_seam | at_border)[vertex]
    if rule in ("cornersPlus1", "cornersPlus2"):
        corner |= (at_seam & ((siblings > 2) | ((siblings == 2) & torn)))[vertex]
    if rule == "cornersPlus2":
        corner |= (at_seam & (siblings == 2) & lone)[vertex]
        corner |= (at_seam & (siblings == 1) & ~at_border)[vertex]
    if rule == "boundaries":
        corner |= (at_seam | at_border)[vertex]
    return replace(inner, corner_sharpness=np.where(corner, np.inf, corners)), value


def find_turns(counts: Indices) -> tuple[Indices, Indices]:
    """(C,) places of the corners after and before each in its face."""
    corner = np.arange(counts.sum())
    used = counts[counts > 0]
    first = np.cumsum(used) - used
    after, before = corner + 1, corner - 1
    after[first + used - 1], before[first] = first, first + used - 1
    return after, before


def round_sharpness(sharpness: Array) -> Array:
    """Sharpness without end for all that never decays."""
    return np.where(sharpness >= _INFINITE, np.inf, np.maximum(sharpness, 0.0))


def count_edges(mesh: CageEdges, chosen: Flags) -> Indices:
    """(V,) how many of the chosen edges (E,) each point has."""
    return np.bincount(mesh.ends[chosen].ravel(), minlength=mesh.size)


def make_matrix(rows: Indices, columns: Indices, weights: Array, shape: tuple[int, int]) -> Any:
    return sparse.csr_matrix((weights, (rows, columns)), shape=shape)
