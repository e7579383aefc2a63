"""Surfaces of stages as renderers draw them, as triangles that move.

Skins, colliders, maps and the scenery of pictures and checks are read here.

Topology, and the points of every time sample, are checked when a mesh is opened; points are read
again when they are asked for, so that memory does not grow with the number of frames.
"""

from __future__ import annotations

import copy
from collections import OrderedDict
from collections.abc import Sequence
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom
from scipy.spatial.transform import Rotation

from featherfx.algebra.interpolation import Knots, Maps, Stencil
from featherfx.algebra.triangulation import orient
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import cross_columns, triangle_edges
from featherfx.errors import InputError, Problem, as_figure, warn_input
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.skin.skin import closest
from featherfx.shot.sources import JointTree
from featherfx.usd.read.drawn_meshes import DrawnMesh, MatrixAt, place_mesh
from featherfx.usd.read.mesh_topology import (
    MAX_UNTOLD_DISTANCE,
    list_topology_faults,
    measure_distance,
    open_limit,
    read_primvar,
    read_scheme,
    read_topology,
    read_triangles,
)
from featherfx.usd.read.skinning import SkinPose, explain_stillness, find_skinning
from featherfx.usd.read.stage import (
    ScenePrim,
    SourceScene,
    check_transforms,
    describe_prims,
    find_prim,
    list_motion_times,
    rest_time,
    to_world_matrix,
    transform_points,
)
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    PAIR_ARRAY,
    VECTOR_ARRAY,
    ArrayKind,
    errors_at,
    read_sized_array,
)

if TYPE_CHECKING:
    from featherfx.usd.read.mesh_topology import LimitSurface


class _KnotPose(NamedTuple):
    """Pose of a mesh at a knot: SkinPose, and the matrix from its space to the world."""

    joints: Array
    weights: Array
    points: NDArray[Any]
    matrix: Array


_NO_JOINTS = SkinPose(np.zeros((0, 4, 4)), np.zeros(0), np.zeros((0, 3), dtype=np.float32))
_MAX_KNOTS = 12  # knots, whose neighbours share most
_MAX_LOOKS = 25  # samples that are compared to tell whether a mesh moves
_MAX_TIMES = 8  # times, at which roots and the skin as a body are asked for


class MeshOptions(NamedTuple):
    """Options of reading a mesh.

    rest: time code of the rest pose; None: the bind pose of a skinned mesh, the default values or,
    where there are none, the first samples of any other. subdivision: whether the surface is the
    one that a renderer draws, not the cage. uv: the primvar that holds texture coordinates, empty
    for none. is_driven: whether joints that stand still are moved by others.
    """

    rest: float | None = None
    subdivision: bool = True
    uv: str = "st"
    is_driven: bool = False


