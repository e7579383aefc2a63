"""Points that a cache writes, prim by prim, lines whose lengths its feathers keep, and bounds.

A node is the mean of some points: of a ring of a rachis' tube, or a point itself. A strand is a
chain of nodes: a rachis or a barb. Strands are found in topology and texture coordinates alone.
Points of one row of a vane share v; u is 0.5 on the rachis and grows to 1 or falls to 0 along a
barb (featherfx/feather/types.py). Edges of a vane within a row are the segments of its barbs.

The bounds are those that a written cache is held to, with sentences about what passes them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from featherfx import usd
from featherfx.algebra.types import Floats, Indices
from featherfx.algebra.vectors import distinct
from featherfx.feather.types import RACHIS_PART
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    EARLIEST_TIME,
    INTEGER_ARRAY,
    PAIR_ARRAY,
    VECTOR_ARRAY,
    ArrayKind,
    describe_time,
    fault,
    list_transforms,
    read_array,
    read_matrix,
    read_sized_array,
    read_texts,
    read_times,
)
from featherfx.usd.types import DETAIL_ATTRIBUTE, RANGES_PREFIX

if TYPE_CHECKING:
    from featherfx.usd.read.expand import Expansion


# of the rest length of a rachis or barb, what a written one may be off by; and the same of a
# feather that is simulated, whose material stretches
MAX_LENGTH_ERROR, MAX_SIMULATED_LENGTH_ERROR = 0.005, 0.01
# of a feather's length, a second difference of a point from one sample to the next that the rigid
# motion of its root does not explain; and times that of its root, below which it is none
MAX_JUMP, MAX_ROOT_JUMP_RATIO = 0.1, 3.0
# of a second difference, what velocities that explain it may leave: those that follow a jump by
# central differences leave three quarters, those of a motion of 2 rad a sample a third
MAX_UNEXPLAINED_RATIO = 0.5
# of the rms speed, what 99 of 100 velocities may differ by from differences of points over five
# samples, or over three before or after a kink, beyond what those over five and three differ by;
# and what 99 of 100 of these may differ by where the samples resolve the motion
MAX_VELOCITY_MISMATCH, MAX_UNRESOLVED_SPEED = 0.03, 0.05
# what keratin bears: Pa, stress at which rachises of pigeons break in bending (Corning and Biewener
# 1998, J. exp. Biol. 201, 3057), over the mean modulus of a rachis, as strength rises outwards no
# less than modulus (Wang and Meyers 2017, Acta Biomater. 48, 270, abstract); modulus where a cache
# tells none, and of what is softer, which bears no more strain (Bonser and Purslow 1995, J. exp.
# Biol. 198, 1029); kg/m^3
MAX_STRESS, KERATIN_MODULUS, KERATIN_DENSITY = 137e6, 2.5e9, 1150.0
# m, by which a vane may be under the skin where a cache does not tell its thickness (Jouve 2024,
# Numerical Modeling of Feathers, table 3.1: 103 to 155 micrometres of swans)
USUAL_THICKNESS = 1.2e-4
# of the histogram of errors: bins of a factor of two, and the exponent that the first is of
BINS_PER_OCTAVE, MIN_EXPONENT, OCTAVES = 32, -60, 100


def list_passed_bounds(report: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each bound that a report of the judge passes."""
    lengths, pops = report["lengths"], report["pops"]
    if lengths["feathers_over"]:
        worst = lengths["worst"][0]
        yield (
            f"{_feathers(lengths['feathers_over'])} rachises or barbs that are longer or shorter"
            f" than at rest: the {worst['part']} of {worst['feather']} at frame {worst['frame']:g}"
            f" by {_percent(worst['of_length'])} (bound {_percent(worst['bound'])})"
        )
    if pops["unexplained"]:
        worst = pops["worst_unexplained"]
        yield (
            f"{_feathers(pops['unexplained'])} points that jump: {worst['feather']} at frame"
            f" {worst['frame']:g} by {_percent(worst['of_length'])} of its length"
            f" (bound {_percent(MAX_JUMP)})"
        )
    worst = report["strain_worst"]
    if worst and worst["strain"] > worst["bound"]:
        yield (
            f"the rachis of {worst['feather']} is strained by {_percent(worst['strain'])} at frame"
            f" {worst['frame']:g}, {worst['energy']:.0f} J/kg: more than keratin bears"
            f" (bound {_percent(worst['bound'])})"
        )
    deep = report["skin_depth"]
    if deep["feathers_over"]:
        worst = deep["worst"]
        yield (
            f"{_feathers(deep['feathers_over'])} vanes in the skin: {worst['feather']} at frame"
            f" {worst['frame']:g} is {1e3 * worst['depth']:.3g} mm deep (bound: a thickness,"
            f" {1e3 * deep['thickness']:.3g} mm)"
        )
    mismatch = report["velocity_unexplained"]
    if mismatch is not None and report["velocity_resolved"] and mismatch > MAX_VELOCITY_MISMATCH:
        yield (
            f"velocities differ from the motion of the points by {_percent(mismatch)} of the rms"
            f" speed (99 of 100 by less; bound {_percent(MAX_VELOCITY_MISMATCH)}), unless they"
            " vibrate between samples, as a bake with --subframes 16 shows"
        )


