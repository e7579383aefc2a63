"""Feathers that move rigidly, as shapes that are turned and moved.

Whether one does is known after the last frame, so this is a step on a cache that is there. Of
the points x(t) of each feather's mesh the rotation and place are found that fit a shape p best, by
least squares (Kabsch, Acta Crystallographica A 32, 1976); p is the mean of all frames, each turned
back onto the first. Where R(t) p + c(t) is within the tolerance of x(t) at every sample and point,
the feather has p as its points and R and c as its transform, and leaves the prims that it shares.
Rachis and barbs go along, in their shape of the first sample, which is at most twice as far off.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pxr import Gf, Sdf, UsdGeom, Vt

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import along_rows, frames_to_quats, rotation_part
from featherfx.errors import InputError, Problem
from featherfx.phases import counted
from featherfx.usd import arrays
from featherfx.usd.arrays import vec3f
from featherfx.usd.convert.merge import begin_export, copy_layer, flatten_stage, notes_of
from featherfx.usd.types import ACCELERATIONS, BARB_DIRECTION, RANGES_PREFIX, RATES
from featherfx.usd.write.layers import FEATHERS_SCOPE, SCOPES
from featherfx.usd.write.output import unique_prim_names

# what follows from the transform, and what moves with it
_MOVED = ("points", "extent", "normals", BARB_DIRECTION)
_OF_POINTS = ("points", "velocities", ACCELERATIONS, "normals", "widths")
_OF_FACES = ("faceVertexCounts", "curveVertexCounts")
_LABELS = tuple(f"primvars:{name}" for name in ("featherId", "featherKind", "region"))
_TRANSLATE, _ORIENT = "xformOp:translate", "xformOp:orient"


class RigidMotion(NamedTuple):
    """A rigid feather. shape: (V, 3) about its middle. turns: (F, 3, 3). places: (F, 3)."""

    shape: Array
    turns: Array
    places: Array


def fit_rigid_motion(points: Array) -> tuple[RigidMotion, float]:
    """Return the rigid motion nearest to points (F, V, 3), and the largest error of any point.

    The first rotation of the motion is the identity.
    """
    places = points.mean(axis=1)
    about = points - places[:, None]
    shape = about[0]
    for _ in range(2):  # onto the first frame, then onto the mean
        turns = _fit_rotations(shape, about)
        shape = np.einsum("fij,fvi->vj", turns, about) / len(about)
    turns = _fit_rotations(shape, about)
    first = turns[0]
    shape, turns = shape @ first.T, turns @ first.T
    off = np.linalg.norm(np.einsum("fij,vj->fvi", turns, shape) - about, axis=2)
    return RigidMotion(shape, turns, places), float(off.max())


def _fit_rotations(shape: Array, about: Array) -> Array:
    """Return (F, 3, 3) rotations of a shape (V, 3) onto poses (F, V, 3) about their middles."""
    return rotation_part(np.einsum("fvi,vj->fij", about, shape))


@dataclass
class FeatherPrim:
    """A prim of feathers in a layer. points, faces: (M, 2) first and number of each."""

    spec: Any
    ids: list[str]
    points: Indices
    faces: Indices

    @property
    def alone(self) -> bool:
        return f"{RANGES_PREFIX}:points" not in self.spec.properties


def export_rigid(
    path: str | Path, output: str | Path, tolerance: float, overwrite: bool = False
) -> int:
    """Write a cache as one plain file whose rigid feathers are transforms; return their number.

    tolerance: mm, how far any point may be off at any sample. They have no velocities, which follow
    from the transforms. The samples of the whole cache are in memory. Raises InputError where the
    cache cannot be read or has no meshes that move, or the output not be written.
    """
    if not 0.0 < tolerance < np.inf:
        raise InputError(Problem("rigid", "", f"is {tolerance:g}. Give a value above 0 mm"))
    stage, written = begin_export(path, output, overwrite)
    layer = copy_layer(flatten_stage(stage))
    root = stage.GetDefaultPrim().GetPath()
    parts = {name: list(find_prims(layer, root.AppendChild(name))) for name, _ in SCOPES.values()}
    if not any(_time_codes(layer, each) for each in parts[FEATHERS_SCOPE]):
        raise InputError(
            Problem(str(path), "", "has no meshes of feathers that move. Give a baked cache")
        )
    allowed = 1e-3 * tolerance / UsdGeom.GetStageMetersPerUnit(stage)
    meshes = counted("checking", parts[FEATHERS_SCOPE], len(parts[FEATHERS_SCOPE]))
    found = dict(each for mesh in meshes for each in _find_rigid(layer, mesh, allowed))
    for scope, end in SCOPES.values():
        _write_scope(layer, parts[scope], found, end)
    told = {"rigid": len(found), "rigidWithin": tolerance}
    layer.customLayerData = {"featherfx": {**notes_of(stage), **told}}
    written(layer)
    return len(found)


def find_prims(layer: Any, scope: Any) -> Iterator[FeatherPrim]:
    """Yield the prims of feathers in a scope."""
    spec = layer.GetPrimAtPath(scope)
    for prim in () if spec is None else list(spec.nameChildren):
        if "primvars:featherId" not in prim.properties or "points" not in prim.properties:
            continue
        ids = list(prim.properties["primvars:featherId"].default)
        element = "faces" if "faceVertexCounts" in prim.properties else "curves"
        tables = [prim.properties.get(f"{RANGES_PREFIX}:{name}") for name in ("points", element)]
        if None in tables:
            names = ("points", *(name for name in _OF_FACES if name in prim.properties))
            counts = [len(prim.properties[name].default) for name in names]
            own = [np.array([[0, count]]) for count in counts]
        else:
            own = [np.asarray(table.default, dtype=np.int64) for table in tables]
        yield FeatherPrim(prim, ids, *own)


def _time_codes(layer: Any, prim: FeatherPrim) -> list[float]:
    return list(layer.ListTimeSamplesForPath(prim.spec.path.AppendProperty("points")))


def _find_rigid(
    layer: Any, prim: FeatherPrim, allowed: float
) -> Iterator[tuple[str, tuple[Any, RigidMotion]]]:
    """Yield the feathers of a mesh that move rigidly, with the codes of their motion."""
    codes = _time_codes(layer, prim)
    if not codes:
        return
    path = prim.spec.path.AppendProperty("points")
    samples = [np.asarray(layer.QueryTimeSample(path, code)) for code in codes]
    for id, (first, number) in zip(prim.ids, prim.points, strict=True):
        own = np.stack([each[first : first + number] for each in samples]).astype(np.float64)
        motion, off = fit_rigid_motion(own)
        if off <= allowed:
            yield id, (codes, motion)


def _write_scope(layer: Any, prims: Sequence[FeatherPrim], found: dict[str, Any], end: str) -> None:
    """Give rigid feathers prims of their own, with transforms."""
    taken = [prim.spec.name for prim in prims]
    for prim in prims:
        chosen = [k for k, id in enumerate(prim.ids) if id in found]
        if prim.alone:
            for k in chosen:
                _author_transform(layer, prim.spec.path, *found[prim.ids[k]])
            continue
        if not chosen:
            continue
        scope, own = prim.spec.path.GetParentPath(), [prim.ids[k] for k in chosen]
        names = unique_prim_names([*taken, *(id + end for id in own)])[len(taken) :]
        taken += names
        for k, id, name in zip(chosen, own, names, strict=True):
            _copy_feathers(layer, prim, _FeatherCut(prim, [k], True), scope.AppendChild(name))
            _author_transform(layer, scope.AppendChild(name), *found[id])
        rest = [k for k in range(len(prim.ids)) if k not in set(chosen)]
        path = prim.spec.path
        if rest:
            _copy_feathers(layer, prim, _FeatherCut(prim, rest, False), scope.AppendChild("__rest"))
            _update_extents(layer, scope.AppendChild("__rest"))
        del layer.GetPrimAtPath(scope).nameChildren[path.name]
        if rest:
            layer.GetPrimAtPath(scope.AppendChild("__rest")).name = path.name


def _update_extents(layer: Any, path: Any) -> None:
    """Set the extents of a prim that has lost points."""
    points, extent = (path.AppendProperty(name) for name in ("points", "extent"))
    attribute = layer.GetAttributeAtPath(extent)
    attribute.default = extent_of(layer, path, layer.GetAttributeAtPath(points).default)
    for code in layer.ListTimeSamplesForPath(extent):
        layer.SetTimeSample(
            extent, code, extent_of(layer, path, layer.QueryTimeSample(points, code))
        )


def extent_of(layer: Any, path: Any, points: Any) -> Any:
    """Return the extent of points of a prim, as a USD array."""
    found, widths = np.asarray(points), layer.GetAttributeAtPath(path.AppendProperty("widths"))
    pad = np.float32(0.5) * np.float32(np.max(widths.default) if widths else 0.0)
    return vec3f([found.min(axis=0) - pad, found.max(axis=0) + pad])


def _copy_feathers(layer: Any, prim: FeatherPrim, cut: _FeatherCut, path: Any) -> None:
    """Author a prim with some of the feathers of another."""
    Sdf.CreatePrimInLayer(layer, path)
    made = layer.GetPrimAtPath(path)
    made.specifier, made.typeName = prim.spec.specifier, prim.spec.typeName
    _copy_infos(prim.spec, made, ("specifier", "typeName"))
    for each in prim.spec.properties:
        if isinstance(each, Sdf.RelationshipSpec):
            Sdf.CopySpec(layer, each.path, layer, path.AppendProperty(each.name))
        else:
            cut.copy(layer, each, path.AppendProperty(each.name))
    for child in prim.spec.nameChildren:  # subsets
        below = path.AppendChild(child.name)
        Sdf.CopySpec(layer, child.path, layer, below)
        indices = cut.renumbered("faces", np.asarray(child.properties["indices"].default))
        layer.GetAttributeAtPath(below.AppendProperty("indices")).default = arrays.ints(indices)
        if not len(indices):
            del made.nameChildren[child.name]


def _copy_infos(source: Any, target: Any, left_out: Sequence[str]) -> None:
    for key in source.ListInfoKeys():
        if key not in left_out and key not in ("default", "timeSamples"):
            target.SetInfo(key, source.GetInfo(key))


class _FeatherCut:
    """Values of some of the feathers of a prim.

    alone: of one feather that will move rigidly; its values are constant.
    """

    def __init__(self, prim: FeatherPrim, chosen: Sequence[int], alone: bool) -> None:
        self._prim, self._chosen, self._alone = prim, list(chosen), alone
        tables = {"points": prim.points, "faces": prim.faces}
        self._own = {
            name: np.concatenate([np.arange(a, a + n) for a, n in table[self._chosen]])
            for name, table in tables.items()
        }
        self._totals = {name: int(table.sum(axis=0)[1]) for name, table in tables.items()}

    def renumbered(self, name: str, indices: Any) -> Indices:
        """Return new numbers of the points or faces that are copied; the others are left out."""
        number = np.full(self._totals[name], -1)
        number[self._own[name]] = np.arange(len(self._own[name]))
        found = number[indices]
        return np.asarray(found[found >= 0])

    def copy(self, layer: Any, source: Any, path: Any) -> None:
        """Copy an attribute to another path.

        A single feather keeps the first sample of attributes that lose their samples.
        """
        name = source.name
        if name in _LABELS:
            self._label(layer, source, path)
        if name.removesuffix(":indices") in _LABELS or (
            self._alone and name.startswith(RANGES_PREFIX)
        ):
            return
        made = _copy_attribute(layer, source, path)
        if source.HasDefaultValue():
            made.default = self._value(source, source.default)
        each = made.HasInfo("interpolation") and made.GetInfo("interpolation") == "uniform"
        of_feathers = "curveVertexCounts" in self._prim.spec.properties and name != "primvars:side"
        if self._alone and each and of_feathers:
            made.SetInfo("interpolation", UsdGeom.Tokens.constant)
        codes = layer.ListTimeSamplesForPath(source.path)
        for code in codes[:1] if self._alone and name in (*_MOVED, *RATES) else codes:
            layer.SetTimeSample(
                path, code, self._value(source, layer.QueryTimeSample(source.path, code))
            )

    def _label(self, layer: Any, source: Any, path: Any) -> None:
        """Author a label of the copied feathers in the form of the cache writer."""
        indices = self._prim.spec.properties.get(f"{source.name}:indices")
        first = self._prim.faces[self._chosen][:, 0]
        values, made = source.default, _copy_attribute(layer, source, path)
        if source.name == _LABELS[0]:
            texts = [self._prim.ids[k] for k in self._chosen]
        else:
            at = first if indices is None else np.asarray(indices.default)[first]
            texts = [values[int(k)] for k in at]
        place = {text: k for k, text in enumerate(dict.fromkeys(texts))}
        made.default = arrays.strings(*place)
        if self._alone:
            made.SetInfo("interpolation", UsdGeom.Tokens.constant)
            return
        counts = self._prim.faces[self._chosen][:, 1]
        of_each = np.repeat([place[text] for text in texts], counts)
        if len(of_each) > len(place) or indices is not None:
            own = path.GetParentPath().AppendProperty(f"{source.name}:indices")
            Sdf.JustCreatePrimAttributeInLayer(layer, own, Sdf.ValueTypeNames.IntArray)
            layer.GetAttributeAtPath(own).default = arrays.ints(of_each)

    def _value(self, source: Any, value: Any) -> Any:
        name, chosen = source.name, self._chosen
        if name.startswith(RANGES_PREFIX):
            table = self._prim.points if name.endswith("points") else self._prim.faces
            counts = table[chosen][:, 1]
            starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
            return arrays.vec2i(np.stack([starts, counts], axis=1))
        if name == "faceVertexIndices":
            corners = np.asarray(value).reshape(-1, 3)[self._own["faces"]]
            return arrays.ints(self.renumbered("points", corners.ravel()))
        domain = self._domain(source)
        if not domain or not hasattr(value, "__len__") or not len(value):
            return value
        if source.HasInfo("interpolation") and f"{name}:indices" in self._prim.spec.properties:
            return value
        elements, own = max(1, len(value) // self._totals[domain]), self._own[domain]
        if elements > 1:
            own = (own[:, None] * elements + np.arange(elements)).ravel()
        if isinstance(value, Vt.StringArray):
            return arrays.strings(*(value[int(k)] for k in own))
        return type(value).FromNumpy(np.ascontiguousarray(np.asarray(value)[own]))

    def _domain(self, source: Any) -> str:
        """Return the elements that a value belongs to: points, faces (or curves), or none."""
        if source.name in _OF_POINTS:
            return "points"
        if source.name in _OF_FACES:
            return "faces"
        if source.name.endswith(":indices"):
            source = self._prim.spec.properties[source.name.removesuffix(":indices")]
        kind = source.GetInfo("interpolation") if source.HasInfo("interpolation") else ""
        return {"vertex": "points", "uniform": "faces"}.get(str(kind), "")


def _copy_attribute(layer: Any, source: Any, path: Any) -> Any:
    """Author an attribute like another one, without its values."""
    Sdf.JustCreatePrimAttributeInLayer(
        layer, path, source.typeName, source.variability, source.custom
    )
    made = layer.GetAttributeAtPath(path)
    _copy_infos(source, made, ("typeName", "variability", "custom"))
    return made


def _author_transform(layer: Any, path: Any, codes: Sequence[float], motion: RigidMotion) -> None:
    """Author a prim of one feather as a constant shape with an animated transform.

    Rachises and barbs have their shape of the first sample, without rotation.
    """
    spec = layer.GetPrimAtPath(path)
    for each in list(spec.properties):
        sampled = layer.ListTimeSamplesForPath(each.path)
        values = [layer.QueryTimeSample(each.path, code) for code in sampled]
        # of diagnostics, those that change go on
        if values and (each.name in _MOVED or all(value == values[0] for value in values)):
            each.default = values[0]
            for code in sampled:
                layer.EraseTimeSample(each.path, code)
    points = spec.properties["points"]
    is_mesh = "faceVertexCounts" in spec.properties
    shape = motion.shape if is_mesh else np.asarray(points.default) - motion.places[0]
    points.default = vec3f(shape)
    spec.properties["extent"].default = extent_of(layer, path, shape)
    for name in RATES:
        if name in spec.properties:
            spec.RemoveProperty(spec.properties[name])
    quats = along_rows(frames_to_quats(motion.turns))
    translate, orient = (path.AppendProperty(name) for name in (_TRANSLATE, _ORIENT))
    Sdf.JustCreatePrimAttributeInLayer(layer, translate, Sdf.ValueTypeNames.Float3)
    Sdf.JustCreatePrimAttributeInLayer(layer, orient, Sdf.ValueTypeNames.Quatf)
    for own, course in (
        (translate, [Gf.Vec3f(*place) for place in motion.places.tolist()]),
        (orient, [Gf.Quatf(*turn) for turn in quats.tolist()]),
    ):
        layer.GetAttributeAtPath(own).default = course[0]
        if any(value != course[0] for value in course):
            for code, value in zip(codes, course, strict=True):
                layer.SetTimeSample(own, code, value)
    order = path.AppendProperty("xformOpOrder")
    Sdf.JustCreatePrimAttributeInLayer(
        layer, order, Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform
    )
    layer.GetAttributeAtPath(order).default = Vt.TokenArray([_TRANSLATE, _ORIENT])
