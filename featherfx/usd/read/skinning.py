"""Meshes that a skeleton moves: points by USD's own skinning, blend shapes included."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdSkel, Vt

from featherfx.algebra.types import Array, Floats, Indices
from featherfx.errors import warn_input
from featherfx.groom.keys.problems import Place, Problems
from featherfx.usd.read.stage import SourceScene, prims_below
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    EARLIEST_TIME,
    VECTOR_ARRAY,
    describe_time,
    fault,
    read_array,
    read_sized_array,
    read_targets,
    usd_errors,
)

# properties of a mesh that a skeleton or its blend shapes move; the first two are inherited
_BINDINGS = (
    "skel:skeleton",
    "skel:animationSource",
    "primvars:skel:jointIndices",
    "skel:blendShapeTargets",
)
_MISFIT = "joints, weights and bind pose do not fit"


class SkinPose(NamedTuple):
    """Pose of a skinned mesh.

    joints: (J, 4, 4) matrices in their parents' space (row vectors). weights: (B,) of its blend
    shapes. points: (V, 3) of the mesh.
    """

    joints: Array
    weights: Array
    points: NDArray[Any]


class JointSpaces(NamedTuple):
    """Spaces of the J joints of a skeleton; matrices are of row vectors.

    parents: of each joint, below 0 without one. inverse_binds: (J, 4, 4) from the skeleton's space
    to the joints' in the bind pose.
    """

    parents: Sequence[int]
    inverse_binds: Array

    @staticmethod
    def of(skeleton: Any) -> JointSpaces:
        """Return those of a skeleton's query."""
        binds = np.linalg.inv(np.array(skeleton.GetJointWorldBindTransforms()))
        return JointSpaces(list(skeleton.GetTopology().GetParentIndices()), binds)

    def stack(self, joints: Array) -> Array:
        """(J, 4, 4) from joints, which stand so in their parents' space, to the skeleton's."""
        found = joints.copy()
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                found[joint] = found[joint] @ found[parent]
        return found

    def from_bind(self, joints: Array) -> Array:
        """(J, 4, 4) from the bind pose to a pose whose joints stand so in their parents' space."""
        return np.asarray(self.inverse_binds @ self.stack(joints))


