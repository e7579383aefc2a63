"""Points on a skin: triangles with areas and smooth normals, and places within them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots, face_products, unit
from featherfx.errors import some_of
from featherfx.files.disk_cache import kept
from featherfx.groom.keys.problems import Place
from featherfx.groom.skin.field import search_tree, size_classes

_AT_ONCE = 2_000_000  # pairs of a point and a triangle


class GroomedMesh(Protocol):
    """A mesh: rest (V, 3) m, triangles (T, 3), face (T,) of each.

    border: (T,) those with an edge of their own. turned: faces that were turned round.
    """

    rest: Array
    triangles: Indices
    face: Indices
    border: Flags
    turned: Indices


def skin_doubts(mesh: GroomedMesh) -> list[str]:
    """Return doubts about a mesh: open borders, turned faces, and faces that cross."""
    doubts = []
    if mesh.border.any():
        doubts.append(
            f"is not closed at {_faces(mesh.face[mesh.border])}; feathers there show their roots "
            "from below"
        )
    if len(mesh.turned):
        doubts.append(
            f"{_faces(mesh.turned)}: wound against the surface, read turned round; reverse "
            "these faces, or set the orientation of the mesh"
        )
    crossing = crossing_triangles(mesh.rest, mesh.triangles)
    if len(crossing):
        doubts.append(
            f"passes through itself: {len(crossing)} pairs of triangles, "
            f"{_faces(mesh.face[crossing.ravel()])}; roots inside the body are left out"
        )
    return doubts


def signed_volume(corners: Array) -> float:
    """m^3, enclosed by triangles (T, 3, 3); negative where they look inwards."""
    products = np.cross(corners[:, 1], corners[:, 2])
    return float(np.einsum("tc,tc->", corners[:, 0], products) / 6.0)


def crossing_triangles(points: Array, triangles: Indices) -> Indices:
    """(K, 2) pairs of triangles that pass through each other; see _crossing."""
    inputs = [points, triangles]
    return kept("crossings", inputs, lambda: {"pairs": _crossing(points, triangles)})["pairs"]


def _crossing(points: Array, triangles: Indices) -> Indices:
    """(K, 2) pairs of triangles without a common point that pass through each other."""
    corners = points[triangles]
    pairs = _near_pairs(corners)
    shared = (triangles[pairs[:, 0], :, None] == triangles[pairs[:, 1], None, :]).any(axis=(1, 2))
    pairs = pairs[~shared]
    apart = (corners[pairs[:, 0]].min(axis=1) > corners[pairs[:, 1]].max(axis=1)).any(axis=1)
    apart |= (corners[pairs[:, 1]].min(axis=1) > corners[pairs[:, 0]].max(axis=1)).any(axis=1)
    pairs = pairs[~apart]
    found = np.zeros(len(pairs), dtype=np.bool_)
    for one, other in ((0, 1), (1, 0)):
        for edge in range(3):
            start = corners[pairs[:, one], edge]
            end = corners[pairs[:, one], (edge + 1) % 3]
            found |= _pierced(start, end, corners[pairs[:, other]])
    return pairs[found]


def within(points: Array, corners: Array) -> Flags:
    """(N,) whether points (N, 3) lie inside triangles (T, 3, 3), however these cross each other.

    By the winding number: the sum of the solid angles of all triangles over 4 pi (Jacobson 2013;
    solid angle by Van Oosterom and Strackee 1983). Work grows as N times T.
    """
    inside = np.zeros(len(points), dtype=np.bool_)
    step = max(1, _AT_ONCE // max(len(corners), 1))
    for start in range(0, len(points), step):
        block = slice(start, start + step)
        a, b, c = np.moveaxis(corners[None] - points[block, None, None], 2, 0)
        na, nb, nc = (np.linalg.norm(each, axis=2) for each in (a, b, c))
        volume = np.einsum("ntc,ntc->nt", a, np.cross(b, c))
        bulk = na * nb * nc
        for first, second, other in ((a, b, nc), (b, c, na), (c, a, nb)):
            bulk = bulk + np.einsum("ntc,ntc->nt", first, second) * other
        winding = np.arctan2(volume, bulk).sum(axis=1) / (2.0 * np.pi)
        inside[block] = winding > 0.5
    return inside


def _near_pairs(corners: Array) -> Indices:
    """(K, 2) pairs whose bounding spheres meet; by classes of size."""
    classes = size_classes(corners)
    found = [np.zeros((0, 2), dtype=np.int64)]
    for i, first in enumerate(classes):
        for j, second in enumerate(classes[: i + 1]):
            reach = first.radii.max() + second.radii.max()
            near = first.tree.sparse_distance_matrix(second.tree, reach, output_type="ndarray")
            a, b = first.members[near["i"]], second.members[near["j"]]
            meet = near["v"] <= first.radii[near["i"]] + second.radii[near["j"]]
            kept = meet & ((i != j) | (a < b))
            found.append(np.stack([a[kept], b[kept]], axis=1))
    return np.concatenate(found)


def _pierced(start: Array, end: Array, corners: Array) -> Flags:
    """(K,) whether a segment passes through the inside of a triangle (Moeller, Trumbore 1997)."""
    along = end - start
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(along, second)
    determinant = (first * across).sum(axis=1)
    sound = np.abs(determinant) > 1e-30
    inverse = 1.0 / np.where(sound, determinant, 1.0)
    away = start - corners[:, 0]
    u = (away * across).sum(axis=1) * inverse
    turned = np.cross(away, first)
    v = (along * turned).sum(axis=1) * inverse
    t = (second * turned).sum(axis=1) * inverse
    return sound & (u > 0.0) & (v > 0.0) & (u + v < 1.0) & (t > 0.0) & (t < 1.0)


def _faces(faces: Indices) -> str:
    named = np.unique(faces)
    return f"face{'s' if len(named) > 1 else ''} {some_of(list(map(str, named)))}"


_MAX_ROUNDS = 60
_TOUCHING = 1e-6  # share of the radius by which a point may lie inside
_ABOVE = 1e-6  # of the skin's size: how far over it a place is looked at

# along no axis, edge or diagonal of usual meshes, so that one point is farthest
_DIRECTION = np.array([0.617, -0.523, -0.588])


class SkinSource(Protocol):
    """A mesh that a scene holds, at rest; metres, z up.

    path: of the prim. points: (V, 3) m. triangles: (T, 3), counter-clockwise from outside, none
    flat. face: (T,) the scene's faces. st: (T, 3, 2) texture coordinates of the primvar uv, or
    None. wrap: what pictures are outside of 0 to 1: black, clamp, repeat or mirror. own_matrix,
    stage_matrix: (4, 4), row vectors, from the mesh's own space at rest, and the stage's, to here.
    is_ribbon: whether it is a ribbon along bones or a curve, on which nothing grows. What is asked
    for by name at a place raises InputError where it is not there.
    """

    path: str
    points: Array
    triangles: Indices
    face: Indices
    st: Array | None
    uv: str
    wrap: str
    own_matrix: Array
    stage_matrix: Array
    is_ribbon: bool

    def joint(self, name: str, place: Place) -> Array:
        """(3,) m, a joint of the mesh's skeleton in the bind pose."""

    def weights(self, name: str, place: Place) -> Array:
        """(T, 3) a scalar primvar at the corners."""

    def colours(self, name: str, place: Place) -> Array:
        """(T, 3, 3) a primvar of three components at the corners."""

    def vectors(self, name: str, place: Place) -> Array:
        """(T, 3, 3) a vector primvar at the corners, in the world."""

    def subset(self, name: str, place: Place) -> Flags:
        """(T,) whether triangles are of a named set of faces."""

    def image(self, path: Path, place: Place, mode: str) -> Array:
        """(H, W) grey values 0 to 1 of a picture, top row first; (H, W, 3) sRGB in mode RGB."""

    def curves(self, prims: tuple[str, ...], place: Place) -> list[Array]:
        """Polylines (k, 3) m of curves at or below prims."""


