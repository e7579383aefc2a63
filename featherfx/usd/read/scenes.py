"""Inputs of shots in USD: meshes by path, name or collection, poses, winds, cameras, flocks."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from featherfx.algebra.types import Array
from featherfx.groom.keys.groom import DEFAULT_PRIMVARS, USD_KEYS
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.keys.values import Table
from featherfx.groom.skin.field import search_tree
from featherfx.phases import LeftOut, StageRead, note_read
from featherfx.shot.sources import View
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.drawn_meshes import drawn_meshes, find_hidden
from featherfx.usd.read.groom import read_feathers
from featherfx.usd.read.ribbons import open_carrier
from featherfx.usd.read.stage import (
    ScenePrim,
    SourceScene,
    check_transforms,
    describe_prims,
    find_prim,
    open_chosen,
    prims_below,
    sampled_range,
    transform_points,
)
from featherfx.usd.read.surface import MeshOptions, Surface
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    EARLIEST_TIME,
    INTEGER_ARRAY,
    QUATERNION_ARRAY,
    VECTOR_ARRAY,
    compute,
    errors_at,
    read_array,
    read_number,
    read_sized_array,
    read_times,
    read_value,
)

_MAX_NEIGHBOURS = 8
PointsById = dict[str, Array]


def open_meshes(
    path: Path, prims: Mapping[str, Place], entry: Mapping[str, Any], place: Place
) -> list[Surface]:
    """Return meshes of a file by prim path, by name with wild cards, and by collection.

    prims: with the key that names each. entry: checked keys of [skin] or [[collider]]. place: of
    the table. Raises InputError with all problems.
    """
    scene, problems = open_chosen(path, entry, place.child("usd"), place), Problems()
    left: list[LeftOut] = []
    paths: dict[str, Place] = {}
    for each, at in prims.items():
        with problems.collecting():
            found = [each] if each.startswith("/") else _by_name(scene, each, entry, left, at)
            paths |= dict.fromkeys(found, at)
    if entry.get("collection") is not None:
        with problems.collecting():
            paths |= dict.fromkeys(_by_collection(scene, entry, left, place), place)
    options = MeshOptions(
        entry.get("rest"), entry["subdivision"], entry.get("uv", ""), entry.get("is_driven", False)
    )
    opened = []
    for each, at in paths.items():
        with problems.collecting():
            opened.append(open_carrier(scene, each, options, at))
            opened[-1].warn(f"{at.source}: {at.key}")
    problems.raise_any()
    for mesh in opened[:1]:
        mesh.left = tuple(left)
    return opened


def _by_name(
    scene: SourceScene, pattern: str, entry: Mapping[str, Any], left: list[LeftOut], place: Place
) -> list[str]:
    prims = [
        prim
        for prim in prims_below(scene.stage.GetPseudoRoot())
        if prim.IsA(UsdGeom.Mesh) and fnmatch.fnmatchcase(prim.GetName(), pattern)
    ]
    if not prims:
        there = describe_prims(scene, ("mesh",), pattern)
        place.refuse(f"no mesh is called '{pattern}' in {scene.path}{there}")
    return _drawn_paths(prims, entry, left, place)


def _drawn_paths(
    prims: Sequence[Any], entry: Mapping[str, Any], left: list[LeftOut], place: Place
) -> list[str]:
    """Return the paths of the prims that are drawn as the keys of a table say.

    left: takes the others.
    """
    reasons = {str(prim.GetPath()): find_hidden(prim, entry) for prim in prims}
    left += [LeftOut(path, "Mesh", reason) for path, reason in reasons.items() if reason]
    if all(reasons.values()):
        place.refuse(f"names nothing that is drawn: {left[-1].path} {left[-1].reason}")
    return [path for path, reason in reasons.items() if not reason]


def _by_collection(
    scene: SourceScene, entry: Mapping[str, Any], left: list[LeftOut], place: Place
) -> list[str]:
    at, collection = place.child("collection"), str(entry["collection"])
    owner, _, name = collection.partition(".collection:")
    prim = find_prim(scene, owner, at)
    api = Usd.CollectionAPI(prim, name) if name else None
    if not api or not prim.HasAPI(Usd.CollectionAPI, name):
        known = [each.GetName() for each in Usd.CollectionAPI.GetAll(prim)]
        at.refuse(f"no collection '{name}' on {owner}, there is {', '.join(known) or 'none'}")
    members = compute(prim, _members, api, scene.stage)
    prims = [each for each in members if isinstance(each, Usd.Prim) and each.IsA(UsdGeom.Mesh)]
    if not prims:
        at.refuse(f"{collection} holds no mesh")
    return sorted(_drawn_paths(prims, entry, left, at))


def _members(api: Any, stage: Any) -> Any:
    query = api.ComputeMembershipQuery()
    return Usd.CollectionAPI.ComputeIncludedObjects(query, stage, Usd.TraverseInstanceProxies())


def read_poses(path: Path, code: float | None, place: Place) -> tuple[PointsById, PointsById]:
    """Return points of feathers by id, at a time code or at rest, in m with z up.

    The first table has (V, 3) points of meshes, the second (k, 3) of rachises, where the file holds
    curves and no mesh. Raises InputError.
    """
    scene = open_chosen(path, {}, place, place)
    with errors_at(place):
        # return whether only curves are drawn; those of condensed feathers have barbs
        curves = [each for each in scene.stage.Traverse() if each.IsA(UsdGeom.BasisCurves)]
        barbs = f"primvars:{DEFAULT_PRIMVARS['left_barbs']}"
        plain = bool(curves) and not any(each.HasAttribute(barbs) for each in curves)
        if plain and next(drawn_meshes(scene.stage), None) is None:
            keys = {"file": str(path), "time": code} if code is not None else {"file": str(path)}
            entry = Table(USD_KEYS).check(keys, place, False)
            _, drawn = read_feathers(entry, path.parent, place)
            return {}, {each.id or each.name: each.points for each in drawn}
        cache = Cache(path)
        low, high = cache.frames if cache.has_frames else (-np.inf, np.inf)
        if code is not None and not low <= code <= high:
            place.refuse(f"{path} has frames {low:g} to {high:g}, not {code:g}")
        note_read(StageRead(str(path), "/", "posed feather", len(cache.feathers), cache.left))
        return {
            feather.id: cache.pose(index, code).points.astype(np.float64) @ scene.to_world
            for index, feather in enumerate(cache.feathers)
        }, {}


class UniformWind(ScenePrim):
    """A wind that is the same everywhere, from one vector attribute."""

    def __init__(self, scene: SourceScene, prim: Any, attribute: Any) -> None:
        super().__init__(scene, prim)
        self._attribute = attribute
        self.sampled = sampled_range(prim, [attribute])

    def velocity(self, points: Array, code: float) -> Array:
        """Return (N, 3) m/s, the same at all points, at a time code."""
        time = Usd.TimeCode(code)
        vector = np.array(read_value(self._attribute, time), dtype=np.float64).reshape(3)
        turned = vector @ self._scene.matrix(self._prim, time)[:3, :3]
        return np.broadcast_to(turned, points.shape).copy()


class SampledWind(ScenePrim):
    """A wind from points with velocities: the mean of the nearest by 1/distance^2."""

    def __init__(self, scene: SourceScene, prim: Any) -> None:
        super().__init__(scene, prim)
        self._base = UsdGeom.PointBased(prim)
        moving = [self._base.GetPointsAttr(), self._base.GetVelocitiesAttr()]
        self.sampled = sampled_range(prim, moving)
        self._last: tuple[float, Any, Array] | None = None

    def velocity(self, points: Array, code: float) -> Array:
        """Return (N, 3) m/s at points (N, 3) m, at a time code."""
        if self._last is None or self._last[0] != code:
            time = Usd.TimeCode(code)
            matrix = self._scene.matrix(self._prim, time)
            places, velocities = _field_values(self._base, time)
            tree = search_tree(transform_points(places, matrix))
            self._last = code, tree, velocities @ matrix[:3, :3]
        _, tree, velocities = self._last
        distance, near = tree.query(points, k=min(_MAX_NEIGHBOURS, len(velocities)))
        distance, near = distance.reshape(len(points), -1), near.reshape(len(points), -1)
        floor = 1e-9 * max(float(distance.max(initial=0.0)), 1e-300)
        weights = 1.0 / np.maximum(distance, floor) ** 2
        weights = weights / weights.sum(axis=1, keepdims=True)
        return np.asarray(np.einsum("nk,nkc->nc", weights, velocities[near]))


def open_wind(path: Path, entry: dict[str, Any], place: Place) -> UniformWind | SampledWind:
    """Return the wind that checked keys of [wind_usd] name. Raises InputError."""
    scene, at = open_chosen(path, {}, place.child("usd"), place), place.child("prim")
    prim = find_prim(scene, entry["prim"], at, "points")
    with errors_at(place):
        check_transforms(scene, prim, at)
        if entry["attribute"] is not None:
            return UniformWind(
                scene, prim, _find_numbers(prim, entry["attribute"], (3,), place.child("attribute"))
            )
        if not prim.IsA(UsdGeom.PointBased):
            at.refuse(f"{prim.GetPath()} holds no points. Give attribute for one vector")
        base = UsdGeom.PointBased(prim)
        times = {*read_times(base.GetPointsAttr()), *read_times(base.GetVelocitiesAttr())}
        for code in [*map(Usd.TimeCode, sorted(times))] or [DEFAULT_TIME]:
            points, velocities = _field_values(base, code)
            where = f"{prim.GetPath()} at time code {code}"
            if len(points) == 0 or len(points) != len(velocities):
                at.refuse(f"{where}: {len(points)} points and {len(velocities)} velocities")
            if not (np.isfinite(points).all() and np.isfinite(velocities).all()):
                at.refuse(f"{where}: values that are not finite")
        return SampledWind(scene, prim)


def _find_numbers(prim: Any, name: str, counts: Sequence[int], at: Place) -> Any:
    """Return the attribute of a prim that holds finite numbers at all times, of one of counts."""
    what = {1: "a number", 3: "one vector", 4: "a quaternion"}
    told = " or ".join(what[each] for each in counts)

    def fits(attribute: Any, code: Any) -> bool:
        found = _numbers(read_value(attribute, code))
        return found is not None and len(found) in counts and bool(np.isfinite(found).all())

    if not Sdf.Path.IsValidNamespacedIdentifier(name) or not prim.GetAttribute(name):
        authored = prim.GetAuthoredAttributes()
        known = ", ".join(each.GetName() for each in authored if fits(each, EARLIEST_TIME))
        at.refuse(
            f"no attribute '{name}' on {prim.GetPath()}. Attributes of {told}: {known or 'none'}"
        )
    attribute = prim.GetAttribute(name)
    for code in [EARLIEST_TIME, *map(Usd.TimeCode, read_times(attribute))]:
        if not fits(attribute, code):
            at.refuse(
                f"{attribute.GetPath()} is not {told}, of finite numbers, at time code {code}"
            )
    return attribute


def _numbers(value: Any) -> Array | None:
    """(n,) numbers of a value of USD, a quaternion's as w, x, y, z; None where it has none."""
    if hasattr(value, "imaginary"):
        value = (value.real, *value.imaginary)
    try:
        return np.array(value, dtype=np.float64).reshape(-1)
    except (TypeError, ValueError):
        return None


