"""Skeletons that roots follow without a skin: a ribbon along the bones, led by the joints.

Every bone, from a joint to the one below it and from the last one on, is a narrow strip of
triangles that moves with the joint. Where a chain goes on, strips share their ends, which move half
with the joint above and half with the joint there. Roots on it take the mean turn of about half a
bone around them, by the same smooth field as on a skin: those of a row pass from bone to bone, and
roots beside it keep their place against it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdSkel

from featherfx.usd.read.skinning import Ribbons, SkinPose, animated, from_bind
from featherfx.usd.read.values import reading

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_BENT = 0.05  # sine of the angle from which on two bones have a hinge
_WIDTH = 0.2  # half of a ribbon's, in lengths of the bone
_PIECES = 4  # of a ribbon along a bone
_ALONE = 0.1  # length of the bone of a skeleton's only joint, in units of the stage


class BoneRibbons(Ribbons):
    """Ribbons along the bones of a skeleton."""

    def __init__(self, prim: Any) -> None:
        self.space = prim
        self._cache = UsdSkel.Cache()  # owns what the query refers to
        root = UsdSkel.Root.Find(prim)
        if root:
            self._cache.Populate(root, Usd.TraverseInstanceProxies())
        self._skeleton = self._cache.GetSkelQuery(UsdSkel.Skeleton(prim))
        places = np.array(self._skeleton.GetJointWorldBindTransforms())[:, 3, :3]
        parents = list(self._skeleton.GetTopology().GetParentIndices())
        self.rest, self._weights, self.triangles, self.lengths = _strips(places, parents)
        self.faces = np.arange(len(self.triangles)) // (2 * _PIECES)

    def pose(self, code: Any) -> SkinPose:
        """What moves the ribbons at a time code."""
        with reading(self.space):
            joints = np.array(self._skeleton.ComputeJointLocalTransforms(code))
        return SkinPose(joints, np.zeros(0), self.rest)

    def posed(self, pose: SkinPose) -> Array:
        """(V, 3) in the skeleton's space in a pose of our own."""
        moved = from_bind(self._skeleton, pose.joints)
        whole = np.column_stack([self.rest, np.ones(len(self.rest))])
        return np.asarray(np.einsum("vj,vr,jrc->vc", self._weights, whole, moved)[:, :3])

    def attributes(self) -> list[Any]:
        """What moves the skeleton, for its time samples."""
        return animated(self._skeleton)


def _strips(places: Array, parents: list[int]) -> tuple[Array, Array, Indices, Array]:
    """Points (V, 3), weights of the joints (V, J) and triangles (T, 3) of the ribbons, and the
    length of each triangle's bone (T,).

    places: (J, 3) of the joints. parents: of each, before it; -1: none.
    """
    children: list[list[int]] = [[] for _ in parents]
    for joint, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(joint)
    strips = _Strips(places, children)
    waiting = [_Start(joint) for joint, parent in enumerate(parents) if parent < 0]
    while waiting:
        waiting += strips.add(waiting.pop())
    return strips.arrays()


class _Start(NamedTuple):
    """Where bones begin. pair: the first of two points that the bone before ends in, -1: none.
    way: (3,) of that bone. across: (3,) unit, of its ribbon."""

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

    def add(self, start: _Start) -> list[_Start]:
        """The strips of the bones below a joint; where the next ones begin."""
        following, joint = [], start.joint
        onwards, main = self._onwards(joint, start.way)
        for way, child in self._bones(joint, start.way):
            if not way.any():
                following.append(_Start(child))
                continue
            goes_on = start.pair >= 0 and child == main
            next_way = onwards if child < 0 else self._onwards(child, way)[0]
            across = _across(way, next_way, start.across)
            offset = _WIDTH * float(np.linalg.norm(way)) * across
            pair = start.pair if goes_on else self._pair(joint, offset, [joint])
            for piece in range(1, _PIECES + 1):
                shared = [joint, child] if piece == _PIECES and child >= 0 else [joint]
                pair = self._next(pair, joint, offset, shared, way * (piece / _PIECES))
            self._lengths += 2 * _PIECES * [float(np.linalg.norm(way))]
            if child >= 0:
                following.append(_Start(child, pair, way, across))
        return following

    def _bones(self, joint: int, way: Array | None) -> list[tuple[Array, int]]:
        """(way, joint at the end) of each bone below a joint; -1: nothing stands at its end."""
        bones = [(self._places[k] - self._places[joint], k) for k in self._children[joint]]
        if bones:
            return bones
        return [(np.array([_ALONE, 0.0, 0.0]) if way is None else way, -1)]

    def _onwards(self, joint: int, way: Array | None) -> tuple[Array, int]:
        """The bone below a joint that goes on straightest: its way, and the joint at its end."""
        bones = [each for each in self._bones(joint, way) if each[0].any()]
        if not bones or way is None:
            return bones[0] if bones else (np.zeros(3), -1)
        return max(bones, key=lambda each: float(each[0] @ way) / float(np.linalg.norm(each[0])))

    def _next(self, before: int, joint: int, offset: Array, movers: list[int], way: Array) -> int:
        """A pair of points along a bone, and the triangles to it from the pair before."""
        pair = self._pair(joint, offset, movers, way)
        self._triangles += [(before, before + 1, pair + 1), (before, pair + 1, pair)]
        return pair

    def _pair(self, joint: int, offset: Array, movers: list[int], way: Array | float = 0.0) -> int:
        """The first of two points beside a place on a bone. movers: joints, in equal
        shares."""
        weights = np.zeros(len(self._places))
        weights[movers] = 1.0 / len(movers)
        middle = self._places[joint] + way
        self._points += [middle - offset, middle + offset]
        self._weights += [weights, weights]
        return len(self._points) - 2


def _across(way: Array, onwards: Array, before: Array | None) -> Array:
    """(3,) unit, square to a bone: along the hinge to the next one where there is a bend, else as
    before."""
    hinge = np.cross(way, onwards)
    if np.linalg.norm(hinge) < _BENT * np.linalg.norm(way) * np.linalg.norm(onwards):
        axis = np.eye(3)[np.argmin(np.abs(way))] if before is None else before
        hinge = axis - way * (axis @ way) / (way @ way)
    if np.linalg.norm(hinge) < _BENT:
        hinge = np.cross(way, np.eye(3)[np.argmin(np.abs(way))])
    found = hinge / np.linalg.norm(hinge)
    return -found if before is not None and found @ before < 0.0 else found
