"""Drawn meshes of a stage: single ones, and instanced ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from featherfx.algebra.types import Array
from featherfx.groom.keys.problems import Place, Problems
from featherfx.usd.read.skinning import Skinning, find_skinning
from featherfx.usd.read.stage import SourceScene
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    EARLIEST_TIME,
    INTEGER_ARRAY,
    compute,
    describe_time,
    fault,
    list_elements,
    read_flattened,
    read_inverse,
    read_matrix,
    read_sized_array,
    read_targets,
)


@dataclass(frozen=True)
class FeatherLabels:
    """Id, kind and region of a feather."""

    id: str
    kind: str
    region: str


@dataclass(frozen=True)
class DrawnMesh:
    """A mesh, or one instance of it.

    matrix: from its own space to the world at a time code, (4, 4), row vectors. labels: what an
    instance says of itself, None for a mesh. skinning: of a mesh that a skeleton moves; its points
    are then in the space that matrix is of.
    """

    mesh: Any
    matrix: Callable[[Any], Array]
    labels: FeatherLabels | None
    skinning: Skinning | None = None


def drawn_meshes(stage: Any) -> Iterator[DrawnMesh]:
    """Yield drawn meshes in the order of the stage, without invisible prims and other purposes."""
    walk = iter(stage.Traverse())
    for prim in walk:
        if prim.IsA(UsdGeom.PointInstancer):
            # prototypes below an instancer are drawn by it only
            walk.PruneChildren()
            if is_drawn(prim):
                yield from _instanced_meshes(prim)
        elif prim.IsA(UsdGeom.Mesh) and is_drawn(prim):
            mesh = UsdGeom.Mesh(prim)
            skinning = _find_skinning(mesh)
            space = prim if skinning is None else skinning.space
            yield DrawnMesh(mesh, partial(read_matrix, space), None, skinning)


def _find_skinning(mesh: Any) -> Skinning | None:
    """Return the skinning of a mesh; None where no skeleton moves it."""
    stage = mesh.GetPrim().GetStage()
    scene = SourceScene(Path(stage.GetRootLayer().realPath), stage)
    return find_skinning(scene, mesh, Place("", "", Problems()))


def _instanced_meshes(prim: Any) -> Iterator[DrawnMesh]:
    instances = Instances(prim)
    below: dict[Any, list[tuple[Any, Array]]] = {}
    for index, root in enumerate(instances.prims):
        path = root.GetPath()
        if path not in below:
            below[path] = list(_meshes_below(root))
        for mesh, inner in below[path]:
            labels = FeatherLabels(
                instances.label("featherId", index, f"{prim.GetName()}_{index}"),
                instances.label("featherKind", index, ""),
                instances.label("region", index, ""),
            )
            yield DrawnMesh(mesh, partial(_instance_matrix, instances, index, inner), labels)


def _meshes_below(root: Any) -> Iterator[tuple[Any, Array]]:
    """Meshes at or below a prototype with their transforms to its root's own space (4, 4)."""
    outer = read_inverse(root, DEFAULT_TIME)
    for prim in Usd.PrimRange(root, Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.Mesh):
            yield UsdGeom.Mesh(prim), read_matrix(prim, DEFAULT_TIME) @ outer


def _instance_matrix(instances: Instances, index: int, inner: Array, code: Any) -> Array:
    return inner @ instances.matrix(index, code)


def is_drawn(prim: Any) -> bool:
    image = UsdGeom.Imageable(prim)
    drawn = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
    purpose = compute(prim, image.ComputePurpose)
    return purpose in drawn and (compute(prim, image.ComputeVisibility) != UsdGeom.Tokens.invisible)


def instance_matrices(instancer: Any, code: Any) -> Array:
    """(N, 4, 4) from each prototype's own space to the instancer's at a time code, row vectors."""
    instances = UsdGeom.PointInstancer
    found = compute(
        instancer.GetPrim(),
        instancer.ComputeInstanceTransformsAtTime,
        code,
        code,
        instances.IncludeProtoXform,
        instances.IgnoreMask,
    )
    return np.asarray(found, dtype=np.float64).reshape(-1, 4, 4)


class Instances:
    """The instances of one PointInstancer, read back: prototypes and transforms.

    prims: per instance, its prototype's root. labels: per instance, primvar names to texts.
    """

    def __init__(self, prim: Any) -> None:
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
            raise fault(attribute, f"{wrong[0]} is out of range. Give 0 to {len(roots) - 1}")
        self.prims = [roots[index] for index in indices]
        self._labels = {}
        for name in ("featherId", "featherKind", "region"):
            values = read_flattened(UsdGeom.PrimvarsAPI(prim).GetPrimvar(name), EARLIEST_TIME)
            if values is not None and len(list_elements(values)) == len(self.prims):
                self._labels[name] = list_elements(values)
        self._known: dict[Any, Array] = {}

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