class SceneAttribute(ScenePrim):
    """Numbers of an attribute over time, as USD has them between samples and knots."""

    def __init__(self, scene: SourceScene, prim: Any, attribute: Any) -> None:
        super().__init__(scene, prim)
        self._attribute, self.to_world = attribute, scene.to_world
        self.sampled = sampled_range(prim, [attribute])

    @property
    def origin(self) -> tuple[Any, ...]:
        return (*super().origin, self._attribute.GetName())

    def value(self, code: float) -> Array:
        """Return (n,) numbers at a time code."""
        found = _numbers(read_value(self._attribute, Usd.TimeCode(code)))
        assert found is not None
        return found


def open_attribute(path: Path, entry: dict[str, Any], place: Place) -> SceneAttribute:
    """Return the attribute that checked keys of a curve name. Raises InputError."""
    scene, at = open_chosen(path, {}, place.child("usd"), place), place.child("prim")
    prim = find_prim(scene, entry["prim"], at)
    counts = {"position": (3,), "rotation": (3, 4)}.get(entry["sets"], (1,))
    with errors_at(place):
        attribute = _find_numbers(prim, entry["attribute"], counts, place.child("attribute"))
    found = SceneAttribute(scene, prim, attribute)
    told = partial(found.describe_motion, ())
    note_read(StageRead(str(path), str(attribute.GetPath()), "motion", 1, describe=told))
    return found