@dataclass(frozen=True)
class SkinSurface:
    """A skin as feathers grow on it. source: what it was read from."""

    source: SkinSource

    @cached_property
    def corners(self) -> Array:
        """(T, 3, 3) m."""
        return self.source.points[self.source.triangles]

    @cached_property
    def _products(self) -> Array:
        return face_products(self.corners)

    @cached_property
    def areas(self) -> Array:
        """(T,) m^2."""
        return 0.5 * np.sqrt((self._products**2).sum(axis=1))

    @cached_property
    def domain(self) -> SkinDomain:
        """The triangles in the mesh's own space, from an origin of its shape."""
        return make_domain(self.corners, self.source.own_matrix, self.source.stage_matrix)

    @cached_property
    def borders(self) -> tuple[SurfacePoints, Array]:
        """Middles of the edges that one face alone has, and their lengths (N,) m."""
        triangles = self.source.triangles
        # seams have their points twice
        _, welded = np.unique(self.source.points, axis=0, return_inverse=True)
        joined = np.sort(welded.reshape(-1)[triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 3, 2)], 2)
        keys = (joined[:, :, 0] * len(self.source.points) + joined[:, :, 1]).ravel()
        _, place, count = np.unique(keys, return_inverse=True, return_counts=True)
        triangle, side = np.divmod(np.flatnonzero(count[place.reshape(-1)] == 1), 3)
        middle = self.at(triangle, 0.5 * (1.0 - np.eye(3))[(side + 2) % 3])
        ends = self.corners[triangle, side] - self.corners[triangle, (side + 1) % 3]
        return middle, np.linalg.norm(ends, axis=1)

    @cached_property
    def samples(self) -> tuple[SurfacePoints, ...]:
        """Four sets of one point of each triangle, which stand for a fourth of its area each."""
        places = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 2]]) / 6.0
        triangle = np.arange(len(self.areas))
        wide = [np.broadcast_to(place, (len(triangle), 3)) for place in places]
        return tuple(self.at(triangle, place) for place in wide)

    @cached_property
    def spheres(self) -> tuple[Array, Array]:
        """Middles (T, 3) m of the triangles, and radii (T,) m of balls around that hold them."""
        middles = self.corners.mean(axis=1)
        return middles, np.linalg.norm(self.corners - middles[:, None], axis=2).max(axis=1)

    @cached_property
    def normals(self) -> Array:
        """(V, 3) unit, mean of the faces around by their area."""
        summed = np.zeros_like(self.source.points)
        for corner in range(3):
            np.add.at(summed, self.source.triangles[:, corner], self._products)
        return np.asarray(unit(summed))

    @cached_property
    def room(self) -> Array:
        """(T, 3) m, at the corners: radius of the largest ball that touches the skin outside."""
        triangles, points = self.source.triangles, self.source.points

        def compute() -> dict[str, Array]:
            used, own = np.unique(triangles, return_inverse=True)
            radii = room_above(points[used], self.normals[used], self.diagonal)
            return {"radii": radii[own.reshape(triangles.shape)]}

        return kept("room", [points, triangles], compute)["radii"]

    @cached_property
    def _tree(self) -> Any:
        return search_tree(self.corners.mean(axis=1))

    def normals_near(self, points: Array) -> Array:
        """(N, 3) unit normals of the triangles whose middles are nearest to points (N, 3) m."""
        _, near = self._tree.query(points)
        found = self._products[near]
        return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))

    def heights_near(self, points: Array) -> Array:
        """(N,) m, of points (N, 3) m over the planes of the triangles that normals_near takes."""
        _, near = self._tree.query(points)
        found = self._products[near]
        above = dots(points - self.corners[near, 0], found)
        return np.asarray(above / np.linalg.norm(found, axis=1))

    def buried(self, points: SurfacePoints) -> Flags:
        """(N,) whether places lie inside the body, as they do where it passes through itself."""
        if not len(crossing_triangles(self.source.points, self.source.triangles)):
            return np.zeros(len(points), dtype=np.bool_)
        # by the face's own normal: smooth ones may point into a coarse mesh
        above = unit(self._products[points.triangle])
        just_above = points.position + _ABOVE * self.diagonal * above
        return within(just_above, self.corners)

    @cached_property
    def diagonal(self) -> float:
        """m, of the box around all triangles."""
        used = self.corners.reshape(-1, 3)
        return float(np.linalg.norm(np.ptp(used, axis=0)))

    def at(self, triangle: Indices, barycentric: Array) -> SurfacePoints:
        """Points within triangles (N,) at barycentric coordinates (N, 3)."""
        position = np.einsum("nk,nkc->nc", barycentric, self.corners[triangle])
        corners = self.normals[self.source.triangles[triangle]]
        normal = np.einsum("nk,nkc->nc", barycentric, corners)
        flat = self._products[triangle]
        # where smooth normals cancel, as in a crease, the face's own
        weak = np.linalg.norm(normal, axis=1) < 0.1
        normal = np.where(weak[:, None], flat, normal)
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        return SurfacePoints(self, triangle, barycentric, position, normal)


