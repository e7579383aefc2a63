"""Joints of a skeleton as a polyline: the bones that rows of feathers stand on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import UsdSkel

from featherfx.groom.schema import Place, nearest
from featherfx.usd.scene import DEFAULT, EARLIEST, Scene, transform_code, transformed

Array = NDArray[np.float64]


def joint_line(scene: Scene, prim: Any, names: tuple[str, ...], place: Place) -> Array | None:
    """(k, 3) m, places of joints in the bind pose of a skeleton; None after adding problems.

    names: paths as the skeleton has them, or their last parts where these are unique.
    """
    skeleton = UsdSkel.Skeleton(prim)
    paths = [str(each) for each in skeleton.GetJointsAttr().Get(EARLIEST) or ()]
    bind = skeleton.GetBindTransformsAttr().Get(EARLIEST)
    if bind is None or len(bind) != len(paths) or not paths:
        place.fail(f"{prim.GetPath()} in {scene.path} has no bind transform for every joint")
        return None
    found = [_number(name, paths, place.child("joints").item(k)) for k, name in enumerate(names)]
    chosen = [each for each in found if each is not None]
    if len(chosen) < len(found):
        return None
    places = np.array(bind, dtype=np.float64).reshape(-1, 4, 4)[chosen, 3, :3]
    points = transformed(places, scene.matrix(prim, transform_code(prim, DEFAULT)))
    if (np.diff(points, axis=0) == 0.0).all(axis=1).any():
        place.child("joints").fail("two joints that follow each other are at one place")
        return None
    return np.asarray(points)


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
