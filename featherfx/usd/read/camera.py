"""Cameras of USD stages, for the level of detail."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom

from featherfx.groom.keys.values import Place
from featherfx.shot.detail.view import View
from featherfx.usd.read.scene import Scene, find_prim, open_scene

Array = NDArray[np.float64]


class SceneCamera:
    """A camera prim as featherfx.shot.detail.view.Camera."""

    def __init__(self, scene: Scene, prim: Any) -> None:
        self._scene, self._prim = scene, prim

    @property
    def time_codes_per_second(self) -> float:
        return self._scene.time_codes_per_second

    @property
    def origin(self) -> tuple[str, tuple[Path, ...]]:
        return str(self._prim.GetPath()), self._scene.files

    def view(self, code: float) -> View:
        """In metres, z up, at a time code; transforms and lens may be animated."""
        time = Usd.TimeCode(code)
        camera = UsdGeom.Camera(self._prim).GetCamera(time)
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


def open_camera(path: Path, prim: str, place: Place) -> SceneCamera | None:
    """The camera at a prim path of a file; None after adding problems."""
    scene = open_scene(path, place.child("usd"))
    at = place.child("prim")
    found = None if scene is None else find_prim(scene, prim, at)
    if scene is None or found is None:
        return None
    if not found.IsA(UsdGeom.Camera):
        cameras = [str(p.GetPath()) for p in scene.stage.Traverse() if p.IsA(UsdGeom.Camera)]
        at.fail(f"{prim} is no camera; cameras of {path}: {', '.join(cameras[:8]) or 'none'}")
        return None
    camera = UsdGeom.Camera(found)
    for attribute in (camera.GetHorizontalApertureAttr(), camera.GetVerticalApertureAttr()):
        for code in [Usd.TimeCode.EarliestTime(), *map(Usd.TimeCode, attribute.GetTimeSamples())]:
            value = attribute.Get(code)
            if not (np.isfinite(value) and value > 0.0):
                at.fail(f"{attribute.GetPath()} is {value:g}, expects a number above 0")
                return None
    return SceneCamera(scene, found)