class Surface(ScenePrim):
    """A drawn mesh of T triangles and V points in the world: metres, z up.

    path: of the prim. triangles: (T, 3) point indices, outside counter-clockwise; holes and faces
    without area are left out. places: (T, 3) of their corners in faceVertexIndices. face: (T,)
    their faces. closed: (T,) whether their connected component is a volume. border: (T,) those with
    an edge of their own. turned: faces wound against their component, or a volume's, which are
    turned round. rest: (V, 3) m, points at rest; cage: those of the prim, where limit is the
    subdivided surface of the triangles. topology: as of read_topology. rest_matrix: (4, 4), row
    vectors, from the prim's own space to the world at rest. st: (T, 3, 2) texture coordinates of
    the corners, None where there are none, of the primvar uv. scheme: by which a renderer
    subdivides it, or none; subdivision: whether that is asked for. sampled: first and last time
    code with samples of anything that moves it, None where nothing does. bones: (T,) m, length of
    each triangle's bone, where it is a ribbon along these. idle: the skeleton
    that names it and does not move it, and why, in words. mask: which of its triangles it has,
    None for all. knots: where its poses are those of the scene, with smooth motion between them;
    None: the scene's own motion.
    """

    bones: Array | None = None
    subdivision: bool = True
    limit: LimitSurface | None = None
    scheme: str = "none"
    uv: str = ""
    idle: str = ""
    mask: Flags | None = None
    mirrored: bool
    rest: Array

    def __init__(self, scene: SourceScene, drawn: DrawnMesh, options: MeshOptions) -> None:
        self._mesh = mesh = drawn.mesh
        self._begin(scene, mesh.GetPrim(), drawn.skinning, drawn.matrix, options.rest)
        moving = [] if drawn.skinning is None else drawn.skinning.attributes()
        self._find_times([*moving, mesh.GetPointsAttr()])
        self.scheme, self.subdivision = read_scheme(mesh), options.subdivision
        counts, indices = self.topology = read_topology(mesh)
        self.cage, faces = self.rest, (counts, indices, np.arange(len(counts)))
        self.limit = open_limit(mesh, counts, indices, self.rest) if options.subdivision else None
        if self.limit is not None:
            self.rest, faces = self.limit.move(self.cage), self.limit.faces
        found = read_triangles(mesh, faces, self.rest, self.mirrored)
        self.turned = np.unique(found.face[found.turned])
        self.triangles, self.places, self.face = found[:3]
        self.closed, self.border = found.closed, found.border
        self.uv, self.st = options.uv, None
        if options.uv:
            self.st = self.read_corners(options.uv, PAIR_ARRAY)

    def _begin(
        self, scene: SourceScene, prim: Any, skinning: Any, matrix: MatrixAt, rest: float | None
    ) -> None:
        """Read the pose at rest. skinning, matrix: as of DrawnMesh."""
        super().__init__(scene, prim)
        self._skinning, self._to_stage = skinning, matrix
        self.knots: Knots | None = None
        self._poses: OrderedDict[float, _KnotPose] = OrderedDict()
        self._asked: OrderedDict[float, Array] = OrderedDict()
        self._lock = Lock()
        self._moved: tuple[NDArray[Any], NDArray[Any]] | None = None
        self._maps: tuple[Any, Maps] | None = None
        self._rest_code = DEFAULT_TIME if rest is None else Usd.TimeCode(rest)
        self.rest = self._at_rest(rest is None)
        self.mirrored = self._sign(self._rest_code)

    def _find_times(self, attributes: list[Any]) -> None:
        """Note when attributes, or transforms, have samples."""
        self.times = list_motion_times(self._prim, attributes)
        self.sampled = (self.times[0], self.times[-1]) if self.times else None

    @property
    def space(self) -> tuple[float, str]:
        return self._scene.space

    @property
    def skeleton(self) -> Any:
        """Return the prim of the skeleton that moves it, None without one."""
        return None if self._skinning is None else self._skinning.space

    @property
    def origin(self) -> tuple[Any, ...]:
        return (*super().origin, self.limit is not None, self.mask)

    def cage_distance(self) -> float:
        """Return the largest distance (m) of its points to the subdivided surface."""
        return measure_distance(self._mesh, *self.topology, self.cage)

    def warn(self, at: str) -> None:
        """Warn where feathers are not on the surface that is drawn. at: file and key."""
        off, of = (self.limit.off, "faces") if self.limit is not None else (0.0, "")
        if self.limit is None and self.scheme != "none":
            off, of = self.cage_distance(), "the cage, which is taken,"
        if off > MAX_UNTOLD_DISTANCE:
            message = f"{at}: {self.path}: {of} are up to {as_figure(1e3 * off)} mm off"
            warn_input(f"{message} the {self.scheme} surface that renderers draw", 3)

    def locate(self, triangle: Indices, barycentric: Array) -> tuple[Indices, Indices, Array]:
        """Return (R,) faces of the prim, (R, 3) its points, and (R, 3) their weights, of places.

        Of a subdivided surface these are the nearest places on the cage. triangle: (R,) numbers of
        triangles; barycentric: (R, 3), of places within them.
        """
        if self.limit is None:
            return self.face[triangle], self.triangles[triangle], barycentric
        counts, indices = self.topology
        faces = counts, indices, np.arange(len(counts))
        found = read_triangles(self._mesh, faces, self.cage, self.mirrored)
        places = np.einsum("rk,rkc->rc", barycentric, self.rest[self.triangles[triangle]])
        near, weights = closest(places, self.cage[found.triangles])
        return found.face[near], found.triangles[near], weights

    def spread(self, values: Array, interpolation: str, numbers: Indices | None) -> Array | None:
        """Return (T, 3, ...) values at the corners of the triangles; None where they fit nothing.

        values: (K, ...) of a primvar. numbers: of those of corners, None where each has its own.
        """
        counts, indices = self.topology
        if len(values) == 1:
            return np.broadcast_to(values[0], (*self.triangles.shape, *values.shape[1:]))
        if interpolation == UsdGeom.Tokens.uniform and len(values) == len(counts):
            return np.repeat(values[self.face][:, None], 3, axis=1)
        if self.limit is not None:
            found = self.limit.spread(values, interpolation, numbers)
            return None if found is None else found[self.places]
        if interpolation == UsdGeom.Tokens.faceVarying:
            values = values if numbers is None else values[numbers]
            return values[self.places] if len(values) == len(indices) else None
        return values[self.triangles] if len(values) == len(self.cage) else None

    def read_corners(self, name: str, kind: ArrayKind) -> Array | None:
        """Return (T, 3, ...) a primvar at the corners; None where there is none that fits."""
        primvar = UsdGeom.PrimvarsAPI(self._prim).FindPrimvarWithInheritance(name)
        values = read_primvar(primvar, kind)
        return None if values is None else self.spread(*values)

    def masked(self, chosen: Flags) -> Surface:
        """The same mesh with some of its triangles (T,) alone."""
        found = copy.copy(self)
        found.mask = chosen
        found.triangles, found.places, found.face = (
            each[chosen] for each in (self.triangles, self.places, self.face)
        )
        found.st = None if self.st is None else self.st[chosen]
        normals = cross_columns(*triangle_edges(self.rest, found.triangles)).T
        counts = np.full(len(found.triangles), 3)
        sides = orient(counts, found.triangles.ravel(), self.rest, normals)
        found.closed, found.border = sides.closed, sides.border
        return found

    def smoothed(self, knots: Knots | None) -> Surface:
        """The same mesh, moving smoothly between the poses that it has at knots (time codes); None:
        as the scene has it."""
        if self.sampled is None:
            return self
        found = copy.copy(self)
        found.knots, found._poses, found._asked = knots, OrderedDict(), OrderedDict()
        found._lock = Lock()
        found._maps = None
        return found

    def corners(self, code: float, triangles: Indices) -> Array:
        """(F, 3, 3) m, corners of triangles (F, 3) of points at a time code."""
        return self._finite(self._at(code).take(triangles, axis=0), code)

    def points(self, code: float) -> Array:
        """(V, 3) m, all points at a time code."""
        return self._finite(self._at(code).copy(), code)

    def _at(self, code: float) -> Array:
        """(V, 3) m, points at a time code; those of the last few are kept."""
        with self._lock:  # frames are drawn beside the simulation
            found = self._asked.get(code)
            if found is None:
                local, matrix = self._posed(code)
                self._asked[code] = found = transform_points(self._drawn(local), matrix)
                if len(self._asked) > _MAX_TIMES:
                    self._asked.popitem(last=False)
            return found

    def _drawn(self, local: NDArray[Any]) -> NDArray[Any]:
        """Return (V, 3) points of the drawn surface, of points of the prim; the last are kept, for
        a mesh that moves as a whole."""
        if self.limit is None:
            return local
        if self._moved is None or not np.array_equal(self._moved[0], local):
            self._moved = local, self.limit.move(local)
        return self._moved[1]

    def _posed(self, code: float) -> tuple[NDArray[Any], Array]:
        if self.knots is None or not self.knots.leads(code):
            return self._local_points(Usd.TimeCode(code)), self._matrix(Usd.TimeCode(code))
        pose, matrix = self._pose(code)
        return pose.points if self._skinning is None else self._skinning.posed(pose), matrix

    def _pose(self, code: float) -> tuple[SkinPose, Array]:
        """Return the pose at a time code, and the matrix from its space to the world."""
        if self.knots is None or not self.knots.leads(code):
            found = self._at_knot(code)
            return SkinPose(*found[:3]), found.matrix
        stencil = self.knots.stencil(code)
        poses = [self._at_knot(time) for time in stencil.times.tolist()]
        matrix = stencil.matrix(np.stack([each.matrix for each in poses]))
        if all(each.points is poses[0].points for each in poses):
            points = poses[0].points  # moved as a whole, or skinned
        else:
            points = stencil.points(np.stack([each.points for each in poses]))
        if self._skinning is None:
            return SkinPose(_NO_JOINTS.joints, _NO_JOINTS.weights, points), matrix
        joints = stencil.map(self._joints(stencil, poses))
        weights = stencil.value(np.stack([each.weights for each in poses]))
        return SkinPose(joints, weights, points), matrix

    @property
    def joint_tree(self) -> JointTree | None:
        """Return the joints that move it; None where none do."""
        query = None if self._skinning is None else self._skinning.skeleton
        if query is None:
            return None
        parents = np.array(query.GetTopology().GetParentIndices(), dtype=np.int64)
        names = tuple(str(each) for each in query.GetJointOrder())
        return JointTree(str(self._skinning.space.GetPath()), names, parents)

    def joint_matrices(self, code: float | None) -> Array:
        """Return (J + 1, 4, 4) from joints, and at last from the skeleton, to the world at a time
        code; None: at rest."""
        query = self._skinning.skeleton
        if code is None and self._rest_code.IsDefault():
            own = np.array(query.GetJointWorldBindTransforms())
            matrix = self._matrix(self._rest_code)
        else:
            with self._lock:
                pose, matrix = self._pose(self._rest_code.GetValue() if code is None else code)
            own = self._skinning.joint_spaces.stack(pose.joints)
        return np.concatenate([own @ matrix, matrix[None]])

    def posed_points(self, code: float, joints: Array) -> Array:
        """Return (V, 3) m, all points at a time code with joints (J + 1, 4, 4) in the world as of
        joint_matrices."""
        parents = np.array(self._skinning.skeleton.GetTopology().GetParentIndices())
        own = joints[:-1] @ np.linalg.inv(joints[parents])
        with self._lock:
            pose, _ = self._pose(code)
        local = self._skinning.posed(pose._replace(joints=own))
        return transform_points(self._drawn(local), joints[-1])

    def _joints(self, stencil: Stencil, poses: list[_KnotPose]) -> Maps:
        """Those at the knots about a time; the last are kept."""
        around = stencil.times.tolist(), stencil.middles
        if self._maps is None or self._maps[0] != around:
            self._maps = around, stencil.apart(np.stack([each.joints for each in poses]))
        return self._maps[1]

    def _at_knot(self, time: float) -> _KnotPose:
        """As the scene has it at a knot; the last few are kept."""
        if time not in self._poses:
            code = Usd.TimeCode(time)
            if self._skinning is None:
                pose = _NO_JOINTS._replace(points=self._local_points(code))
            else:
                pose = self._skinning.pose(code)
            last = next(reversed(self._poses.values()), None)
            if last is not None and np.array_equal(last.points, pose.points):
                pose = pose._replace(points=last.points)
            self._poses[time] = _KnotPose(*pose, self._matrix(code))
            if len(self._poses) > _MAX_KNOTS:
                self._poses.popitem(last=False)
        return self._poses[time]

    @property
    def looks(self) -> list[float]:
        """Return time codes that tell its motion: its samples, evenly spread where there are
        many."""
        count = len(self.times)
        chosen = np.linspace(0, count - 1, min(count, _MAX_LOOKS)).round()
        return [self.times[k] for k in chosen.astype(int).tolist()]

    def displacement(self, codes: Sequence[float]) -> float:
        """Return the largest distance (m) of a point at time codes from where it is at the
        first."""
        places = map(self.points, codes)
        first = next(places, None)
        ways = (each - first for each in places if first is not None)
        squares = (np.einsum("vc,vc->v", way, way).max(initial=0.0) for way in ways)
        return float(np.sqrt(max(squares, default=0.0)))

    def describe_motion(self, codes: Sequence[float]) -> str:
        """Return how it moves over the time codes of a shot, in words."""
        if self.idle or self.sampled is None:
            return self.idle or "still"
        return f"moves {self.displacement(codes):.3g} m in the shot"

    def is_still(self) -> bool:
        """Return whether no point moves at its samples."""
        first, *later = map(Usd.TimeCode, self.looks or [0.0])
        matrix, points = self._matrix(first), self._skinning and self._skinning.first
        points = self._local_points(first) if points is None else points
        return all(
            np.array_equal(self._matrix(code), matrix)
            and np.array_equal(self._local_points(code), points)
            for code in later
        )

    def is_mirrored(self, code: float) -> bool:
        """Return whether the transforms mirror the mesh at a time code, and not at rest."""
        return self._sign(Usd.TimeCode(code)) != self.mirrored

    def _finite(self, points: Array, code: float | None) -> Array:
        # a pose between samples, or of a skeleton, is not checked when the mesh is opened
        if not np.isfinite(points).all():
            when = "at rest" if code is None else f"at time code {code:g}"
            message = f"points are not finite {when}. Give numbers"
            raise InputError(Problem(str(self._scene.path), self.path, message))
        return points

    def _local_points(self, code: Any) -> NDArray[Any]:
        """Return points in the space that _matrix is of."""
        if self._skinning is not None:
            found: NDArray[Any] = self._skinning.points(code)
            return found
        return read_sized_array(self._mesh.GetPointsAttr(), code, VECTOR_ARRAY)

    def _matrix(self, code: Any) -> Array:
        """Return (4, 4) from the space of the points to the world, row vectors."""
        return to_world_matrix(self._to_stage(code), self._scene.to_world)

    def _at_rest(self, is_default: bool) -> Array:
        if is_default and self._skinning is not None:
            local = self._skinning.bind_points()
        elif is_default:
            self._rest_code = rest_time(self._mesh.GetPointsAttr())
            local = read_sized_array(self._mesh.GetPointsAttr(), self._rest_code, VECTOR_ARRAY)
        else:
            local = self._local_points(self._rest_code)
        matrix = self._matrix(self._rest_code)
        bound = np.eye(4) if self._skinning is None else self._skinning.bind_matrix
        self.rest_matrix = bound @ matrix
        return self._finite(transform_points(local, matrix), None)

    def turn(self, first: float, last: float) -> float:
        """Return the angle (rad) by which transforms turn it between time codes, by way of their
        middle."""
        codes = first, 0.5 * (first + last), last
        a, b, c = matrices = [self._matrix(Usd.TimeCode(code))[:3, :3] for code in codes]
        if min(np.linalg.det(matrices)) * max(np.linalg.det(matrices)) <= 0.0:
            return 0.0  # mirrored from one to the next, or matrices between opposite ones
        steps = np.linalg.solve([a, b], [b, c])
        return float(Rotation.from_matrix(steps).magnitude().sum())

    def _sign(self, code: Any) -> bool:
        return bool(np.linalg.det(self._matrix(code)[:3, :3]) < 0.0)