class SceneCamera(ScenePrim):
    """A camera prim as featherfx.shot.sources.Camera."""

    def __init__(self, scene: SourceScene, prim: Any) -> None:
        super().__init__(scene, prim)
        self.sampled = sampled_range(prim, prim.GetAttributes())

    def view(self, code: float) -> View:
        """Return the view in metres, z up, at a time code; transforms and lens may be animated."""
        time = Usd.TimeCode(code)
        camera = compute(self._prim, UsdGeom.Camera(self._prim).GetCamera, time)
        matrix = self._scene.matrix(self._prim, time)
        axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=1, keepdims=True)
        window = camera.frustum.GetWindow()
        size, middle = window.GetSize(), window.GetMidpoint()
        orthographic = camera.projection == Gf.Camera.Orthographic
        # the window of an orthographic camera is in scene units
        unit = self._scene.meters_per_unit if orthographic else 1.0
        return View(
            eye=matrix[3, :3].copy(),
            right=axes[0],
            up=axes[1],
            back=axes[2],
            width=unit * float(size[0]),
            height=unit * float(size[1]),
            shift=(unit * float(middle[0]), unit * float(middle[1])),
            orthographic=orthographic,
        )


def open_camera(path: Path, prim: str, place: Place) -> SceneCamera:
    """Return the camera at a prim path of a file. Raises InputError."""
    scene, at = open_chosen(path, {}, place.child("usd"), place), place.child("prim")
    found = find_prim(scene, prim, at, "camera")
    if not found.IsA(UsdGeom.Camera):
        at.refuse(f"{prim} is no camera in {path}{describe_prims(scene, ('camera',), prim)}")
    with errors_at(at):
        check_transforms(scene, found, at)
        _check_lens(UsdGeom.Camera(found))
        return SceneCamera(scene, found)


