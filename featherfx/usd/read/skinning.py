"""Meshes that a skeleton moves: points by USD's own skinning, blend shapes included."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdSkel, Vt

from featherfx.groom.keys.values import Place
from featherfx.usd.read.stage import DEFAULT, EARLIEST, SourceScene

Floats = NDArray[np.float32]


class Skinning:
    """One mesh under one skeleton. space: the prim in whose space the points are."""

    def __init__(self, mesh: Any, skeleton: Any, skinning: Any, cache: Any) -> None:
        self._mesh, self._skeleton, self._skinning = mesh, skeleton, skinning
        self._cache = cache  # owns what the queries refer to
        binding = UsdSkel.BindingAPI(mesh.GetPrim())
        # of the instance; the query of a skeleton in an instance answers for its prototype
        self.space = binding.GetInheritedSkeleton().GetPrim()
        self._shapes = UsdSkel.BlendShapeQuery(binding) if skinning.HasBlendShapes() else None
        if self._shapes is not None:
            self._shape_points = self._shapes.ComputeBlendShapePointIndices()
            self._shape_offsets = self._shapes.ComputeSubShapePointOffsets()

    def points(self, code: Any) -> Any:
        """(V, 3) skinned points in the skeleton's space at a time code."""
        points = self.shaped(code)
        if not self._skinning.HasJointInfluences():
            return self._bound(points)
        transforms = self._skeleton.ComputeSkinningTransforms(code)
        self._skinning.ComputeSkinnedPoints(transforms, points, code)
        return points

    def bind_points(self) -> Floats:
        """(V, 3) points of the bind pose in the skeleton's space."""
        return self._bound(self._mesh_points(DEFAULT))

    def attributes(self) -> list[Any]:
        """What moves the skeleton, for its time samples."""
        query = self._skeleton.GetAnimQuery()
        if not query:
            return []
        animation = UsdSkel.Animation(query.GetPrim())
        if not animation:
            return []
        return [
            animation.GetTranslationsAttr(),
            animation.GetRotationsAttr(),
            animation.GetScalesAttr(),
            animation.GetBlendShapeWeightsAttr(),
        ]

    def _mesh_points(self, code: Any) -> Any:
        value = self._mesh.GetPointsAttr().Get(code)
        return self._mesh.GetPointsAttr().Get(EARLIEST) if value is None else value

    def _bound(self, points: Any) -> Floats:
        bind = np.array(self._skinning.GetGeomBindTransform(EARLIEST))
        return (np.asarray(points) @ bind[:3, :3] + bind[3, :3]).astype(np.float32)

    def shaped(self, code: Any) -> Any:
        """The mesh's points moved by its blend shapes; an array of our own."""
        points = np.array(self._mesh_points(code), dtype=np.float32)
        query = self._skeleton.GetAnimQuery()
        if self._shapes is not None and query:
            weights = query.ComputeBlendShapeWeights(code)
            mapper = self._skinning.GetBlendShapeMapper()
            if mapper is not None:
                weights = mapper.Remap(weights)
            weights, shapes, parts = self._shapes.ComputeSubShapeWeights(weights)
            for weight, shape, part in zip(weights, shapes, parts, strict=True):
                offsets = np.asarray(self._shape_offsets[part])
                chosen = np.asarray(self._shape_points[shape])
                points[chosen if len(chosen) else slice(None)] += np.float32(weight) * offsets
        return Vt.Vec3fArray.FromNumpy(points)


def find_skinning(scene: SourceScene, mesh: Any, place: Place) -> Skinning | None:
    """The skinning of a mesh, None where no skeleton moves it or after adding a problem."""
    root = UsdSkel.Root.Find(mesh.GetPrim())
    if not root:
        return None
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.TraverseInstanceProxies())
    query = cache.GetSkinningQuery(mesh.GetPrim())
    if not query or not (query.HasJointInfluences() or query.HasBlendShapes()):
        return None
    path = f"{mesh.GetPath()} in {scene.path}"
    skeleton_prim = UsdSkel.BindingAPI(mesh.GetPrim()).GetInheritedSkeleton()
    skeleton = cache.GetSkelQuery(skeleton_prim) if skeleton_prim else None
    if not skeleton:
        place.fail(f"{path}: has joint influences, but skel:skeleton names no valid skeleton")
        return None
    skinning = Skinning(mesh, skeleton, query, cache)
    if query.HasJointInfluences():
        transforms = skeleton.ComputeSkinningTransforms(EARLIEST)
        points = skinning.shaped(EARLIEST)
        if transforms is None or not query.ComputeSkinnedPoints(transforms, points, EARLIEST):
            place.fail(f"{path}: USD cannot skin it; joints, weights and bind pose do not fit")
            return None
    return skinning
