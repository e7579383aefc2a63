"""Skins to groom: a mesh of a stage at rest, with its primvars, subsets and guide curves."""

from __future__ import annotations

from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pxr import UsdGeom, UsdSkel

from featherfx.algebra.types import Array, Flags
from featherfx.errors import all_of, warn_input
from featherfx.groom.keys.problems import Place, Problems, nearest
from featherfx.groom.skin.points import skin_doubts
from featherfx.phases import StageRead, note_read
from featherfx.usd.read.curves import is_curves, read_prim_curves
from featherfx.usd.read.mesh_topology import read_primvar
from featherfx.usd.read.ribbons import open_carrier
from featherfx.usd.read.skinning import find_joint_points
from featherfx.usd.read.stage import (
    SourceScene,
    describe_prims,
    find_prim,
    open_chosen,
    prims_below,
    rest_time,
    to_world_matrix,
    transform_points,
)
from featherfx.usd.read.surface import MeshOptions, Surface
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    EARLIEST_TIME,
    INTEGER_ARRAY,
    MATRIX_ARRAY,
    NUMBER_ARRAY,
    VECTOR_ARRAY,
    errors_at,
    locate_file,
    read_array,
    read_sized_array,
    read_texts,
)


def read_skin(
    skin: dict[str, Any], paths: dict[str, Place], folder: Path, place: Place
) -> dict[str, StageSkin]:
    """Meshes by their paths, of the file that checked keys of [skin] name. Raises InputError where
    they cannot be opened.

    Warns of holes and of faces that pass through each other. paths: with the key that names each.
    place: of [skin].
    """
    scene = open_chosen(locate_file(folder, skin["usd"]), skin, place.child("usd"), place)
    # at rest, so that nothing has to move
    options = MeshOptions(skin["rest"], skin["subdivision"], skin["uv"], is_driven=True)
    opened = all_of(
        *(partial(open_carrier, scene, path, options, at) for path, at in paths.items())
    )
    for path, mesh in zip(paths, opened, strict=True):
        if mesh.bones is not None:
            continue
        mesh.warn(str(scene.path))
        for message in skin_doubts(mesh):
            warn_input(f"{scene.path}: {path}: {message}")
    for mesh in opened:
        note_read(StageRead(str(scene.path), mesh.path, "skin at rest", 1))
    return {
        path: StageSkin(scene, mesh, skin["wrap"]) for path, mesh in zip(paths, opened, strict=True)
    }


