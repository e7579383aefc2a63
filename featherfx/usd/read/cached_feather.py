"""Feathers of a mesh: their constant parts, and the ranges of those that share it.

A shared prim has featherId, featherKind and region for each face or curve. Its tables list the
first and the number of each feather's points, faces or curves, in the order of featherId's values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from pxr import UsdGeom

from featherfx.algebra.triangulation import triangulate
from featherfx.algebra.types import Floats, Indices
from featherfx.errors import InputError, warn_input
from featherfx.feather.types import LEADING
from featherfx.groom.materials import BarbLook, look_of
from featherfx.usd.read.mesh_topology import read_topology
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    EARLIEST_TIME,
    INTEGER_ARRAY,
    NUMBER_ARRAY,
    PAIR_ARRAY,
    VECTOR_ARRAY,
    ArrayKind,
    fault,
    list_elements,
    read_array,
    read_flattened,
    read_sized_array,
    read_text,
    read_texts,
    to_numpy,
)
from featherfx.usd.types import BARB_COUNT_PRIMVAR, LOOK_PRIMVAR, RANGES_PREFIX

Shared = TypeVar("Shared", str, int)
_PAIRS = ArrayKind("iu", (2,), "an array of pairs of integers")


@dataclass(frozen=True)
class FeatherMember:
    """One feather of a prim.

    points, faces: (first, number) of its own, None for all; faces of a mesh, else curves. look: of
    its barbs, as text. barb_count: of these, 0: not known.
    """

    id: str
    kind: str
    region: str
    points: tuple[int, int] | None = None
    faces: tuple[int, int] | None = None
    look: str = ""
    barb_count: int = 0


def read_members(prim: Any) -> list[FeatherMember]:
    """Return the feathers of a prim that several share; none for any other prim.

    Raises InputError where the tables do not fit each other.
    """
    element = "faces" if prim.IsA(UsdGeom.Mesh) else "curves"
    points, faces = _read_ranges(prim, "points"), _read_ranges(prim, element)
    if points is None or faces is None:
        return []
    ids = read_texts(_primvar(prim, "featherId").GetAttr())
    if not len(ids) == len(points) == len(faces):
        told = f"names {len(ids)} feathers, and {RANGES_PREFIX} {len(points)} and {len(faces)}"
        raise fault(_primvar(prim, "featherId").GetAttr(), told)
    kinds, regions, looks = (
        _read_labels(prim, name, faces) for name in ("featherKind", "region", LOOK_PRIMVAR)
    )
    counts = _first_values(_primvar(prim, BARB_COUNT_PRIMVAR), _read_barb_counts(prim), faces, 0)
    ranges = (map(tuple, table.tolist()) for table in (points, faces))
    return [
        FeatherMember(*each)
        for each in zip(ids, kinds, regions, *ranges, looks, counts, strict=True)
    ]


def _read_barb_counts(prim: Any) -> list[int]:
    found = read_array(_primvar(prim, BARB_COUNT_PRIMVAR).GetAttr(), DEFAULT_TIME, INTEGER_ARRAY)
    return [] if found is None else np.maximum(found, 0).astype(int).tolist()


def _read_ranges(prim: Any, name: str) -> Indices | None:
    """Return (M, 2) first and number; None where there is no such table."""
    attribute = prim.GetAttribute(f"{RANGES_PREFIX}:{name}")
    found = read_array(attribute, DEFAULT_TIME, _PAIRS)
    if found is None:
        return None
    found = found.astype(np.int64)
    if (found < 0).any() or (found[1:, 0] != found[:-1].sum(axis=1)).any() or found[:1, 0].any():
        raise fault(attribute, "is no table of first and number, each range after the one before")
    return found


def _read_labels(prim: Any, name: str, faces: Indices) -> Sequence[str]:
    """Return a label of each feather: of its first face or curve, empty where it has none."""
    primvar = _primvar(prim, name)
    return _first_values(primvar, read_texts(primvar.GetAttr()), faces, "")


def _first_values(
    primvar: Any, values: Sequence[Shared], faces: Indices, none: Shared
) -> list[Shared]:
    """Return values of an indexed or plain primvar at each feather's first face or curve."""
    indices = np.arange(len(values))
    if primvar and primvar.IsIndexed():
        indices = read_sized_array(primvar.GetIndicesAttr(), DEFAULT_TIME, INTEGER_ARRAY).astype(
            np.int64
        )
    if not ((indices >= 0) & (indices < len(values))).all():
        raise fault(primvar.GetAttr(), "its indices do not fit its values")
    inside = (faces[:, 1] > 0) & (faces[:, 0] < len(indices))
    return [values[indices[k]] if own else none for k, own in zip(faces[:, 0], inside, strict=True)]


def _primvar(prim: Any, name: str) -> Any:
    return UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)