@dataclass(frozen=True)
class SurfacePoints:
    """N places on a skin. triangle: (N,). barycentric, position (m), normal (unit): (N, 3)."""

    surface: SkinSurface
    triangle: Indices
    barycentric: Array
    position: Array
    normal: Array

    def __len__(self) -> int:
        return len(self.triangle)

    def interpolated(self, corners: Array) -> Array:
        """(N, ...) values between those of the corners (T, 3, ...)."""
        return np.asarray(np.einsum("nk,nk...->n...", self.barycentric, corners[self.triangle]))

    def some(self, kept: Flags | Indices) -> SurfacePoints:
        """Those that are kept, or with these numbers."""
        return SurfacePoints(
            self.surface,
            self.triangle[kept],
            self.barycentric[kept],
            self.position[kept],
            self.normal[kept],
        )


def room_above(points: Array, normals: Array, most: float) -> Array:
    """(V,) m, radius of the largest ball outside a skin at each of its points, at most `most`.

    points: (V, 3) m, of the skin, dense enough to stand for it. normals: (V, 3) unit or zero,
    outwards; where zero the radius is 0.

    A ball with its middle at p + r n touches the skin at p; a point q of the skin within it forces
    the radius down to |q - p|^2 / (2 n . (q - p)), where the ball passes through p and q. Repeated
    with the point nearest to the middle until none lies inside (shrinking balls, Ma, Bae and Choi
    2012). It is half the distance of parts that face each other, and the radius of curvature of a
    hollow.
    """
    tree = search_tree(points)
    radius = np.where(normals.any(axis=1), most, 0.0)
    active = np.flatnonzero(radius > 0.0)
    for _ in range(_MAX_ROUNDS):
        start, normal = points[active], normals[active]
        distance, near = tree.query(start + radius[active, None] * normal, workers=-1)
        inside = (near != active) & (distance < (1.0 - _TOUCHING) * radius[active])
        active, near = active[inside], near[inside]
        if len(active) == 0:
            break
        way = points[near] - points[active]
        height = dots(way, normals[active])
        # a point inside the ball lies above the tangent plane, so the height is positive
        radius[active] = 0.5 * dots(way, way) / np.maximum(height, 1e-300)
    return radius