class StageSkin:
    """A mesh as featherfx.groom.skin.points.SkinSource describes it."""

    def __init__(self, scene: SourceScene, mesh: Surface, wrap: str) -> None:
        self._scene, self._prim = scene, scene.stage.GetPrimAtPath(mesh.path)
        self.path, self.points = mesh.path, mesh.rest
        self.triangles, self.face, self.st = mesh.triangles, mesh.face, mesh.st
        self.uv, self.wrap, self._mesh = mesh.uv, wrap, mesh
        self.own_matrix, self.is_ribbon = mesh.rest_matrix, mesh.bones is not None
        self.stage_matrix = to_world_matrix(np.eye(4), scene.to_world)

    def joint(self, name: str, place: Place) -> Array:
        """(3,) m, a joint of the mesh's skeleton in the bind pose."""
        with errors_at(place):
            skeleton = self._prim
            if not skeleton.IsA(UsdSkel.Skeleton):
                skeleton = UsdSkel.BindingAPI(self._prim).GetInheritedSkeleton().GetPrim()
            if not skeleton:
                place.refuse(f"no skeleton moves {self.path}")
            paths, places = _read_bind_places(self._scene, skeleton, place)
            return _skeleton_to_world(
                self._scene, skeleton, places[_find_joint(name, paths, place)], place
            )

    def weights(self, name: str, place: Place) -> Array:
        """(T, 3) a scalar primvar at the corners."""
        return self._primvar(name, 1, place)

    def colours(self, name: str, place: Place) -> Array:
        """(T, 3, 3) a primvar of three components at the corners."""
        return self._primvar(name, 3, place)

    def vectors(self, name: str, place: Place) -> Array:
        """(T, 3, 3) a vector primvar at the corners, in the world."""
        local = self._primvar(name, 3, place)
        return np.asarray(local @ self._scene.matrix(self._prim, DEFAULT_TIME)[:3, :3])

    def subset(self, name: str, place: Place) -> Flags:
        """(T,) whether triangles are of a named set of faces."""
        subsets = {
            each.GetPrim().GetName(): each
            for each in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Mesh(self._prim))
        }
        if name not in subsets:
            place.refuse(f"no subset '{name}' on {self.path}, {nearest(name, subsets)}")
        with errors_at(place):
            indices = read_sized_array(subsets[name].GetIndicesAttr(), EARLIEST_TIME, INTEGER_ARRAY)
            return np.isin(self.face, indices)

    def image(self, path: Path, place: Place, mode: str) -> Array:
        """(H, W) grey values 0 to 1 of a picture, top row first; (H, W, 3) sRGB in mode RGB."""
        try:
            from PIL import Image
        except ImportError:
            place.refuse('needs Pillow. Run pip install "featherfx[preview]"')
        try:
            with Image.open(path) as image:
                return np.asarray(image.convert(mode), dtype=np.float64) / 255.0
        except FileNotFoundError:
            place.refuse(f"{path}: there is no such file. Check the path")
        except OSError as error:
            place.refuse(f"{path}: cannot be read: {error}")

    def curves(self, prims: tuple[str, ...], place: Place) -> list[Array]:
        """Polylines (k, 3) m of curves at or below prims."""
        return _read_curve_prims(self._scene, prims, "guide curve", place)

    def _primvar(self, name: str, size: int, place: Place) -> Array:
        """(T, 3) or (T, 3, size) values at the corners of the triangles."""
        with errors_at(place):
            return self._at_corners(name, size, place)

    def _at_corners(self, name: str, size: int, place: Place) -> Array:
        api = UsdGeom.PrimvarsAPI(self._prim)
        primvar = api.FindPrimvarWithInheritance(name)
        kind = NUMBER_ARRAY if size == 1 else VECTOR_ARRAY
        found = read_primvar(primvar, kind)
        if found is None:
            known = [each.GetPrimvarName() for each in api.GetPrimvarsWithValues()]
            place.refuse(f"no primvar '{name}' on {self.path}, {nearest(name, known)}")
        values = found[0]
        if not np.isfinite(values).all():
            place.refuse(f"primvar '{name}' on {self.path} holds values that are not finite")
        corners = self._mesh.spread(*found)
        if corners is None:
            told = f"has {len(values)} values that fit nothing"
            place.refuse(f"primvar '{name}' on {self.path} {told}")
        return corners


def read_curves(folder: Path, entry: dict[str, Any], place: Place) -> list[Array]:
    """Polylines (k, 3) m of the curves at or below a prim of a USD file, or of a skeleton's joints.

    entry: checked keys of the curve of a row. Raises InputError.
    """
    scene = open_chosen(locate_file(folder, entry["usd"]), entry, place.child("usd"), place)
    root = find_prim(scene, entry["prim"], place.child("prim"), "curves", "skeleton")
    with errors_at(place):
        if not root.IsA(UsdSkel.Skeleton):
            if entry["joints"]:
                place.child("joints").refuse(f"{entry['prim']} in {scene.path} is no Skeleton")
            return _read_curve_prims(scene, (entry["prim"],), "line", place.child("prim"))
        if len(entry["joints"]) < 2:
            known = ", ".join(read_texts(UsdSkel.Skeleton(root).GetJointsAttr()))
            place.child("joints").refuse(f"expects two or more of {entry['prim']}, known: {known}")
        lines = [joint_line(scene, root, entry["joints"], place, entry["tail"])]
        note_read(StageRead(str(scene.path), entry["prim"], "line of joints", 1))
        return lines