@dataclass(frozen=True)
class CachedFeather:
    """Constant part of one feather: of a mesh, or of its range in a shared mesh.

    path: of the mesh. name: for prims and files: that of the mesh, or the id; a Cache makes it
    valid and unique. id, kind, region: labels (id: the prim's name where none is authored).
    is_feather: whether an id is authored. triangles: (T, 3) point indices; side: (T,) 0 leading, 1
    trailing, 2 rachis (0 where unknown). face: (T,) face of each triangle. subsets: name to face
    indices. rest: (V, 3), st: (V, 2) and colour: (V, 3), displayColor (the mean of a point's faces
    where it is of faces), None where not authored. film: (V,) nm, of iridescent feathers; else
    None. look: of its barbs. barb_count: real ones along each vane, 0: not known.
    """

    path: str
    name: str
    id: str
    kind: str
    region: str
    triangles: Indices
    side: Indices
    face: Indices
    subsets: Mapping[str, Indices]
    rest: Floats | None
    st: Floats | None
    colour: Floats | None
    is_feather: bool
    look: BarbLook = BarbLook()
    barb_count: int = 0
    film: Floats | None = None


def read_mesh_feathers(mesh: Any) -> list[tuple[FeatherMember, CachedFeather]]:
    """Return the feathers of a mesh: itself, or those that share it; none without faces.

    Raises InputError for a feather without faces.
    """
    prim = mesh.GetPrim()
    if not has_faces(mesh):
        told = f"{prim.GetPath()} has no faces and is left out"
        warn_input(told)
        return []
    whole = _read_whole_mesh(mesh)
    members = read_members(prim)
    if not members:
        return [(FeatherMember(whole.id, whole.kind, whole.region), whole)]
    points, faces = (np.array([getattr(m, name) for m in members]) for name in ("points", "faces"))
    ends = points[-1].sum(), faces[-1].sum()
    total = int(whole.triangles.max(initial=-1)) + 1
    if ends[0] < total or ends[1] <= whole.face.max(initial=-1):
        told = f"tell of {ends[0]} points and {ends[1]} faces, fewer than the mesh has"
        raise fault(prim.GetAttribute(f"{RANGES_PREFIX}:points"), told)
    cuts = np.searchsorted(whole.face, [*faces[:, 0], ends[1]])
    whole = replace(whole, subsets={name: np.sort(each) for name, each in whole.subsets.items()})
    own = [_cut_feather(whole, member, slice(*cuts[k : k + 2])) for k, member in enumerate(members)]
    if not all(own):
        told = "do not fit the faces, which name points of other feathers. Bake it again"
        raise fault(prim.GetAttribute(f"{RANGES_PREFIX}:points"), told)
    return [
        (member, replace(each, look=_read_look(prim, member.look), barb_count=member.barb_count))
        for member, each in zip(members, own, strict=True)
        if each
    ]


def has_faces(mesh: Any) -> bool:
    """Return whether a mesh has faces. Raises InputError for a feather without."""
    prim, attribute = mesh.GetPrim(), mesh.GetFaceVertexCountsAttr()
    found = len(read_sized_array(attribute, EARLIEST_TIME, INTEGER_ARRAY)) > 0
    if not found and prim.HasAttribute("primvars:featherId"):
        raise fault(attribute, "is empty: the feather has no faces. Bake it again")
    return found


def _cut_feather(
    whole: CachedFeather, member: FeatherMember, triangles: slice
) -> CachedFeather | None:
    """Return a feather's part of a mesh; None where its faces use points of others."""
    points, (first, count) = range_slice(member.points), member.faces or (0, 0)
    own = whole.triangles[triangles] - points.start
    if own.min(initial=0) < 0 or own.max(initial=-1) >= points.stop - points.start:
        return None
    subsets = {
        name: each[slice(*np.searchsorted(each, [first, first + count]))] - first
        for name, each in whole.subsets.items()
    }
    rest, st, colour, film = (
        None if each is None else each[points]
        for each in (whole.rest, whole.st, whole.colour, whole.film)
    )
    return CachedFeather(
        path=whole.path,
        name=member.id,
        id=member.id,
        kind=member.kind,
        region=member.region,
        triangles=own,
        side=whole.side[triangles],
        face=whole.face[triangles] - first,
        subsets={name: each for name, each in subsets.items() if len(each)},
        rest=rest,
        st=st,
        colour=colour,
        is_feather=True,
        film=film,
    )