def open_mesh(scene: SourceScene, path: str, options: MeshOptions, place: Place) -> Surface:
    """A mesh by its prim path. Raises InputError with all problems, which name the prim."""
    prim = find_prim(scene, path, place, "mesh")
    if not prim.IsA(UsdGeom.Mesh):
        meshes = [str(p.GetPath()) for p in Usd.PrimRange(prim) if p.IsA(UsdGeom.Mesh)][:3]
        hint = f". Below it is {', '.join(meshes)}" if meshes else ""
        hint = hint or describe_prims(scene, ("mesh",), path)
        place.refuse(f"{path} is a {prim.GetTypeName() or 'prim without type'}, no Mesh{hint}")
    with errors_at(place):
        mesh = UsdGeom.Mesh(prim)
        skinning = find_skinning(scene, mesh, place)
        return open_drawn(scene, place_mesh(mesh, skinning), options, place)


def open_drawn(scene: SourceScene, drawn: DrawnMesh, options: MeshOptions, place: Place) -> Surface:
    """Return the surface of a drawn mesh of a scene. Raises InputError with all problems."""
    mesh, prim, problems = drawn.mesh, drawn.mesh.GetPrim(), Problems()
    path = f"{prim.GetPath()}{{}} in {scene.path}: {{}}"
    for attribute, message in list_topology_faults(mesh):
        problems.add(place.source, place.key, path.format(f".{attribute}", message))
    with problems.collecting():
        check_transforms(scene, prim, place)
    problems.hand_on()
    opened = Surface(scene, drawn, options)
    if len(opened.triangles) == 0:
        place.refuse(path.format("", "no face has any area. Name a mesh with faces"))
    idle = explain_stillness(prim)
    if idle and not options.is_driven and opened.is_still():
        opened.idle = idle
        warn_input(f"{scene.path}: {prim.GetPath()}: {idle}")
    return opened