def _feathers(count: int) -> str:
    return f"{count} feather{' has' if count == 1 else 's have'}"


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.3g} %"


RACHIS, BARB = 0, 1
_RANGES = ArrayKind("iu", (2,), "an array of pairs of integers")
_ON_RACHIS = 0.5  # u of points of the rachis


@dataclass(frozen=True)
class MeshShape:
    """Constant part of a mesh.

    rest: (V, 3) in the space of the prim. triangles: (T, 3). part: (T,) side of the vane, or
    rachis. st: (V, 2).
    """

    rest: Floats
    triangles: Indices
    part: Indices
    st: NDArray[Any]


class Strands(NamedTuple):
    """K strands of F feathers, over N nodes.

    node_first: (N + 1,) first of each node's points in node_points. first: (K + 1,) first segment
    of each strand. start, end: (S,) nodes of the segments. feather, kind: (K,) of each strand.
    root: (F,) node of each feather.
    """

    node_first: Indices
    node_points: Indices
    first: Indices
    start: Indices
    end: Indices
    feather: Indices
    kind: Indices
    root: Indices


@dataclass(frozen=True)
class Track:
    """F feathers of one prim: V points over time.

    labels: of the feathers. owner: (V,) feather of each point. rest: (V, 3) in the space of the
    prim. reader: of its values.
    """

    labels: Sequence[TrackedFeather]
    owner: Indices
    rest: Floats
    strands: Strands
    reader: Any


class TrackedFeather(NamedTuple):
    """Id, kind and region of a feather, and how many points of its prim are its own."""

    id: str
    kind: str
    region: str
    points: int


def find_tracks(stage: Any) -> Iterator[Track]:
    """Yield the tracks of all feathers that a stage draws; condensed ones as the meshes they are.

    Raises InputError where a prim contradicts itself.
    """
    has_mesh = False
    for prim in stage.Traverse():
        if not prim.HasAttribute("primvars:featherId") or not bool(
            UsdGeom.Imageable(prim).ComputeVisibility() != UsdGeom.Tokens.invisible
        ):
            continue
        if prim.IsA(UsdGeom.Mesh):
            has_mesh = True
            yield _mesh_track(prim)
        elif prim.IsA(UsdGeom.BasisCurves) and not prim.HasAttribute(DETAIL_ATTRIBUTE):
            yield _curves_track(prim)
    if not has_mesh and usd.expand.condensed_prims(stage):
        yield _condensed_track(stage)


def _mesh_track(prim: Any) -> Track:
    rest, counts = _read_rest(prim), _read_integers(prim, "faceVertexCounts")
    indices = _read_integers(prim, "faceVertexIndices")
    if (counts != 3).any() or len(indices) != counts.sum():
        raise fault(prim.GetAttribute("faceVertexCounts"), "are not of triangles")
    if indices.size and not 0 <= indices.min() <= indices.max() < len(rest):
        raise fault(prim.GetAttribute("faceVertexIndices"), "do not fit the mesh's points")
    st = read_array(prim.GetAttribute("primvars:st"), EARLIEST_TIME, PAIR_ARRAY)
    side = _read_integers(prim, "primvars:side")
    if st is None or len(st) != len(rest) or len(side) != len(counts):
        # each point is a row of its own, so that there are no strands
        st = np.stack([np.full(len(rest), _ON_RACHIS), np.arange(len(rest))], axis=1)
        side = np.zeros(len(counts), dtype=np.int64)
    shape = MeshShape(rest, indices.reshape(-1, 3), side, st)
    return _track(_read_labels(prim, len(rest)), shape, _Reader(prim, len(rest)))