def _read_curve_prims(
    scene: SourceScene, prims: tuple[str, ...], role: str, place: Place
) -> list[Array]:
    """Lines of at least two points. Raises InputError with all problems of curves."""
    found: list[Array] = []
    problems = Problems()
    for path in prims:
        for prim in prims_below(find_prim(scene, path, place, "curves")):
            if is_curves(prim):
                with problems.collecting(), errors_at(place):
                    code = rest_time(UsdGeom.Curves(prim).GetPointsAttr())
                    at = Place(str(scene.path), str(prim.GetPath()), place.problems)
                    curves = read_prim_curves(prim, code, at)
                    matrix = scene.matrix(prim, code)
                    lines = (curves.line(number) for number in range(len(curves)))
                    found += [transform_points(line, matrix) for line in lines]
    problems.hand_on()
    if not found:
        there = describe_prims(scene, ("curves",), prims[0])
        place.refuse(f"no curves at {', '.join(prims)} or below in {scene.path}{there}")
    note_read(StageRead(str(scene.path), ", ".join(prims), role, len(found)))
    return found


def joint_line(
    scene: SourceScene, prim: Any, names: tuple[str, ...], place: Place, tail: bool
) -> Array:
    """(k, 3) m, places of joints in the bind pose of a skeleton. Raises InputError.

    names: paths as the skeleton has them, or their last parts where these are unique. tail: whether
    the line goes on to the end of the last joint's bone.
    """
    (paths, places), at = _read_bind_places(scene, prim, place), place.child("joints")
    chosen = all_of(
        *(partial(_find_joint, name, paths, at.item(k)) for k, name in enumerate(names))
    )
    end = _find_tail(scene, prim, paths, places, chosen) if tail else None
    local = places[chosen] if end is None else np.vstack([places[chosen], end])
    points = _skeleton_to_world(scene, prim, local, place)
    if (np.diff(points, axis=0) == 0.0).all(axis=1).any():
        at.refuse("two joints that follow each other are at one place")
    return points


def _read_bind_places(scene: SourceScene, prim: Any, place: Place) -> tuple[list[str], Array]:
    """Paths of a skeleton's joints, and their places (J, 3) in its space in the bind pose."""
    skeleton = UsdSkel.Skeleton(prim)
    paths = read_texts(skeleton.GetJointsAttr(), EARLIEST_TIME)
    bind = read_array(skeleton.GetBindTransformsAttr(), EARLIEST_TIME, MATRIX_ARRAY)
    if bind is None or len(bind) != len(paths) or not paths:
        place.refuse(f"{prim.GetPath()} in {scene.path} has no bind transform for every joint")
    return paths, bind.astype(np.float64)[:, 3, :3]


def _skeleton_to_world(scene: SourceScene, prim: Any, local: Array, place: Place) -> Array:
    """(k, 3) m, of points in a skeleton's space."""
    points = transform_points(local, scene.matrix(prim, DEFAULT_TIME))
    if not np.isfinite(points).all():
        place.refuse(f"{prim.GetPath()} in {scene.path}: bind transforms are not finite")
    return points


def _find_tail(
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
    moved = find_joint_points(scene, prim, last)
    reach = float(((moved - places[last]) @ straight).max(initial=0.0))
    return places[last] + reach * straight if reach > 0.0 else None


def _find_joint(name: str, paths: list[str], place: Place) -> int:
    """The number of a joint."""
    if name in paths:
        return paths.index(name)
    found = [k for k, path in enumerate(paths) if path.rsplit("/", 1)[-1] == name]
    if len(found) == 1:
        return found[0]
    if found:
        several = ", ".join(paths[k] for k in found)
        place.refuse(f"'{name}' may be {several}. Give the whole path")
    ends = Counter(path.rsplit("/", 1)[-1] for path in paths)
    # as they may be written: the last part alone, where that says which
    known = {
        path if ends[path.rsplit("/", 1)[-1]] > 1 else path.rsplit("/", 1)[-1] for path in paths
    }
    place.refuse(f"no joint '{name}', {nearest(name, known)}")
