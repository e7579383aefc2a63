"""The sink of a bake: frames in, one USD cache out, complete or not at all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from pxr import Usd

from featherfx.errors import Problem, SimulationError
from featherfx.shot.types import Frame
from featherfx.usd.atomic import publish
from featherfx.usd.curves import define_rachis
from featherfx.usd.layout import finish_layers, new_layers
from featherfx.usd.material import define_materials
from featherfx.usd.mesh import define_mesh
from featherfx.usd.names import prim_name, unique_prim_names
from featherfx.usd.output import check_output
from featherfx.usd.samples import SampleWriter
from featherfx.usd.space import UP_AXES, StageSpace
from featherfx.usd.stage import (
    FEATHERS,
    MATERIALS,
    RACHISES,
    StageInfo,
    define_root,
    define_scopes,
)
from featherfx.usd.surfaces import SurfaceFrame, SurfaceSet
from featherfx.usd.types import FeatherEntry, OutputError


class CacheWriter:
    """Writes feathers, and frames of them, to USD; a context manager.

        with CacheWriter("wing.usdc", entries, (1, 24), 24.0) as writer:
            for frame in simulate(shot):
                writer.write(frame)

    path: .usd, .usdc or .usda. feathers: at least one, unique ids. frames: first and last frame,
    None for a rest pose without time. frames_per_second: also the time codes per second.
    meters_per_unit: m, and up_axis: "Y" or "Z": points, velocities and widths are converted.
    layout: "flat", one file, or "payload", a root file with a payload and an animation beside
    it. metadata: plain values, kept as custom data of the root layer.

    Nothing is on disk before the block ends. Leaving it normally writes and publishes all files;
    leaving it by an exception leaves the folder as it was. Raises OutputError (every problem at
    once) where the arguments are wrong, the output cannot be written or frames are missing.
    """

    def __init__(
        self,
        path: str | Path,
        feathers: Sequence[FeatherEntry],
        frames: tuple[int, int] | None,
        frames_per_second: float = 24.0,
        *,
        meters_per_unit: float = 1.0,
        up_axis: str = "Z",
        layout: str = "flat",
        overwrite: bool = False,
        metadata: Mapping[str, Any] | None = None,
    ) -> None:
        self._path = check_output(path, overwrite, layout)
        _check_arguments(self._path, feathers, frames, frames_per_second, meters_per_unit, up_axis)
        space = StageSpace(meters_per_unit, up_axis)
        self._info = StageInfo(
            prim_name(self._path.stem), space, frames, frames_per_second, dict(metadata or {})
        )
        self._feathers = tuple(feathers)
        self._surfaces = SurfaceSet(self._feathers, space)
        self._check_finite(self._surfaces.rest, 0.0)
        self._bounds = self._bounds_of(self._surfaces.rest)
        self._next = frames[0] if frames else 0
        self._layers = new_layers(self._info, layout)
        self._samples = self._define_prims()

    def __enter__(self) -> CacheWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self._finish()

    def write(self, frame: Frame) -> None:
        """Add the next frame: numbers count up by one from the first.

        Raises SimulationError if a value is not finite, ValueError for a frame out of turn or of
        other feathers.
        """
        frames = self._info.frames
        if frames is None or frame.number != self._next or frame.number > frames[1]:
            raise ValueError(f"frame {frame.number} is out of turn; the cache holds {frames}")
        if len(frame.points) != len(self._feathers):
            raise ValueError(f"{len(frame.points)} feathers given, not {len(self._feathers)}")
        pose = self._surfaces.evaluate(frame.points, frame.velocities)
        self._check_finite(pose, frame.time)
        self._samples.write(float(frame.number), pose)
        low, high = self._bounds_of(pose)
        self._bounds = np.minimum(self._bounds[0], low), np.maximum(self._bounds[1], high)
        self._next += 1

    def _define_prims(self) -> SampleWriter:
        info, surfaces = self._info, self._surfaces
        stage = Usd.Stage.Open(self._layers.topology)
        define_root(stage, info)
        define_scopes(stage, info)
        materials = define_materials(stage, info.root_path.AppendChild(MATERIALS))
        names = unique_prim_names([entry.id for entry in self._feathers])
        shafts = unique_prim_names([f"{name}_rachis" for name in names])
        meshes = [info.root_path.AppendPath(f"{FEATHERS}/{name}") for name in names]
        rachises = [info.root_path.AppendPath(f"{RACHISES}/{name}") for name in shafts]
        for k, entry in enumerate(self._feathers):
            rest = surfaces.rest.points[surfaces.point_slices[k]]
            define_mesh(stage, meshes[k], entry, rest, materials)
            shaft = surfaces.rest.rachis_points[surfaces.rachis_slices[k]]
            define_rachis(stage, rachises[k], entry, shaft, surfaces.widths[k], materials)
        layers = self._layers
        return SampleWriter(layers.animation, layers.topology, meshes, rachises, surfaces)

    def _finish(self) -> None:
        frames = self._info.frames
        if frames is not None and self._next <= frames[1]:
            message = f"not written: frames {self._next} to {frames[1]} never came"
            raise OutputError(Problem(str(self._path), "frames", message))
        self._samples.finish()
        publish(finish_layers(self._layers, self._info, self._path, self._bounds))

    def _check_finite(self, frame: SurfaceFrame, time: float) -> None:
        for index in np.flatnonzero(self._surfaces.not_finite(frame)):
            reason = "a position or velocity is not finite, or too large for single precision"
            raise SimulationError(self._feathers[index].id, time, reason)

    @staticmethod
    def _bounds_of(frame: SurfaceFrame) -> tuple[Any, Any]:
        return frame.extent[:, 0].min(axis=0), frame.extent[:, 1].max(axis=0)


def _check_arguments(
    path: Path,
    feathers: Sequence[FeatherEntry],
    frames: tuple[int, int] | None,
    frames_per_second: float,
    meters_per_unit: float,
    up_axis: str,
) -> None:
    wrong: list[tuple[str, str]] = []
    if not feathers:
        wrong.append(("feathers", "none given; a cache holds at least one"))
    seen: set[str] = set()
    for entry in feathers:
        if entry.id in seen:
            wrong.append(("feathers", f"id '{entry.id}' is used twice; ids are unique"))
        seen.add(entry.id)
        expected = entry.feather.points.shape
        if np.shape(entry.rest_points) != expected:
            shape = np.shape(entry.rest_points)
            wrong.append(("feathers", f"'{entry.id}': rest points {shape}, not {expected}"))
    if frames is not None and frames[0] > frames[1]:
        wrong.append(("frames", f"first frame {frames[0]} is after the last, {frames[1]}"))
    for key, value in (
        ("frames_per_second", frames_per_second),
        ("meters_per_unit", meters_per_unit),
    ):
        if not (math.isfinite(value) and value > 0):
            wrong.append((key, f"{value} is not a finite number above 0"))
    if up_axis not in UP_AXES:
        wrong.append(("up_axis", f"'{up_axis}' is not one of {', '.join(UP_AXES)}"))
    if wrong:
        raise OutputError(*(Problem(str(path), key, message) for key, message in wrong))