def _condensed_track(stage: Any) -> Track:
    expansion = usd.expand.expand(stage)
    each, rest = expansion.feathers, expansion.points().astype(np.float32)
    shape = MeshShape(
        rest,
        np.concatenate([feather.triangles + feather.points.start for feather in each]),
        np.concatenate([feather.side for feather in each]),
        np.concatenate([feather.st for feather in each]),
    )
    labels = [TrackedFeather(own.id, own.kind, own.region, len(own.st)) for own in each]
    return _track(labels, shape, _ExpansionReader(expansion))


def _track(labels: Sequence[TrackedFeather], shape: MeshShape, reader: Any) -> Track:
    owner = _find_owners(labels)
    return Track(labels, owner, shape.rest, _find_strands(shape, owner), reader)


def _curves_track(prim: Any) -> Track:
    rest, counts = _read_rest(prim), _read_integers(prim, "curveVertexCounts")
    if (counts < 1).any() or counts.sum() != len(rest):
        raise fault(prim.GetAttribute("curveVertexCounts"), "do not fit the points")
    labels = _read_labels(prim, len(rest))
    owner, points = _find_owners(labels), np.arange(len(rest))
    last = np.cumsum(counts) - 1
    start = np.delete(points, last)
    strands = Strands(
        node_first=np.arange(len(rest) + 1),
        node_points=points,
        first=np.concatenate([[0], np.cumsum(counts - 1)]),
        start=start,
        end=start + 1,
        feather=owner[last],
        kind=np.full(len(counts), BARB if prim.HasAttribute("primvars:side") else RACHIS),
        # a feather without curves has the last root, which moves nothing
        root=np.minimum(np.searchsorted(owner, np.arange(len(labels))), len(rest) - 1),
    )
    return Track(labels, owner, rest, strands, _Reader(prim, len(rest)))


def _read_rest(prim: Any) -> Floats:
    """Return (V, 3) points at rest: the primvar, else the first that there are."""
    for name in ("primvars:rest", "primvars:Pref", "points"):
        found = read_array(prim.GetAttribute(name), EARLIEST_TIME, VECTOR_ARRAY)
        if found is not None:
            if not np.isfinite(found.sum(dtype=np.float64)):
                raise fault(prim.GetAttribute(name), "has values that are not finite at rest")
            return np.ascontiguousarray(found, np.float32)
    raise fault(prim, "has no points")


def _read_integers(prim: Any, name: str) -> Indices:
    found = read_sized_array(prim.GetAttribute(name), EARLIEST_TIME, INTEGER_ARRAY)
    return found.astype(np.int64)


def _read_labels(prim: Any, count: int) -> list[TrackedFeather]:
    """Return the labels of the feathers of a prim with so many points."""
    ids = read_texts(prim.GetAttribute("primvars:featherId"))
    table = read_array(prim.GetAttribute(f"{RANGES_PREFIX}:points"), DEFAULT_TIME, _RANGES)
    sizes = [count] if table is None else table[:, 1].tolist()
    if min(sizes) < 0 or sum(sizes) != count or len(sizes) != len(ids):
        message = f"names {len(ids)} feathers of {sum(sizes)} points. The prim has {count}"
        raise fault(prim.GetAttribute("primvars:featherId"), message)
    elements = prim.GetAttribute(f"{RANGES_PREFIX}:faces") or prim.GetAttribute(
        f"{RANGES_PREFIX}:curves"
    )
    first = read_array(elements, DEFAULT_TIME, _RANGES)
    places = np.zeros(len(ids), dtype=int) if first is None else first[:, 0]
    texts = []
    for name in ("featherKind", "region"):
        primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)
        values = primvar.ComputeFlattened() if primvar.HasValue() else None
        own = [str(values[k]) if values and k < len(values) else "" for k in places.tolist()]
        texts.append(own)
    return [TrackedFeather(*each) for each in zip(ids, *texts, sizes, strict=True)]


def _find_owners(labels: Sequence[TrackedFeather]) -> Indices:
    """Return (V,) the number of the feather of each point."""
    return np.repeat(np.arange(len(labels)), [each.points for each in labels])


