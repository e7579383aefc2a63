"""The meshes of a stage that are drawn: those that stand for themselves, and instanced ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from featherfx.groom.keys.values import Place, Problems
from featherfx.usd.read.skinning import Skinning, find_skinning
from featherfx.usd.read.stage import SourceScene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Labels:
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
    labels: Labels | None
    skinning: Skinning | None = None


def drawn_meshes(stage: Any) -> Iterator[DrawnMesh]:
    """In the order of the stage; invisible prims and purposes of no picture are left out."""
    walk = iter(stage.Traverse())
    for prim in walk:
        if prim.IsA(UsdGeom.PointInstancer):
            # prototypes below an instancer are drawn by it only
            walk.PruneChildren()
            if _is_drawn(prim):
                yield from _instanced(prim)
        elif prim.IsA(UsdGeom.Mesh) and _is_drawn(prim):
            mesh = UsdGeom.Mesh(prim)
            skinning = _skinning(mesh)
            space = prim if skinning is None else skinning.space
            yield DrawnMesh(mesh, partial(_local_to_world, space), None, skinning)


def _skinning(mesh: Any) -> Skinning | None:
    """What a skeleton does to a mesh; None where none moves it, or it cannot."""
    stage = mesh.GetPrim().GetStage()
    scene = SourceScene(Path(stage.GetRootLayer().realPath), stage, np.eye(4))
    return find_skinning(scene, mesh, Place("", "", Problems()))


def _instanced(prim: Any) -> Iterator[DrawnMesh]:
    instances = Instances(prim)
    below: dict[Any, list[tuple[Any, Array]]] = {}
    for index, root in enumerate(instances.prims):
        path = root.GetPath()
        if path not in below:
            below[path] = list(_meshes_below(root))
        for mesh, inner in below[path]:
            labels = Labels(
                instances.label("featherId", index, f"{prim.GetName()}_{index}"),
                instances.label("featherKind", index, ""),
                instances.label("region", index, ""),
            )
            yield DrawnMesh(mesh, partial(_of_instance, instances, index, inner), labels)


def _meshes_below(root: Any) -> Iterator[tuple[Any, Array]]:
    """Meshes at or below a prototype with their transforms to its root's own space (4, 4)."""
    outer = np.linalg.inv(_local_to_world(root, Usd.TimeCode.Default()))
    for prim in Usd.PrimRange(root, Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.Mesh):
            to_root = _local_to_world(prim, Usd.TimeCode.Default()) @ outer
            yield UsdGeom.Mesh(prim), to_root


def _of_instance(instances: Instances, index: int, inner: Array, code: Any) -> Array:
    return inner @ instances.matrix(index, code)


def _local_to_world(prim: Any, code: Any) -> Array:
    return np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(code))


def _is_drawn(prim: Any) -> bool:
    image = UsdGeom.Imageable(prim)
    drawn = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
    return image.ComputePurpose() in drawn and (
        image.ComputeVisibility() != UsdGeom.Tokens.invisible
    )


class Instances:
    """The instances of one PointInstancer, read back: prototypes and transforms.

    prims: per instance, its prototype's root. labels: per instance, primvar names to texts.
    """

    def __init__(self, prim: Any) -> None:
        self._instancer = UsdGeom.PointInstancer(prim)
        targets = self._instancer.GetPrototypesRel().GetForwardedTargets()
        roots = [prim.GetStage().GetPrimAtPath(target) for target in targets]
        first = Usd.TimeCode.EarliestTime()
        indices = self._instancer.GetProtoIndicesAttr().Get(first)
        self.prims = [roots[index] for index in indices or []]
        self._labels = {}
        for name in ("featherId", "featherKind", "region"):
            primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)
            values = primvar.ComputeFlattened(first) if primvar and primvar.HasValue() else None
            if values is not None and len(values) == len(self.prims):
                self._labels[name] = values
        self._known: dict[Any, Array] = {}

    def label(self, name: str, index: int, fallback: str) -> str:
        """A text of one instance."""
        return str(self._labels[name][index]) if name in self._labels else fallback

    def matrix(self, index: int, code: Any) -> Array:
        """(4, 4) from the prototype's own space to the world at a time code, row vectors."""
        if code not in self._known:
            masked = UsdGeom.PointInstancer.IgnoreMask
            values = self._instancer.ComputeInstanceTransformsAtTime(
                code, code, UsdGeom.PointInstancer.IncludeProtoXform, masked
            )
            world = np.array(self._instancer.ComputeLocalToWorldTransform(code))
            self._known = {code: np.asarray(values).reshape(-1, 4, 4) @ world}
        return np.asarray(self._known[code][index])