class Skinning:
    """One mesh under one skeleton. space: the prim in whose space the points are. first: (V, 3)
    points at the first samples of all that moves it, None where joints do not."""

    first: NDArray[Any] | None = None

    def __init__(self, mesh: Any, skeleton: Any, skinning: Any, cache: Any) -> None:
        self._mesh, self._skeleton, self._skinning = mesh, skeleton, skinning
        self._cache = cache  # owns what the queries refer to
        binding = UsdSkel.BindingAPI(mesh.GetPrim())
        # of the instance; the query of a skeleton in an instance answers for its prototype
        self.space = binding.GetInheritedSkeleton().GetPrim()
        self._shapes = UsdSkel.BlendShapeQuery(binding) if skinning.HasBlendShapes() else None
        if self._shapes is not None:
            self._shape_points, self._shape_offsets = _blend_shapes(self._shapes, mesh)

    def points(self, code: Any) -> Floats:
        """(V, 3) skinned points in the skeleton's space at a time code."""
        with usd_errors(self._mesh.GetPrim()):
            points = self._shaped(self._mesh_points(code), self._shape_weights(code))
            if not self._skinning.HasJointInfluences():
                return self._bound(np.asarray(points))
            transforms = self._skeleton.ComputeSkinningTransforms(code)
            if transforms is None or not self._skinning.ComputeSkinnedPoints(
                transforms, points, code
            ):
                raise fault(
                    self._mesh.GetPrim(), f"USD cannot skin it {describe_time(code)}; {_MISFIT}"
                )
        return np.asarray(points)

    def pose(self, code: Any) -> SkinPose:
        """Return the pose of the mesh at a time code."""
        with usd_errors(self._mesh.GetPrim()):
            joints = self._skeleton.ComputeJointLocalTransforms(code)
            weights = np.array(self._shape_weights(code), dtype=np.float64)
            return SkinPose(np.array(joints), weights, np.array(self._mesh_points(code)))

    def posed(self, pose: SkinPose) -> NDArray[Any]:
        """(V, 3) skinned points in the skeleton's space in a pose of our own.

        USD skins in single precision, whose steps show in velocities between frames. So linear
        blends are computed here, in double precision.
        """
        with usd_errors(self._mesh.GetPrim()):
            points = self._shaped(pose.points, pose.weights)
            if not self._skinning.HasJointInfluences():
                return self._bound(np.asarray(points))
            moved = self.joint_spaces.from_bind(pose.joints)
            if (influences := self._influences) is not None:
                blends = (influences @ (self.bind_matrix @ moved).reshape(-1, 16)).reshape(-1, 4, 4)
                every = np.asarray(points, dtype=np.float64)
                turned = np.einsum("vi,vij->vj", every, blends[:, :3, :3])
                return np.asarray(turned + blends[:, 3, :3])
            transforms = Vt.Matrix4dArray.FromNumpy(moved)
            if not self._skinning.ComputeSkinnedPoints(transforms, points, EARLIEST_TIME):
                raise fault(self._mesh.GetPrim(), f"USD cannot skin it, {_MISFIT}")
        return np.asarray(points)

    @cached_property
    def joint_spaces(self) -> JointSpaces:
        """Spaces of the joints that move it."""
        return JointSpaces.of(self._skeleton)

    @cached_property
    def _influences(self) -> Any:
        """Sparse weights (V, J) of the skeleton's joints on the points; None where USD skins by
        another method than linear blends."""
        count, every = len(self.bind_points()), list(self._skeleton.GetJointOrder())
        found = self._skinning.ComputeVaryingJointInfluences(count)
        own = self._skinning.GetJointOrder()
        order = np.array([every.index(j) if j in every else -1 for j in own or every])
        if not found or self._skinning.GetSkinningMethod() != UsdSkel.Tokens.classicLinear:
            return None
        numbers, weights = (np.array(each).reshape(count, -1) for each in found)
        if not ((numbers >= 0) & (numbers < len(order))).all() or (order[numbers] < 0).any():
            return None
        points = np.repeat(np.arange(count), numbers.shape[1])
        entries = weights.ravel().astype(np.float64), (points, order[numbers].ravel())
        return scipy.sparse.coo_array(entries, shape=(count, len(every))).tocsr()

    def bind_points(self) -> Floats:
        """(V, 3) points of the bind pose in the skeleton's space."""
        return self._bound(self._mesh_points(DEFAULT_TIME))

    def points_of(self, joint: int) -> Array:
        """(N, 3) points of the bind pose that a joint moves for the most part, in the skeleton's
        space. joint: its number in the skeleton."""
        points = self.bind_points().astype(np.float64)
        found = self._skinning.ComputeVaryingJointInfluences(len(points))
        if not self._skinning.HasJointInfluences() or not found:
            return points[:0]
        numbers, weights = (np.array(each).reshape(len(points), -1) for each in found)
        own, every = self._skinning.GetJointOrder(), list(self._skeleton.GetJointOrder())
        order = every if own is None else list(own)
        if every[joint] not in order:
            return points[:0]
        fraction = np.where(numbers == order.index(every[joint]), weights, 0.0).sum(axis=1)
        return points[fraction > 0.5 * weights.sum(axis=1)]

    @property
    def skeleton(self) -> Any:
        """Return the query of the skeleton whose joints move it; None of blend shapes alone."""
        return self._skeleton if self._skinning.HasJointInfluences() else None

    def attributes(self) -> list[Any]:
        """Return the animated attributes of the skeleton."""
        return animation_attributes(self._skeleton)

    def _mesh_points(self, code: Any) -> Any:
        points = self._mesh.GetPointsAttr()
        value = read_array(points, code, VECTOR_ARRAY)
        return read_sized_array(points, EARLIEST_TIME, VECTOR_ARRAY) if value is None else value

    @cached_property
    def bind_matrix(self) -> Array:
        """(4, 4) from the mesh's own space to the skeleton's in the bind pose, row vectors."""
        return np.array(self._skinning.GetGeomBindTransform(EARLIEST_TIME), dtype=np.float64)

    def _bound(self, points: Any) -> Floats:
        bind = self.bind_matrix
        return (points @ bind[:3, :3] + bind[3, :3]).astype(np.float32)

    def earliest(self) -> Any:
        """The mesh's points moved by its blend shapes at its first samples."""
        return self._shaped(self._mesh_points(EARLIEST_TIME), self._shape_weights(EARLIEST_TIME))

    def _shape_weights(self, code: Any) -> Any:
        """Weights of the mesh's own blend shapes at a time; empty where none moves it."""
        query = self._skeleton.GetAnimQuery()
        if self._shapes is None or not query:
            return ()
        weights, mapper = query.ComputeBlendShapeWeights(code), self._skinning.GetBlendShapeMapper()
        return weights if mapper is None else mapper.Remap(weights)

    def _shaped(self, mesh_points: Any, weights: Any) -> Any:
        """Points moved by blend shapes; an array of our own."""
        points = np.array(mesh_points, dtype=np.float32)
        if self._shapes is not None and len(weights):
            given = Vt.FloatArray([float(weight) for weight in weights])
            parts_of = self._shapes.ComputeSubShapeWeights(given)
            for weight, shape, part in zip(*parts_of, strict=True):
                chosen, moved = self._shape_points[shape], self._shape_offsets[part]
                if len(moved):
                    points[chosen if len(chosen) else slice(None)] += np.float32(weight) * moved
        return Vt.Vec3fArray.FromNumpy(points)