def _read_whole_mesh(mesh: Any) -> CachedFeather:
    """Return a mesh as one feather."""
    prim = mesh.GetPrim()
    primvars = UsdGeom.PrimvarsAPI(prim)
    counts, indices = read_topology(mesh)
    points = read_sized_array(mesh.GetPointsAttr(), EARLIEST_TIME, VECTOR_ARRAY)
    total = len(points)
    inside = ((indices >= 0) & (indices < total)).all()
    if (counts < 0).any() or counts.sum() != len(indices) or not inside:
        raise fault(mesh.GetFaceVertexIndicesAttr(), "do not fit the mesh's points and counts")
    corners, face, _ = triangulate(counts, indices, points)

    def label(name: str, fallback: str) -> str:
        return read_text(primvars.GetPrimvar(name).GetAttr()) or fallback

    def own(name: str, kind: ArrayKind, count: int) -> Any:
        found = read_array(primvars.GetPrimvar(name).GetAttr(), EARLIEST_TIME, kind)
        return found if found is None or len(found) == count else None

    side = own("side", INTEGER_ARRAY, len(counts))
    authored = read_text(primvars.GetPrimvar("featherId").GetAttr())
    subsets = UsdGeom.Subset.GetAllGeomSubsets(mesh)
    return CachedFeather(
        path=str(prim.GetPath()),
        name=prim.GetName(),
        id=authored or prim.GetName(),
        kind=label("featherKind", ""),
        region=label("region", ""),
        triangles=indices[corners],
        side=np.full(len(face), LEADING) if side is None else side.astype(np.int64)[face],
        face=face,
        subsets={
            s.GetPrim().GetName(): read_sized_array(
                s.GetIndicesAttr(), EARLIEST_TIME, INTEGER_ARRAY
            ).astype(np.int64)
            for s in subsets
        },
        rest=own("rest", VECTOR_ARRAY, total),
        st=own("st", PAIR_ARRAY, total),
        colour=_vertex_colours(
            primvars.FindPrimvarWithInheritance("displayColor"), counts, indices, total
        ),
        is_feather=bool(authored),
        look=_read_look(prim, label(LOOK_PRIMVAR, "")),
        barb_count=next(iter(_read_barb_counts(prim)), 0),
        film=own("filmThickness", NUMBER_ARRAY, total),
    )


def _read_look(prim: Any, text: str) -> BarbLook:
    """Return the look of barbs of a mesh."""
    try:
        return look_of(text)
    except InputError as error:
        attribute = prim.GetAttribute(f"primvars:{LOOK_PRIMVAR}")
        raise fault(attribute, str(error)) from error


def _vertex_colours(primvar: Any, counts: Any, indices: Any, total: int) -> Floats | None:
    """Return (V, 3) of a colour primvar of any interpolation; None where none fits the mesh."""
    value = read_flattened(primvar, EARLIEST_TIME)
    if value is None or not len(indices):
        return None
    colours = to_numpy(list_elements(value), VECTOR_ARRAY, primvar.GetAttr()).astype(np.float32)
    if len(colours) == 1:
        return np.repeat(colours, total, axis=0)
    interpolation = str(primvar.GetInterpolation())
    if interpolation == UsdGeom.Tokens.uniform and len(colours) == len(counts):
        colours = np.repeat(colours, counts, axis=0)
    elif interpolation != UsdGeom.Tokens.faceVarying or len(colours) != len(indices):
        return colours if len(colours) == total else None
    around = np.maximum(np.bincount(indices, minlength=total), 1)
    sums = [np.bincount(indices, colours[:, k], total) for k in range(3)]
    return np.asarray(np.stack(sums, axis=1) / around[:, None], dtype=np.float32)


def range_slice(own: tuple[int, int] | None) -> slice:
    return slice(None) if own is None else slice(own[0], own[0] + own[1])


def parse_texts(prim: Any, name: str, read: Callable[[str], Any], count: int) -> list[Any]:
    """Return the values of a primvar of texts for so many feathers of a prim.

    Raises InputError where there are not as many, or `read` refuses one.
    """
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)
    attribute = prim.GetAttribute(f"primvars:{name}")
    texts = read_texts(primvar.GetAttr()) if primvar else []
    places = np.arange(len(texts))
    if primvar and primvar.IsIndexed():
        places = read_sized_array(primvar.GetIndicesAttr(), DEFAULT_TIME, INTEGER_ARRAY).astype(
            np.int64
        )
    if len(places) != count or not ((places >= 0) & (places < len(texts))).all():
        raise fault(attribute, f"has not one value for each of {count} feathers")
    try:
        known = [read(text) for text in texts]
    except (ValueError, InputError) as error:
        raise fault(attribute, str(error)) from error
    return [known[k] for k in places]


def single_member(prim: Any) -> FeatherMember:
    """Return the feather of a prim of its own."""
    primvars = UsdGeom.PrimvarsAPI(prim)
    names = ("featherId", "featherKind", "region")
    id, kind, region = (read_text(primvars.GetPrimvar(name).GetAttr()) or "" for name in names)
    return FeatherMember(id, kind, region)