def _check_lens(camera: Any) -> None:
    """Raise InputError for an aperture or a focal length that no camera has."""
    most = 1e6  # tenths of a scene unit
    lengths = (
        (camera.GetHorizontalApertureAttr(), 1e-6),
        (camera.GetVerticalApertureAttr(), 1e-6),
        (camera.GetFocalLengthAttr(), 1e-6),
        (camera.GetHorizontalApertureOffsetAttr(), -most),
        (camera.GetVerticalApertureOffsetAttr(), -most),
    )
    for attribute, least in lengths:
        for code in [EARLIEST_TIME, *map(Usd.TimeCode, read_times(attribute))]:
            read_number(attribute, code, least, most)


def _field_values(base: Any, code: Any) -> tuple[Array, Array]:
    """Return (N, 3) points and velocities of a point set at a time."""
    points = read_sized_array(base.GetPointsAttr(), code, VECTOR_ARRAY)
    velocities = read_sized_array(base.GetVelocitiesAttr(), code, VECTOR_ARRAY)
    return points.astype(np.float64), velocities.astype(np.float64)


def find_camera(path: Path, named: str, cache: Cache) -> Callable[[float | None], View]:
    """Return the view of a camera by the cache's time codes; None: at rest, its first frame.

    path: of the cache. named: prim path in that file, or FILE:PATH of another one. Raises
    InputError with the cameras that there are.
    """
    file, colon, prim = named.rpartition(":/")
    where = Path(file) if colon else path
    place = Place("preview", "camera", Problems())
    camera = open_camera(where, f"/{prim}" if colon else named, place)
    rate = camera.time_codes_per_second / cache.frames_per_second

    def seen(time: float | None) -> View:
        return camera.view(0.0 if time is None else rate * time)

    return seen