def animation_attributes(skeleton: Any) -> list[Any]:
    """The attributes that move a skeleton (its query)."""
    query = skeleton.GetAnimQuery()
    animation = UsdSkel.Animation(query.GetPrim()) if query else None
    if not animation:
        return []
    return [
        animation.GetTranslationsAttr(),
        animation.GetRotationsAttr(),
        animation.GetScalesAttr(),
        animation.GetBlendShapeWeightsAttr(),
    ]


def _blend_shapes(query: Any, mesh: Any) -> tuple[list[Indices], list[Floats]]:
    """Point indices of each shape (none: all points) and (k, 3) offsets of each of its parts."""
    targets = read_targets(UsdSkel.BindingAPI(mesh.GetPrim()).GetBlendShapeTargetsRel())
    for target in targets:
        prim = mesh.GetPrim().GetStage().GetPrimAtPath(target)
        if not (prim and prim.IsActive() and prim.IsA(UsdSkel.BlendShape)):
            message = f"skel:blendShapeTargets names {target}, which is no active BlendShape"
            raise fault(mesh.GetPrim(), message)
    # a target may also lead nowhere, such as to a relationship that names itself
    if not all(query.GetBlendShape(shape) for shape in range(query.GetNumBlendShapes())):
        raise fault(mesh.GetPrim(), "skel:blendShapeTargets names what is no BlendShape")
    count = len(read_sized_array(mesh.GetPointsAttr(), EARLIEST_TIME, VECTOR_ARRAY))
    places = [np.array(each, dtype=np.int64) for each in query.ComputeBlendShapePointIndices()]
    offsets = [
        np.array(each, dtype=np.float32).reshape(-1, 3)
        for each in query.ComputeSubShapePointOffsets()
    ]
    for part, moved in enumerate(offsets):
        shape = query.GetBlendShapeIndex(part)
        prim = query.GetBlendShape(shape).GetPrim()
        chosen = places[shape]
        size = len(chosen) or count
        if len(moved) not in (0, size):  # none: a shape that moves nothing
            raise fault(prim, f"has {len(moved)} offsets for {size} points")
        if len(chosen) and not 0 <= chosen.min() <= chosen.max() < count:
            raise fault(prim, f"pointIndices are out of range. Give 0 to {count - 1}")
    return places, offsets