@dataclass(frozen=True)
class SkinDomain:
    """A skin of T triangles in a space that follows its shape: what is drawn in it stays.

    The space is the mesh's own, in metres and z up, so that transforms do not matter. Its origin is
    the skin's farthest point in one direction. The order, size and corners of faces do not matter
    there. Points that move together take it along; an edit anywhere else leaves it where it is.

    corners: (T, 3, 3) m. normals: (T, 3) unit. area: m^2, of the whole, to a power of two.
    """

    corners: Array
    normals: Array
    area: float


def make_domain(corners: Array, own: Array, stage: Array) -> SkinDomain:
    """Return the domain of triangles (T, 3, 3) m.

    own, stage: (4, 4) matrices that lead here from the mesh's own space and from its stage's.
    """
    scales = [np.cbrt(abs(np.linalg.det(each[:3, :3]))) for each in (own, stage)]
    # up is up in the domain, whatever axis and unit the stage has
    turn = np.linalg.inv(own[:3, :3]) @ stage[:3, :3] * scales[0] / scales[1]
    placed = (corners - own[3, :3]) @ turn
    points = placed.reshape(-1, 3)
    origin = points[np.argmax(points @ _DIRECTION)]
    products = face_products(placed)
    sizes = np.linalg.norm(products, axis=1)
    area = 2.0 ** np.floor(np.log2(0.5 * sizes.sum()))
    return SkinDomain(np.ascontiguousarray(placed - origin), products / sizes[:, None], float(area))
