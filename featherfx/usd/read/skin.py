"""Skins to groom: a mesh of a stage at rest, with its primvars, subsets and guide curves."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdSkel

from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputWarning
from featherfx.groom.keys.values import Place, nearest
from featherfx.groom.skin.faults import skin_faults
from featherfx.usd.read.animated_mesh import AnimatedMesh, topology_of
from featherfx.usd.read.curves import curves_of
from featherfx.usd.read.opening import located
from featherfx.usd.read.ribbons import open_carrier
from featherfx.usd.read.skinning import points_of_joint
from featherfx.usd.read.stage import (
    SourceScene,
    find_prim,
    in_world,
    open_scene,
    prims_below,
    rest_code,
    transform_code,
    transformed,
    what_is_there,
)
from featherfx.usd.read.values import (
    DEFAULT,
    EARLIEST,
    INTEGERS,
    MATRICES,
    NUMBERS,
    VECTORS,
    array_of,
    collecting,
    elements,
    flattened,
    numbers_of,
    sized_array,
    texts_of,
)


def read_skin(
    skin: dict[str, Any], paths: tuple[str, ...], folder: Path, place: Place
) -> dict[str, SkinMesh] | None:
    """Meshes by their paths, of the file that checked keys of [skin] name; None after problems.

    Warns of holes and of faces that pass through each other.
    """
    scene = open_scene(located(folder, skin["usd"]), place.child("usd"))
    if scene is None:
        return None
    found = {}
    for path in paths:
        mesh = open_carrier(scene, path, skin["rest"], place.child("prim"))
        if mesh is None:
            continue
        found[path] = SkinMesh(scene, mesh)
        if mesh.bones is not None:
            continue
        problems, doubts = skin_faults(mesh.rest, mesh.triangles, mesh.face)
        for message in problems:
            place.child("prim").fail(f"{path} in {scene.path}: {message}")
        for message in doubts:
            warnings.warn(f"{scene.path}: {path}: {message}", InputWarning, stacklevel=2)
    return found if len(found) == len(paths) else None


class SkinMesh:
    """A mesh as featherfx.groom.skin.points.SkinSource describes it."""

    def __init__(self, scene: SourceScene, mesh: AnimatedMesh) -> None:
        self._scene, self._prim = scene, scene.stage.GetPrimAtPath(mesh.path)
        self.path, self.points = mesh.path, mesh.rest
        self.triangles, self.face, self.st = mesh.triangles, mesh.face, mesh.st
        self.own_matrix, self.is_ribbon = mesh.rest_matrix, mesh.bones is not None
        self.stage_matrix = in_world(np.eye(4), scene.to_world)

    def joint(self, name: str, place: Place) -> Array | None:
        """(3,) m, a joint of the mesh's skeleton in the bind pose; None after adding a problem."""
        with collecting(place):
            skeleton = self._prim
            if not skeleton.IsA(UsdSkel.Skeleton):
                skeleton = UsdSkel.BindingAPI(self._prim).GetInheritedSkeleton().GetPrim()
            if not skeleton:
                return place.fail(f"no skeleton moves {self.path}") and None
            bound = _bind_places(self._scene, skeleton, place)
            number = None if bound is None else _number(name, bound[0], place)
            if bound is None or number is None:
                return None
            return _from_skeleton(self._scene, skeleton, bound[1][number], place)
        return None

    def weights(self, name: str, place: Place) -> Array | None:
        """(T, 3) a scalar primvar at the corners; None after adding a problem."""
        return self._primvar(name, 1, place)

    def vectors(self, name: str, place: Place) -> Array | None:
        """(T, 3, 3) a vector primvar at the corners, in the world; None after a problem."""
        local = self._primvar(name, 3, place)
        if local is None:
            return None
        code = transform_code(self._prim, Usd.TimeCode.Default())
        return np.asarray(local @ self._scene.matrix(self._prim, code)[:3, :3])

    def subset(self, name: str, place: Place) -> NDArray[np.bool_] | None:
        """(T,) whether triangles are of a named set of faces; None after adding a problem."""
        subsets = {
            each.GetPrim().GetName(): each
            for each in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Mesh(self._prim))
        }
        if name not in subsets:
            place.fail(f"no subset '{name}' on {self.path}, {nearest(name, subsets)}")
            return None
        with collecting(place):
            indices = sized_array(subsets[name].GetIndicesAttr(), EARLIEST, INTEGERS)
            return np.isin(self.face, indices)
        return None

    def image(self, path: Path, place: Place) -> Array | None:
        """(H, W) grey values 0 to 1 of a picture, top row first; None after adding a problem."""
        try:
            from PIL import Image
        except ImportError:
            place.fail('needs Pillow; pip install "featherfx[preview]"')
            return None
        try:
            with Image.open(path) as image:
                return np.asarray(image.convert("L"), dtype=np.float64) / 255.0
        except FileNotFoundError:
            place.fail(f"{path}: there is no such file")
        except OSError as error:
            place.fail(f"{path}: cannot be read: {error}")
        return None

    def curves(self, prims: tuple[str, ...], place: Place) -> list[Array] | None:
        """Polylines (k, 3) m of curves at or below prims; None after adding problems."""
        return _curves(self._scene, prims, place)

    def _primvar(self, name: str, size: int, place: Place) -> Array | None:
        """(T, 3) or (T, 3, size) values at the corners of the triangles."""
        with collecting(place):
            return self._at_corners(name, size, place)
        return None

    def _at_corners(self, name: str, size: int, place: Place) -> Array | None:
        api = UsdGeom.PrimvarsAPI(self._prim)
        primvar = api.FindPrimvarWithInheritance(name)
        value = flattened(primvar, EARLIEST)
        if value is None:
            known = [each.GetPrimvarName() for each in api.GetPrimvarsWithValues()]
            place.fail(f"no primvar '{name}' on {self.path}, {nearest(name, known)}")
            return None
        kind = NUMBERS if size == 1 else VECTORS
        values = numbers_of(elements(value), kind, primvar.GetAttr()).astype(np.float64)
        if not np.isfinite(values).all():
            place.fail(f"primvar '{name}' on {self.path} holds values that are not finite")
            return None
        corners = self._corners(values, str(primvar.GetInterpolation()))
        if corners is None:
            place.fail(f"primvar '{name}' on {self.path} has {len(values)} values that fit nothing")
        return corners

    def _corners(self, values: Array, interpolation: str) -> Array | None:
        """Values of constant, uniform, vertex or face-varying elements at triangle corners."""
        if len(values) == 1:
            return np.broadcast_to(values[0], (*self.triangles.shape, *values.shape[1:]))
        counts, indices = topology_of(UsdGeom.Mesh(self._prim))
        if interpolation == UsdGeom.Tokens.uniform and len(values) == len(counts):
            return np.repeat(values[self.face][:, None], 3, axis=1)
        if interpolation == UsdGeom.Tokens.faceVarying and len(values) == counts.sum():
            return self._face_varying(values, counts, indices)
        return values[self.triangles] if len(values) == len(self.points) else None

    def _face_varying(self, values: Array, counts: Indices, indices: Indices) -> Array:
        # a triangle's corners stand in the list of its face's corners
        starts = (np.cumsum(counts) - counts)[self.face]
        result = np.zeros((*self.triangles.shape, *values.shape[1:]))
        for corner in range(3):
            for offset in range(int(counts.max())):
                at = np.minimum(starts + offset, len(indices) - 1)
                fits = (offset < counts[self.face]) & (indices[at] == self.triangles[:, corner])
                result[fits, corner] = values[at[fits]]
        return result