def find_joint_points(scene: SourceScene, skeleton: Any, joint: int) -> Array:
    """(N, 3) points of all skins of a skeleton that a joint moves for the most part, in the
    skeleton's space in the bind pose."""
    found = [np.zeros((0, 3))]
    for prim in prims_below(scene.stage.GetPseudoRoot()):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        bound = UsdSkel.BindingAPI(prim).GetInheritedSkeleton()
        if bound and bound.GetPrim() == skeleton:
            unread = Place(str(scene.path), str(prim.GetPath()), Problems())
            with unread.problems.collecting():
                skinning = find_skinning(scene, UsdGeom.Mesh(prim), unread)
                found += [] if skinning is None else [skinning.points_of(joint)]
    return np.concatenate(found)


def find_skinning(scene: SourceScene, mesh: Any, place: Place) -> Skinning | None:
    """The skinning of a mesh, None where no skeleton moves it. Raises InputError."""
    with usd_errors(mesh.GetPrim()):
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
            place.refuse(f"{path}: has joint influences, but skel:skeleton names no valid skeleton")
        skinning = Skinning(mesh, skeleton, query, cache)
        _warn_of_animations(mesh, skeleton, path)
        if query.HasJointInfluences():
            transforms = skeleton.ComputeSkinningTransforms(EARLIEST_TIME)
            points = skinning.earliest()
            if transforms is None or not query.ComputeSkinnedPoints(
                transforms, points, EARLIEST_TIME
            ):
                place.refuse(f"{path}: USD cannot skin it, {_MISFIT}")
            skinning.first = np.asarray(points)
        return skinning


def explain_stillness(prim: Any) -> str:
    """Return what should move a mesh that stands still, and why it does not.

    Empty for a mesh that names no skeleton, joints or blend shapes.
    """
    named = [name for name in _BINDINGS if prim.GetProperty(name)]
    above = prim.GetParent()
    while above and not above.IsPseudoRoot():
        named += [name for name in _BINDINGS[:2] if above.GetProperty(name)]
        above = above.GetParent()
    if not named:
        return ""
    root, skeleton = UsdSkel.Root.Find(prim), UsdSkel.BindingAPI(prim).GetInheritedSkeleton()
    why = "no joint or blend shape of it moves"
    # properties of a prim without the schema are ignored
    unread = [each for each in (prim, skeleton.GetPrim()) if each and _lacks_schema(each)]
    if unread:
        why = f"SkelBindingAPI is not applied to {unread[0].GetPath()}"
    elif not skeleton:
        why = "skel:skeleton names no skeleton"
    elif not root:
        why = "USD skins only what is below a SkelRoot"
    else:
        above = prim.GetParent()
        while above.IsA(UsdGeom.Imageable) and above != root.GetPrim():
            above = above.GetParent()
        if above != root.GetPrim():
            why = f"USD skins nothing below {above.GetPath()}, which is no Xform or Scope"
    bound = f"bound to {skeleton.GetPath()}" if skeleton else f"has {named[0]}"
    return f"{bound} but moves by nothing: {why}"


def _warn_of_animations(mesh: Any, skeleton: Any, path: str) -> None:
    """Warn where a mesh and its skeleton (a query) name several animations; USD takes one."""
    named: list[Any] = []
    for prim in (skeleton.GetPrim(), mesh.GetPrim()):
        named += read_targets(UsdSkel.BindingAPI(prim).GetAnimationSourceRel())
    query = skeleton.GetAnimQuery()
    own = query.GetPrim().GetPath() if query else None
    others = ", ".join(sorted({str(each) for each in named if each != own}))
    if own and others:
        told = f"{path}: moved by {own}, not by {others}. Bind the skeleton to one animation"
        warn_input(told)


def _lacks_schema(prim: Any) -> bool:
    has_any = any(prim.GetProperty(name) for name in _BINDINGS)
    return has_any and not prim.HasAPI(UsdSkel.BindingAPI)
