"""Drawn meshes of a stage: single ones, and instanced ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from featherfx.algebra.types import Array
from featherfx.groom.keys.groom import DRAWN_KEYS
from featherfx.groom.keys.problems import Place, Problems
from featherfx.phases import LeftOut
from featherfx.usd.read.skinning import Skinning, find_skinning
from featherfx.usd.read.stage import SourceScene, prims_below
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    EARLIEST_TIME,
    INTEGER_ARRAY,
    compute,
    describe_range,
    describe_time,
    fault,
    list_elements,
    list_transforms,
    read_flattened,
    read_inverse,
    read_matrix,
    read_sized_array,
    read_targets,
    read_text,
    read_times,
    read_value,
)
from featherfx.usd.types import BARB_COUNT_PRIMVAR

_RENDERED = {name: key.default for name, key in DRAWN_KEYS.items()}
MatrixAt = Callable[[Any], Array]  # (4, 4), row vectors, at a time code


@dataclass(frozen=True)
class FeatherLabels:
    """Id, kind and region of a feather, and its real barbs along each vane, None: not known."""

    id: str
    kind: str
    region: str
    barb_count: int | None


@dataclass(frozen=True)
class DrawnMesh:
    """A mesh, or one instance of it.

    matrix: from its own space to the world at a time code, (4, 4), row vectors. labels: what an
    instance says of itself, None for a mesh. skinning: of a mesh that a skeleton moves; its points
    are then in the space that matrix is of.
    """

    mesh: Any
    matrix: MatrixAt
    labels: FeatherLabels | None
    skinning: Skinning | None = None


def drawn_meshes(stage: Any) -> Iterator[DrawnMesh]:
    """Yield drawn meshes in the order of the stage, those of native instances included.

    Left out are invisible prims, other purposes, and prototypes but for their instances.
    """
    for prim in prims_below(stage.GetPseudoRoot()):
        if prim.IsA(UsdGeom.PointInstancer) and is_drawn(prim):
            yield from _instanced_meshes(prim)
        elif prim.IsA(UsdGeom.Mesh) and is_drawn(prim):
            mesh = UsdGeom.Mesh(prim)
            yield place_mesh(mesh, _find_skinning(mesh))


def place_mesh(mesh: Any, skinning: Skinning | None) -> DrawnMesh:
    """Return a mesh where its prim stands, or the skeleton that moves it."""
    space = mesh.GetPrim() if skinning is None else skinning.space
    if any(map(read_times, list_transforms(space))):
        return DrawnMesh(mesh, partial(read_matrix, space), None, skinning)
    still = _last_kept(partial(read_matrix, space))
    return DrawnMesh(mesh, lambda _: still(DEFAULT_TIME), None, skinning)


def _find_skinning(mesh: Any) -> Skinning | None:
    """Return the skinning of a mesh; None where no skeleton moves it."""
    stage = mesh.GetPrim().GetStage()
    scene = SourceScene(Path(stage.GetRootLayer().realPath), stage)
    return find_skinning(scene, mesh, Place("", "", Problems()))


def _instanced_meshes(prim: Any) -> Iterator[DrawnMesh]:
    instances = Instances(prim)
    parts = {root.GetPath(): list(_find_parts(root)) for root in instances.prims}
    for index, root in instances.drawn():
        for mesh, inner in parts[root.GetPath()]:
            barbs = instances.label(BARB_COUNT_PRIMVAR, index, "")
            labels = FeatherLabels(
                instances.label("featherId", index, f"{prim.GetName()}_{index}"),
                instances.label("featherKind", index, ""),
                instances.label("region", index, ""),
                int(barbs) if barbs.isdecimal() else None,
            )
            yield DrawnMesh(mesh, _product(inner, partial(instances.matrix, index)), labels)


def _find_parts(root: Any) -> Iterator[tuple[Any, MatrixAt]]:
    """Yield meshes of a prototype, with their matrices to its root's own space.

    An instancer in it has its own instances there.
    """
    back = _last_kept(partial(read_inverse, root))
    for prim in prims_below(root):
        if not is_drawn(prim, root):
            continue
        if prim.IsA(UsdGeom.Mesh):
            yield UsdGeom.Mesh(prim), _product(partial(read_matrix, prim), back)
        elif prim.IsA(UsdGeom.PointInstancer):
            inner = Instances(prim)
            for index, own in inner.drawn():
                placed = _product(partial(inner.matrix, index), back)
                for mesh, matrix in _find_parts(own):
                    yield mesh, _product(matrix, placed)


def _product(first: MatrixAt, second: MatrixAt) -> MatrixAt:
    return _last_kept(lambda code: first(code) @ second(code))


def _last_kept(matrix: MatrixAt) -> MatrixAt:
    """Return a function of a time code that computes anew only for another one."""
    known: dict[Any, Array] = {}

    def at(code: Any) -> Array:
        if code not in known:
            known.clear()
            known[code] = matrix(code)
        return known[code]

    return at


def is_drawn(prim: Any, root: Any = None) -> bool:
    """Return whether a prim is visible and of a purpose that is rendered.

    root: of a prototype, above which nothing hides it.
    """
    return not find_hidden(prim, _RENDERED, root)


def find_hidden(prim: Any, keys: Mapping[str, Any], root: Any = None) -> str:
    """Return why a prim is not drawn, with the key that draws it; empty where it is.

    keys: purposes and invisible, as of DRAWN_KEYS. root: as of is_drawn.
    """
    image = UsdGeom.Imageable(prim)
    purpose = str(compute(prim, image.ComputePurpose))
    is_chosen = keys is not _RENDERED
    if purpose not in keys["purposes"]:
        remedy = f'. Give purposes = ["{purpose}"] to read it' if is_chosen else ""
        return f"is of purpose {purpose}{remedy}"
    if keys["invisible"]:
        return ""
    hidden = UsdGeom.Tokens.invisible
    if root is None:
        is_hidden = compute(prim, image.ComputeVisibility) == hidden
    else:
        between = takewhile(lambda path: path.HasPrefix(root.GetPath()), _paths_above(prim))
        above = (UsdGeom.Imageable.Get(prim.GetStage(), path) for path in between)
        is_hidden = any(read_text(each.GetVisibilityAttr()) == hidden for each in above)
    remedy = ". Give invisible = true to read it" if is_chosen else ""
    return f"is invisible{remedy}" if is_hidden else ""


def list_undrawn(stage: Any) -> Iterator[LeftOut]:
    """Yield what drawn_meshes leaves out: hidden meshes, and shapes of other types that renderers
    draw, but for the curves of feathers."""
    for prim in prims_below(stage.GetPseudoRoot()):
        is_own = prim.IsA(UsdGeom.Curves) and prim.HasAttribute("primvars:featherId")
        if not prim.IsA(UsdGeom.Gprim) or is_own:
            continue
        reason = find_hidden(prim, _RENDERED)
        if prim.IsA(UsdGeom.Mesh) == bool(reason):
            yield LeftOut(str(prim.GetPath()), str(prim.GetTypeName()), reason or "is no mesh")


def _paths_above(prim: Any) -> Iterator[Any]:
    while prim:
        yield prim.GetPath()
        prim = prim.GetParent()


def instance_matrices(instancer: Any, code: Any) -> Array:
    """(N, 4, 4) from each prototype's own space to the instancer's at a time code, row vectors.

    By default, where places, turns or sizes have only samples, all are at the first of these.
    """
    instances = UsdGeom.PointInstancer
    if code.IsDefault():
        moving = (
            instancer.GetPositionsAttr,
            instancer.GetOrientationsAttr,
            instancer.GetScalesAttr,
        )
        sampled = [each() for each in moving if read_value(each()) is None]
        times = [code for each in sampled for code in read_times(each)[:1]]
        code = Usd.TimeCode(min(times)) if times else code
    found = compute(
        instancer.GetPrim(),
        instancer.ComputeInstanceTransformsAtTime,
        code,
        code,
        instances.IncludeProtoXform,
        instances.IgnoreMask,
    )
    return np.asarray(found, dtype=np.float64).reshape(-1, 4, 4)


def refuse_rings(prim: Any, above: tuple[Any, ...] = ()) -> None:
    """Raise InputError where prototypes of an instancer hold the instancer itself."""
    if prim.GetPath() in above:
        ring = " -> ".join(map(str, (*above, prim.GetPath())))
        raise fault(prim, f"its prototypes form a ring: {ring}. Remove one of them")
    for target in read_targets(UsdGeom.PointInstancer(prim).GetPrototypesRel()):
        root = prim.GetStage().GetPrimAtPath(target)
        for each in prims_below(root) if root else ():
            if each.IsA(UsdGeom.PointInstancer):
                refuse_rings(each, (*above, prim.GetPath()))


class Instances:
    """The instances of one PointInstancer, read back: prototypes and transforms.

    prims: per instance, its prototype's root.
    """

    def __init__(self, prim: Any) -> None:
        refuse_rings(prim)
        self._instancer = UsdGeom.PointInstancer(prim)
        targets = read_targets(self._instancer.GetPrototypesRel())
        roots = [prim.GetStage().GetPrimAtPath(target) for target in targets]
        for target, root in zip(targets, roots, strict=True):
            if not root:
                raise fault(prim, f"prototypes: there is no {target}")
        attribute = self._instancer.GetProtoIndicesAttr()
        indices = read_sized_array(attribute, EARLIEST_TIME, INTEGER_ARRAY).astype(np.int64)
        wrong = indices[(indices < 0) | (indices >= len(roots))]
        if len(wrong):
            raise fault(attribute, f"{wrong[0]} {describe_range(len(roots))}")
        self.prims = [roots[index] for index in indices]
        self._mask = compute(prim, self._instancer.ComputeMaskAtTime, EARLIEST_TIME)
        self._labels = {}
        for name in ("featherId", "featherKind", "region", BARB_COUNT_PRIMVAR):
            values = read_flattened(UsdGeom.PrimvarsAPI(prim).GetPrimvar(name), EARLIEST_TIME)
            if values is not None and len(list_elements(values)) == len(self.prims):
                self._labels[name] = list_elements(values)
        self._known: dict[Any, Array] = {}

    def drawn(self) -> Iterator[tuple[int, Any]]:
        """Yield the number and the prototype's root of each instance that is not masked."""
        for index, root in enumerate(self.prims):
            if not len(self._mask) or self._mask[index]:
                yield index, root

    def label(self, name: str, index: int, fallback: str) -> str:
        """A text of one instance."""
        return str(self._labels[name][index]) if name in self._labels else fallback

    def matrix(self, index: int, code: Any) -> Array:
        """(4, 4) from the prototype's own space to the world at a time code, row vectors."""
        if code not in self._known:
            instances = instance_matrices(self._instancer, code)
            if len(instances) != len(self.prims):
                prim = self._instancer.GetPrim()
                message = f"has {len(self.prims)} protoIndices and {len(instances)} transforms"
                raise fault(prim, f"{message} {describe_time(code)}")
            self._known = {code: instances @ read_matrix(self._instancer.GetPrim(), code)}
        return np.asarray(self._known[code][index])