def read_instances(
    path: Path, prim: str, codes: Array, place: Place
) -> tuple[list[int], Array, Array | None]:
    """Return ids, places (K, N, 3) m and turns (K, N, 4) x, y, z, w of a PointInstancer's points.

    codes: (K,) time codes. Turns are None where it has no orientations; they take what looks along
    the world's x, with z up. Prototypes are not read. Raises InputError.
    """
    scene, at = open_chosen(path, {}, place.child("usd"), place), place.child("prim")
    found = find_prim(scene, prim, at, "points")
    if not found.IsA(UsdGeom.PointInstancer):
        at.refuse(f"{prim} is no PointInstancer in {path}. Give the path of one")
    with errors_at(place):
        check_transforms(scene, found, at)
        points = UsdGeom.PointInstancer(found)
        ids = _read_ids(points, codes, at)
        samples = [_read_sample(scene, points, ids, Usd.TimeCode(float(c)), at) for c in codes]
    note_read(StageRead(str(path), prim, "bird", len(ids), ()))
    places, turns = zip(*samples, strict=True)
    with_turns = all(each is not None for each in turns)
    return ids, np.stack(places), np.stack(turns) if with_turns else None


def _read_ids(points: Any, codes: Array, at: Place) -> list[int]:
    """Return the ids at the first code; numbers where it has none. All codes must have them."""
    first = Usd.TimeCode(float(codes[0]))
    known = read_array(points.GetIdsAttr(), first, INTEGER_ARRAY)
    count = len(read_sized_array(points.GetPositionsAttr(), first, VECTOR_ARRAY))
    ids = list(range(1, count + 1)) if known is None else [int(each) for each in known]
    if len(ids) != count or len(set(ids)) != count or not count:
        at.refuse(f"has {count} points and {len(set(ids))} ids. Give each point an id of its own")
    return ids


def _read_sample(
    scene: Any, points: Any, ids: list[int], code: Any, at: Place
) -> tuple[Array, Array | None]:
    """Return places and turns at a time code, in the order of ids."""
    places = read_sized_array(points.GetPositionsAttr(), code, VECTOR_ARRAY)
    own = read_array(points.GetIdsAttr(), code, INTEGER_ARRAY)
    order = np.arange(len(places)) if own is None else np.argsort(np.asarray(own))
    if own is not None:
        back = np.argsort(np.argsort(ids))
        if sorted(int(each) for each in own) != sorted(ids):
            at.refuse(f"time code {code} has other ids than the first. Keep birds in all frames")
        order = order[back]
    if len(places) != len(ids):
        at.refuse(f"time code {code} has {len(places)} points, and the first {len(ids)}")
    matrix = scene.matrix(points.GetPrim(), code)
    quats = read_array(points.GetOrientationsAttr(), code, QUATERNION_ARRAY)
    if quats is None or len(quats) != len(ids):
        return transform_points(places, matrix)[order], None
    from scipy.spatial.transform import Rotation  # only flocks need it

    axes = scene.to_world / scene.meters_per_unit
    rows = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=1, keepdims=True)
    turns = rows.T @ Rotation.from_quat(quats.astype(np.float64)).as_matrix() @ axes
    return transform_points(places, matrix)[order], Rotation.from_matrix(turns).as_quat()[order]
