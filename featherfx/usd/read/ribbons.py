"""Ribbons that roots follow where there is no skin: along a skeleton's bones.

Every bone, from a joint to the next and beyond the last one, is a narrow strip of triangles that
moves with the joint. Where a chain continues, strips share their ends, which move half with the
joint above and half with the joint there. Roots on it take the mean rotation of about half a bone
around them, by the same smooth field as on a skin. Roots of a row pass from bone to bone, and roots
beside the ribbon keep their place against it.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from pxr import Sdf, Usd, UsdSkel

from featherfx.algebra.types import Array, Indices
from featherfx.groom.keys.problems import Place
from featherfx.groom.skin.skin import is_flat
from featherfx.usd.read.skinning import JointSpaces, SkinPose, animation_attributes
from featherfx.usd.read.stage import SourceScene, check_transforms, find_prim
from featherfx.usd.read.surface import MeshOptions, Surface, open_mesh
from featherfx.usd.read.values import read_matrix, usd_errors

_MIN_HINGE_SINE = 0.05  # sine of the angle from which on two bones have a hinge
_HALF_WIDTH_RATIO = 0.2  # half of a ribbon's, in lengths of the bone
_PIECES = 4  # of a ribbon along a bone
_SINGLE_BONE_LENGTH = 0.1  # length of the bone of a skeleton's only joint, in units of the stage


class BoneRibbons:
    """Ribbons along the bones of a skeleton, in its own space, as Surface uses a skinning.

    space: the prim. rest: (V, 3) in the bind pose. triangles: (T, 3), faces: (T,) bones, and
    lengths: (T,) of these. skeleton: query of it.
    """

    bind_matrix = np.eye(4)

    def __init__(self, prim: Any) -> None:
        self.space = prim
        self._cache = UsdSkel.Cache()  # owns what the query refers to
        root = UsdSkel.Root.Find(prim)
        if root:
            self._cache.Populate(root, Usd.TraverseInstanceProxies())
        self.skeleton = self._cache.GetSkelQuery(UsdSkel.Skeleton(prim))
        self.joint_spaces = JointSpaces.of(self.skeleton)
        places = np.array(self.skeleton.GetJointWorldBindTransforms())[:, 3, :3]
        parents = [*self.joint_spaces.parents]
        self.rest, self._weights, self.triangles, self.lengths = _make_strips(places, parents)
        self.faces = np.arange(len(self.triangles)) // (2 * _PIECES)

    def bind_points(self) -> Array:
        """Return (V, 3) in the bind pose."""
        return self.rest

    def points(self, code: Any) -> Array:
        """Return (V, 3) in the skeleton's space at a time code."""
        return self.posed(self.pose(code))

    def pose(self, code: Any) -> SkinPose:
        """Return the motion of the ribbons at a time code."""
        with usd_errors(self.space):
            joints = np.array(self.skeleton.ComputeJointLocalTransforms(code))
        return SkinPose(joints, np.zeros(0), self.rest)

    def posed(self, pose: SkinPose) -> Array:
        """Return (V, 3) in the skeleton's space in a given pose."""
        moved = self.joint_spaces.from_bind(pose.joints)
        whole = np.column_stack([self.rest, np.ones(len(self.rest))])
        return np.asarray(np.einsum("vj,vr,jrc->vc", self._weights, whole, moved)[:, :3])

    def attributes(self) -> list[Any]:
        """Return the animated attributes of the skeleton."""
        return animation_attributes(self.skeleton)


def _make_strips(places: Array, parents: list[int]) -> tuple[Array, Array, Indices, Array]:
    """Return points (V, 3), joint weights (V, J), triangles (T, 3) and bone lengths (T,).

    places: (J, 3) of the joints. parents: of each, before it; -1: none.
    """
    children: list[list[int]] = [[] for _ in parents]
    for joint, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(joint)
    strips = _Strips(places, children)
    waiting = [_BoneStart(joint) for joint, parent in enumerate(parents) if parent < 0]
    while waiting:
        waiting += strips.add(waiting.pop())
    return strips.arrays()


class _BoneStart(NamedTuple):
    """Start of bones at a joint.

    pair: first of the two last points of the previous bone, -1: none. way: (3,) of that bone.
    across: (3,) unit, of its ribbon.
    """

    joint: int
    pair: int = -1
    way: Array | None = None
    across: Array | None = None