def read_curves(folder: Path, entry: dict[str, Any], place: Place) -> list[Array] | None:
    """Polylines (k, 3) m of the curves at or below a prim of a USD file, or of a skeleton's joints.

    entry: checked keys of the curve of a row. None after adding problems.
    """
    scene = open_scene(located(folder, entry["usd"]), place.child("usd"))
    root = (
        None
        if scene is None
        else find_prim(scene, entry["prim"], place.child("prim"), "curves", "skeleton")
    )
    if scene is None or root is None:
        return None
    with collecting(place):
        return _lines(scene, root, entry, place)
    return None


def _lines(
    scene: SourceScene, root: Any, entry: dict[str, Any], place: Place
) -> list[Array] | None:
    if not root.IsA(UsdSkel.Skeleton):
        if entry["joints"]:
            place.child("joints").fail(f"{entry['prim']} in {scene.path} is no Skeleton")
            return None
        return _curves(scene, (entry["prim"],), place.child("prim"))
    if len(entry["joints"]) < 2:
        known = ", ".join(texts_of(UsdSkel.Skeleton(root).GetJointsAttr()))
        place.child("joints").fail(f"expects two or more of {entry['prim']}, known: {known}")
        return None
    line = joint_line(scene, root, entry["joints"], place, entry["tail"])
    return None if line is None else [line]


def _curves(scene: SourceScene, prims: tuple[str, ...], place: Place) -> list[Array] | None:
    """Lines of at least two points; None after adding problems."""
    found: list[Array] = []
    problems = len(place.problems)
    for path in prims:
        root = find_prim(scene, path, place, "curves")
        if root is None:
            return None
        for prim in prims_below(scene, root):
            if prim.IsA(UsdGeom.BasisCurves):
                with collecting(place):
                    found += _polylines(scene, prim, place)
    if not found and len(place.problems) == problems:
        there = what_is_there(scene, ("curves",), prims[0])
        place.fail(f"no curves at {', '.join(prims)} or below in {scene.path}{there}")
    return found if len(place.problems) == problems else None


