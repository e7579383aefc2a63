"""Ribbons that roots follow where there is no skin: along a skeleton's bones, or a curve.

Every bone, from a joint to the next and beyond the last one, is a narrow strip of triangles that
moves with the joint. Where a chain continues, strips share their ends, which move half with the
joint above and half with the joint there. Roots on it take the mean rotation of about half a bone
around them, by the same smooth field as on a skin. Roots of a row pass from bone to bone, and roots
beside the ribbon keep their place against it.

Along a curve the ribbon's side is transported from the first point without rotation about the
curve. At the first point the rest side is rotated by the least rotation that takes its tangent
along. A curve does not define its twist; transforms of its prim do, and are followed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdSkel

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import arc_lengths, start_tangent, transported
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.skin.skin import is_flat
from featherfx.usd.read.curves import read_prim_curves
from featherfx.usd.read.skinning import JointSpaces, SkinPose, animation_attributes
from featherfx.usd.read.stage import SourceScene, check_transforms, find_prim, list_times, rest_time
from featherfx.usd.read.surface import MeshOptions, Surface, open_mesh
from featherfx.usd.read.values import describe_time, read_matrix, usd_errors

_MIN_HINGE_SINE = 0.05  # sine of the angle from which on two bones have a hinge
_HALF_WIDTH_RATIO = 0.2  # half of a ribbon's, in lengths of the bone or of a piece of the curve
_PIECES = 4  # of a ribbon along a bone
_SINGLE_BONE_LENGTH = 0.1  # length of the bone of a skeleton's only joint, in units of the stage


class Ribbons(ABC):
    """Interface of ribbons in the own space of a prim, as Surface uses a skinning.

    space: the prim. rest: (V, 3) in the bind pose. triangles: (T, 3), faces: (T,) bones or pieces
    of a curve and lengths: (T,) of these. skeleton: query of that whose bones they are along.
    """

    space: Any
    skeleton: Any = None
    rest: Array
    triangles: Indices
    faces: Indices
    lengths: Array

    @property
    def bind_matrix(self) -> Array:
        """Return the identity: ribbons are in the prim's own space."""
        return np.eye(4)

    def bind_points(self) -> Array:
        """Return (V, 3) in the bind pose."""
        return self.rest

    def points(self, code: Any) -> Array:
        """Return (V, 3) in the prim's space at a time code."""
        return self.posed(self.pose(code))

    @abstractmethod
    def pose(self, code: Any) -> SkinPose:
        """Return the motion of the ribbons at a time code."""

    @abstractmethod
    def posed(self, pose: SkinPose) -> Array:
        """Return (V, 3) in the prim's space in a given pose."""


class CurveRibbon(Ribbons):
    """A ribbon along a curve without `curve_fault`; faces are its pieces."""

    def __init__(self, scene: SourceScene, prim: Any) -> None:
        self.space, self._path = prim, scene.path
        self._points = UsdGeom.Curves(prim).GetPointsAttr()
        line = self._line(rest_time(self._points))
        pieces = np.linalg.norm(np.diff(line, axis=0), axis=1)
        self._half = _HALF_WIDTH_RATIO * float(pieces.mean())
        self._tangent = start_tangent(line, arc_lengths(line))
        across = np.cross(self._tangent, np.eye(3)[np.argmin(np.abs(self._tangent))])
        self._across = across / np.linalg.norm(across)
        self.rest = self._ribbon(line)
        first = 2 * np.arange(len(pieces))[:, None, None]
        self.triangles = (first + np.array([[0, 1, 3], [0, 3, 2]])).reshape(-1, 3)
        self.faces = np.repeat(np.arange(len(pieces)), 2)
        self.lengths = np.repeat(pieces, 2)

    def pose(self, code: Any) -> SkinPose:
        """Return the motion of the ribbon at a time code: the points of the curve."""
        return SkinPose(np.eye(4)[None], np.zeros(0), self._line(code))

    def posed(self, pose: SkinPose) -> Array:
        """Return (V, 3) along a given curve."""
        return self._ribbon(pose.points)

    def attributes(self) -> list[Any]:
        """Return the animated attributes of the curve."""
        return [self._points]

    def _line(self, code: Any) -> Array:
        place = Place(str(self._path), str(self.space.GetPath()), Problems())
        return read_prim_curves(self.space, code, place).line(0)

    def _ribbon(self, line: Array) -> Array:
        stations = arc_lengths(line)
        # a turn without one about the tangent takes what is square to it along
        tangent = start_tangent(line, stations)
        axis, cosine = np.cross(self._tangent, tangent), self._tangent @ tangent
        start = self._across + np.cross(axis, self._across)
        start = start + np.cross(axis, np.cross(axis, self._across)) / max(1.0 + cosine, 1e-9)
        side = self._half * transported(line, stations) @ start
        return np.stack([line - side, line + side], axis=1).reshape(-1, 3)


def curve_fault(scene: SourceScene, prim: Any, place: Place) -> str:
    """Return why roots cannot follow a curve; empty where they can. Raises InputError."""
    sizes = set()
    for code in list_times(UsdGeom.Curves(prim).GetPointsAttr()):
        curves = read_prim_curves(
            prim, code, Place(str(scene.path), str(prim.GetPath()), place.problems)
        )
        if len(curves) != 1:
            return f"holds {len(curves)} curves, roots follow one"
        line = curves.line(0)
        if (np.diff(line, axis=0) == 0.0).all(axis=1).any():
            return f"has two points at one place {describe_time(code)}"
        sizes.add(len(line))
        if len(sizes) > 1:
            return f"changes its number of points {describe_time(code)}"
    return "" if sizes else "has no points"


class BoneRibbons(Ribbons):
    """Ribbons along the bones of a skeleton."""

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
    """Ribbons as a mesh that roots follow. Faces are bones, or pieces of a curve."""

    def __init__(
        self, scene: SourceScene, prim: Any, ribbons: BoneRibbons | CurveRibbon, rest: float | None
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
    """Return a mesh, or the ribbons of a skeleton or a curve, by its path; as open_mesh."""
    prim = scene.stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    for kind, opener in ((UsdSkel.Skeleton, open_bones), (UsdGeom.Curves, open_curve)):
        if prim and prim.IsA(kind):
            find_prim(scene, path, place)
            return opener(scene, prim, options.rest, place)
    return open_mesh(scene, path, options, place)


def open_curve(scene: SourceScene, prim: Any, rest: float | None, place: Place) -> RibbonMesh:
    """Return a curve as a mesh that moves. Raises InputError."""
    with usd_errors(prim):
        if fault := curve_fault(scene, prim, place):
            place.refuse(f"{prim.GetPath()} in {scene.path} {fault}")
        check_transforms(scene, prim, place)
        return RibbonMesh(scene, prim, CurveRibbon(scene, prim), rest)


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
