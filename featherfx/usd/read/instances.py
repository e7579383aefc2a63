"""Points of a PointInstancer over time: ids, places and turns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom
from scipy.spatial.transform import Rotation

from featherfx.algebra.types import Array
from featherfx.groom.keys.problems import Place
from featherfx.provenance import StageRead, note_read
from featherfx.usd.read.stage import (
    check_transforms,
    find_prim,
    open_chosen,
    transform_points,
)
from featherfx.usd.read.values import (
    INTEGER_ARRAY,
    QUATERNION_ARRAY,
    VECTOR_ARRAY,
    errors_at,
    read_array,
    read_sized_array,
)


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
    axes = scene.to_world / scene.meters_per_unit
    rows = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=1, keepdims=True)
    turns = rows.T @ Rotation.from_quat(quats.astype(np.float64)).as_matrix() @ axes
    return transform_points(places, matrix)[order], Rotation.from_matrix(turns).as_quat()[order]