class _Strips:
    """Ribbons as they are made, bone by bone, from the roots of the skeleton on."""

    def __init__(self, places: Array, children: list[list[int]]) -> None:
        self._places, self._children = places, children
        self._points: list[Array] = []
        self._weights: list[Array] = []
        self._triangles: list[tuple[int, int, int]] = []
        self._lengths: list[float] = []

    def arrays(self) -> tuple[Array, Array, Indices, Array]:
        """As of _strips."""
        triangles = np.array(self._triangles, dtype=np.int64).reshape(-1, 3)
        lengths = np.array(self._lengths)
        return np.array(self._points), np.array(self._weights), triangles, lengths

    def add(self, start: _BoneStart) -> list[_BoneStart]:
        """Add the strips of the bones below a joint; return the starts of the next ones."""
        following, joint = [], start.joint
        onwards, main = self._onwards(joint, start.way)
        for way, child in self._bones(joint, start.way):
            if not way.any():
                following.append(_BoneStart(child))
                continue
            goes_on = start.pair >= 0 and child == main
            next_way = onwards if child < 0 else self._onwards(child, way)[0]
            across = _across(way, next_way, start.across)
            offset = _HALF_WIDTH_RATIO * float(np.linalg.norm(way)) * across
            pair = start.pair if goes_on else self._pair(joint, offset, [joint])
            for piece in range(1, _PIECES + 1):
                shared = [joint, child] if piece == _PIECES and child >= 0 else [joint]
                pair = self._next(pair, joint, offset, shared, way * (piece / _PIECES))
            self._lengths += 2 * _PIECES * [float(np.linalg.norm(way))]
            if child >= 0:
                following.append(_BoneStart(child, pair, way, across))
        return following

    def _bones(self, joint: int, way: Array | None) -> list[tuple[Array, int]]:
        """Return (way, joint at the end) of each bone below a joint; -1: no joint."""
        bones = [(self._places[k] - self._places[joint], k) for k in self._children[joint]]
        if bones:
            return bones
        return [(np.array([_SINGLE_BONE_LENGTH, 0.0, 0.0]) if way is None else way, -1)]

    def _onwards(self, joint: int, way: Array | None) -> tuple[Array, int]:
        """Return the straightest bone below a joint: its way, and the joint at its end."""
        bones = [each for each in self._bones(joint, way) if each[0].any()]
        if not bones or way is None:
            return bones[0] if bones else (np.zeros(3), -1)
        return max(bones, key=lambda each: float(each[0] @ way) / float(np.linalg.norm(each[0])))

    def _next(self, before: int, joint: int, offset: Array, movers: list[int], way: Array) -> int:
        """Add a pair of points along a bone, and triangles to it from the pair before."""
        pair = self._pair(joint, offset, movers, way)
        self._triangles += [(before, before + 1, pair + 1), (before, pair + 1, pair)]
        return pair

    def _pair(self, joint: int, offset: Array, movers: list[int], way: Array | float = 0.0) -> int:
        """Add two points beside a place on a bone; return the first. movers: joints, equally."""
        weights = np.zeros(len(self._places))
        weights[movers] = 1.0 / len(movers)
        middle = self._places[joint] + way
        self._points += [middle - offset, middle + offset]
        self._weights += [weights, weights]
        return len(self._points) - 2


def _across(way: Array, onwards: Array, before: Array | None) -> Array:
    """Return (3,) unit, orthogonal to a bone: along the hinge to the next one if they bend.

    Else the direction of the bone before is kept.
    """
    hinge = np.cross(way, onwards)
    if np.linalg.norm(hinge) < _MIN_HINGE_SINE * np.linalg.norm(way) * np.linalg.norm(onwards):
        axis = np.eye(3)[np.argmin(np.abs(way))] if before is None else before
        hinge = axis - way * (axis @ way) / (way @ way)
    if np.linalg.norm(hinge) < _MIN_HINGE_SINE:
        hinge = np.cross(way, np.eye(3)[np.argmin(np.abs(way))])
    found = hinge / np.linalg.norm(hinge)
    return -found if before is not None and found @ before < 0.0 else found


class RibbonMesh(Surface):
    """Ribbons as a mesh that roots follow. Faces are bones."""

    def __init__(
        self, scene: SourceScene, prim: Any, ribbons: BoneRibbons, rest: float | None
    ) -> None:
        self._begin(scene, prim, ribbons, partial(read_matrix, ribbons.space), rest)
        self._find_times(ribbons.attributes())
        sound = ~is_flat(self.rest, ribbons.triangles)
        self.triangles, self.st = ribbons.triangles[sound], None
        self.places = self.triangles
        self.closed = np.zeros(len(self.triangles), dtype=np.bool_)
        self.face = ribbons.faces[sound]
        # in metres: the bind pose may be scaled by the prim's transforms
        scale = float(np.cbrt(np.abs(np.linalg.det(self.rest_matrix[:3, :3]))))
        self.bones = scale * ribbons.lengths[sound]


def open_carrier(scene: SourceScene, path: str, options: MeshOptions, place: Place) -> Surface:
    """Return a mesh, or the ribbons of a skeleton, by its path; as open_mesh."""
    prim = scene.stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    if prim and prim.IsA(UsdSkel.Skeleton):
        find_prim(scene, path, place)
        return open_bones(scene, prim, options.rest, place)
    return open_mesh(scene, path, options, place)


def open_bones(scene: SourceScene, prim: Any, rest: float | None, place: Place) -> RibbonMesh:
    """Return a skeleton as a mesh that moves. Raises InputError."""
    path = f"{prim.GetPath()} in {scene.path}"
    with usd_errors(prim):
        check_transforms(scene, prim, place)
        query = UsdSkel.Cache().GetSkelQuery(UsdSkel.Skeleton(prim))
        if not query or not query.HasBindPose() or not len(query.GetJointOrder()):
            place.refuse(f"{path} has no joints with bind transforms")
        opened = RibbonMesh(scene, prim, BoneRibbons(prim), rest)
        if not len(opened.triangles):
            place.refuse(f"{path} has no bone of any length")
        return opened