def _polylines(scene: SourceScene, prim: Any, place: Place) -> list[Array]:
    """(k, 3) m of each curve of a prim; none after adding problems."""
    code = rest_code(UsdGeom.BasisCurves(prim).GetPointsAttr())
    at = Place(str(scene.path), str(prim.GetPath()), place.problems)
    curves = curves_of(prim, code, at)
    if curves is None:
        return []
    matrix = scene.matrix(prim, transform_code(prim, code))
    return [transformed(curves.line(number), matrix) for number in range(len(curves))]


def joint_line(
    scene: SourceScene, prim: Any, names: tuple[str, ...], place: Place, tail: bool = False
) -> Array | None:
    """(k, 3) m, places of joints in the bind pose of a skeleton; None after adding problems.

    names: paths as the skeleton has them, or their last parts where these are unique. tail: whether
    the line goes on to the end of the last joint's bone.
    """
    bound = _bind_places(scene, prim, place)
    if bound is None:
        return None
    paths, places = bound
    found = [_number(name, paths, place.child("joints").item(k)) for k, name in enumerate(names)]
    chosen = [each for each in found if each is not None]
    if len(chosen) < len(found):
        return None
    end = _tail(scene, prim, paths, places, chosen) if tail else None
    local = places[chosen] if end is None else np.vstack([places[chosen], end])
    points = _from_skeleton(scene, prim, local, place)
    if points is None:
        return None
    if (np.diff(points, axis=0) == 0.0).all(axis=1).any():
        place.child("joints").fail("two joints that follow each other are at one place")
        return None
    return points


def _bind_places(scene: SourceScene, prim: Any, place: Place) -> tuple[list[str], Array] | None:
    """Paths of a skeleton's joints, and their places (J, 3) in its space in the bind pose."""
    skeleton = UsdSkel.Skeleton(prim)
    paths = texts_of(skeleton.GetJointsAttr(), EARLIEST)
    bind = array_of(skeleton.GetBindTransformsAttr(), EARLIEST, MATRICES)
    if bind is None or len(bind) != len(paths) or not paths:
        place.fail(f"{prim.GetPath()} in {scene.path} has no bind transform for every joint")
        return None
    return paths, bind.astype(np.float64)[:, 3, :3]


def _from_skeleton(scene: SourceScene, prim: Any, local: Array, place: Place) -> Array | None:
    """(k, 3) m, of points in a skeleton's space; None after adding a problem."""
    points = transformed(local, scene.matrix(prim, transform_code(prim, DEFAULT)))
    if not np.isfinite(points).all():
        place.fail(f"{prim.GetPath()} in {scene.path}: bind transforms are not finite")
        return None
    return points


def _tail(
    scene: SourceScene, prim: Any, paths: list[str], places: Array, chosen: list[int]
) -> Array | None:
    """(3,) end of the bone of the last of the chosen joints in the skeleton's space: the place of
    the joint below it that goes on straightest, or as far on as the skin that it moves; None where
    it has neither.
    """
    before, last = chosen[-2:]
    onwards = places[last] - places[before]
    size = float(np.linalg.norm(onwards))
    if size == 0.0:
        return None
    straight = onwards / size
    below = [k for k, path in enumerate(paths) if path.rpartition("/")[0] == paths[last]]
    ways = np.array([places[k] - places[last] for k in below]).reshape(-1, 3)
    long = np.linalg.norm(ways, axis=1)
    if (long > 0.0).any():
        bent = np.where(long > 0.0, ways @ straight / np.where(long > 0.0, long, 1.0), -np.inf)
        return np.asarray(places[below[int(bent.argmax())]])
    moved = points_of_joint(scene, prim, last)
    reach = float(((moved - places[last]) @ straight).max(initial=0.0))
    return places[last] + reach * straight if reach > 0.0 else None


def _number(name: str, paths: list[str], place: Place) -> int | None:
    """The number of a joint; None after adding a problem."""
    if name in paths:
        return paths.index(name)
    found = [k for k, path in enumerate(paths) if path.rsplit("/", 1)[-1] == name]
    if len(found) == 1:
        return found[0]
    if found:
        several = ", ".join(paths[k] for k in found)
        place.fail(f"'{name}' may be {several}; give the whole path")
    else:
        known = {path.rsplit("/", 1)[-1] for path in paths} | set(paths)
        place.fail(f"no joint '{name}', {nearest(name, known)}")
    return None