class _Reader:
    """Values of a prim with V points over time, in its space at rest.

    codes: time codes of its points, else of its place.
    """

    def __init__(self, prim: Any, count: int) -> None:
        self._prim, self._count = prim, count
        self.at_rest = read_matrix(prim, DEFAULT_TIME)
        self._is_still = not any(map(read_times, list_transforms(prim)))
        self.codes = read_times(prim.GetAttribute("points"))
        self.codes = self.codes or list(UsdGeom.Xformable(prim).GetTimeSamples())

    def read(self, name: str, code: float | None) -> Floats | None:
        """Return (V, 3) points or velocities; None where there are no velocities.

        Raises InputError where they are missing, do not fit the points at rest, or are not finite.
        """
        time = DEFAULT_TIME if code is None else Usd.TimeCode(code)
        attribute = self._prim.GetAttribute(name)
        found = read_array(attribute, time, VECTOR_ARRAY)
        if found is None and name == "velocities":
            return None
        if found is None:
            raise fault(attribute, f"has no value {describe_time(time)}")
        if len(found) != self._count:
            message = f"has {len(found)} values {describe_time(time)} and {self._count} at rest"
            raise fault(attribute, message)
        if not np.isfinite([found.min(initial=0.0), found.max(initial=0.0)]).all():
            raise fault(attribute, f"has values that are not finite {describe_time(time)}")
        matrix = self.at_rest if self._is_still else read_matrix(self._prim, time)
        if matrix is self.at_rest or (matrix == self.at_rest).all():
            return np.ascontiguousarray(found, np.float32)
        relative = matrix @ np.linalg.inv(self.at_rest)
        moved = found @ relative[:3, :3] + (relative[3, :3] if name == "points" else 0.0)
        return np.ascontiguousarray(moved, np.float32)


class _ExpansionReader:
    """Points of condensed feathers over time."""

    def __init__(self, expansion: Expansion) -> None:
        self._expansion, self.at_rest, self.codes = expansion, np.eye(4), expansion.codes()

    def read(self, name: str, code: float | None) -> Floats | None:
        """Return (V, 3) points; condensed feathers carry no velocities of these."""
        return self._expansion.points(code).astype(np.float32) if name == "points" else None


def _find_strands(shape: MeshShape, owner: Indices) -> Strands:
    """Return rachises and barbs of a mesh."""
    tube = shape.part == RACHIS_PART
    on_tube = distinct(shape.triangles[tube])
    row = shape.st[:, 1].astype(np.float64)
    on_tube = on_tube[np.lexsort((row[on_tube], owner[on_tube]))]
    new = np.diff(owner[on_tube], prepend=-1) + np.abs(np.diff(row[on_tube], prepend=-1.0)) > 0
    rings = np.flatnonzero(new)
    of_ring = owner[on_tube[rings]]
    along = np.flatnonzero(np.diff(of_ring) == 0)  # from one ring to the next
    # of the vanes, edges between points of one row, outwards
    corners = shape.triangles[~tube]
    sides = (corners[:, ends] for ends in ([0, 1], [1, 2], [2, 0]))
    edges = np.concatenate([each[row[each[:, 0]] == row[each[:, 1]]] for each in sides])
    out = np.abs(shape.st[:, 0].astype(np.float64) - _ON_RACHIS)
    edges = np.sort(edges, axis=1)  # places on a tie by their numbers, so that no chain is a ring
    order = np.argsort(out[edges], axis=1, kind="stable")
    numbers = distinct(np.take_along_axis(edges, order, axis=1) @ [len(row), 1])
    edges = np.stack(np.divmod(numbers, len(row)), axis=1)
    # a point's barb is told by its first point, which follows the rachis
    barb = np.arange(len(row))
    inner = out[edges[:, 0]] > 0.0
    barb[edges[inner, 1]] = edges[inner, 0]
    while not np.array_equal(before := barb[barb], barb):
        barb = before
    edges = edges[np.argsort(barb[edges[:, 1]], kind="stable")]
    barbs, first = np.unique(barb[edges[:, 1]], return_index=True)
    first = np.append(first, len(edges))
    rachises = np.unique(of_ring[along])
    points = len(row)
    # the first ring of a feather, else its first point
    root = np.searchsorted(owner, np.arange(owner.max(initial=-1) + 1))
    with_tube, ring = np.unique(of_ring, return_index=True)
    root[with_tube] = points + ring
    return Strands(
        # the points themselves, then the rings
        node_first=np.concatenate([np.arange(points), points + rings, [points + len(on_tube)]]),
        node_points=np.concatenate([np.arange(points), on_tube]),
        first=np.concatenate([np.searchsorted(of_ring[along], rachises), len(along) + first]),
        start=np.concatenate([points + along, edges[:, 0]]),
        end=np.concatenate([points + along + 1, edges[:, 1]]),
        feather=np.concatenate([rachises, owner[barbs]]),
        kind=np.repeat([RACHIS, BARB], [len(rachises), len(barbs)]),
        root=root,
    )
