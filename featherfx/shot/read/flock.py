"""Flock files in: TOML to a FlockShot, with every problem found at once."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.errors import as_figure, warn_input
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.presets.library import Library
from featherfx.groom.read.space import SceneReaders
from featherfx.groom.read.toml_file import load_toml
from featherfx.shot.flock import (
    FLOCK_FILE,
    Bird,
    BirdGroup,
    FlockShot,
    GroupOfFlock,
    Loop,
    SeenFrom,
    Spline,
    TurnedSpline,
    birds_on,
    look_at_birds,
    nearest_birds,
    place_birds,
)
from featherfx.shot.frames import StageClock
from featherfx.shot.read.read import read_preset, read_shot
from featherfx.shot.sources import TimedCamera


def read_flock(
    path: str | Path,
    preset_folders: Iterable[str | Path] = (),
    readers: SceneReaders | None = None,
    birds: int | None = None,
) -> FlockShot:
    """The flock that a TOML file describes, with the shots of its birds as their files have them.

    readers: of USD scenes. birds: of each group along a path, instead of the file's number. Raises
    InputError with all problems of the flock and its shots; InputWarning for birds that are in each
    other.
    """
    library, source = Library(preset_folders, Problems()), Path(path)
    place = Place(str(path), "", library.problems)
    raw = load_toml(source)
    parts = FLOCK_FILE.parts(raw, place)
    library.problems.raise_any()
    if not parts["flock"]:
        place.child("flock").refuse("is empty. Give a table [[flock]] for each group of birds")
    if parts["frames"][1] < parts["frames"][0]:
        place.child("frames").refuse("the last frame comes before the first. Give [first, last]")
    reader = _FlockReader(source, parts, tuple(preset_folders), readers, birds)
    groups: list[tuple[GroupOfFlock, list[Bird]]] = []
    for number, (at, entry) in enumerate(parts["flock"]):
        with library.problems.collecting():
            groups.append(reader.group(BirdGroup(**entry), number, at))
    wind = camera = limits = None
    with library.problems.collecting():
        wind = read_preset("wind", raw, parts, place, library)
    with library.problems.collecting():
        camera, limits = reader.camera(place.child("camera"))
    library.problems.raise_any()
    assert wind is not None
    found = [bird for _, own in groups for bird in own]
    if camera is not None and limits is not None:
        spans = np.array([groups[bird.group][0].span * bird.size for bird in found])
        found = look_at_birds(found, spans, camera, limits, reader.times)
        _warn_of_camera(found, spans, camera, reader, str(source))
    flock = FlockShot(
        parts["name"],
        source,
        tuple(parts["frames"]),
        parts["frames_per_second"],
        wind,
        tuple(group for group, _ in groups),
        tuple(found),
    )
    _warn_of_crowds(flock, reader.times)
    return flock


class _FlockReader:
    """Reads the parts of a flock file that stand in other files."""

    def __init__(
        self,
        source: Path,
        parts: dict[str, Any],
        preset_folders: tuple[str | Path, ...],
        readers: SceneReaders | None,
        birds: int | None,
    ) -> None:
        self._folder, self._parts, self._folders = source.parent, parts, preset_folders
        self._readers, self._birds = readers, birds
        first, last = parts["frames"]
        self.frames = np.arange(first, last + 1)
        self.times = (self.frames - first) / parts["frames_per_second"]

    def group(self, keys: BirdGroup, number: int, at: Place) -> tuple[GroupOfFlock, list[Bird]]:
        """A group and its birds. Raises InputError."""
        if (keys.path is None) == (keys.usd is None):
            at.refuse("needs either a path, or usd and prim of a PointInstancer")
        if keys.usd is not None and keys.prim is None:
            at.child("prim").refuse("is missing. Give the path of the PointInstancer")
        if np.linalg.norm(keys.forward[:2]) < 1e-6:
            at.child("forward").refuse("is not level. Give the direction in which the bird looks")
        shot = read_shot(self._folder / keys.shot, self._folders, self._readers)
        if shot.frames_per_second != self._parts["frames_per_second"]:
            own, rate = shot.frames_per_second, self._parts["frames_per_second"]
            told = f"{keys.shot} has {own:g} frames per second, the flock {rate:g}"
            at.child("shot").refuse(f"{told}. Give both the same")
        clock = None if shot.surfaces is None else shot.surfaces.clock
        if clock and (clock.start, clock.step) != (shot.first_frame, 1.0):
            told = f"the skin of {keys.shot} has frame {shot.first_frame} at time code"
            remedy = "Give a skin whose frames are its time codes"
            at.child("shot").refuse(f"{told} {clock.start:g}, {clock.step:g} a frame. {remedy}")
        loop = Loop.of(shot)
        roots = np.array([each.position for each in shot.groom.feathers]).reshape(-1, 3)
        middle = roots.mean(axis=0)
        reach = [
            np.linalg.norm(root - middle) + each.kind.length
            for root, each in zip(roots, shot.groom.feathers, strict=True)
        ]
        group = GroupOfFlock(keys, shot, loop, 2.0 * float(max(reach)), middle)
        if keys.usd is not None:
            return group, self._birds_of_points(keys, number, loop, at)
        keys = replace(keys, birds=self._birds or keys.birds)
        spline = self._spline(keys, at.child("path"))
        return replace(group, keys=keys), place_birds(keys, number, spline, loop)

    def _spline(self, keys: BirdGroup, at: Place) -> Spline:
        path = np.array(keys.path)
        for index, (before, after) in enumerate(pairwise(path[:, 0]), 1):
            if after <= before:
                at.item(index).refuse(f"{after:g} s is not later than {before:g} s, the one before")
        if not np.ptp(path[:, 1:], axis=0).any():
            at.refuse("has no length: all its places are the same. Give at least two that differ")
        return Spline.through(path[:, 0], path[:, 1:])

    def _birds_of_points(self, keys: BirdGroup, number: int, loop: Loop, at: Place) -> list[Bird]:
        if self._readers is None:
            at.refuse("is a USD scene. Use featherfx.bake_flock, or a command")
        assert keys.usd is not None
        assert keys.prim is not None
        file = self._readers.file(self._folder, keys.usd)
        ids, places, quats = self._readers.instances(file, keys.prim, self.frames, at)
        times = self.times if len(self.times) > 1 else np.array([0.0, 1.0])
        if len(self.times) == 1:
            places = np.repeat(places, 2, axis=0)
            quats = None if quats is None else np.repeat(quats, 2, axis=0)
        paths: list[Any] = [Spline.through(times, places[:, k]) for k in range(len(ids))]
        if quats is not None:
            paths = [TurnedSpline(path, quats[:, k]) for k, path in enumerate(paths)]
        names = [f"bird_{number + 1}_{id:04d}".replace("-", "m") for id in ids]
        return birds_on(keys, number, paths, loop, names)

    def camera(self, at: Place) -> tuple[TimedCamera | None, SeenFrom | None]:
        """The camera, and sizes in its picture. Raises InputError."""
        values = self._parts["camera"]
        if values is None:
            return None, None
        if self._readers is None:
            at.refuse("is a USD scene. Use featherfx.bake_flock, or a command")
        limits = SeenFrom(**values)
        if limits.far_below > limits.near_above:
            at.child("far_below").refuse(
                f"{limits.far_below:g} is above near_above = {limits.near_above:g}. Give less"
            )
        source = self._readers.camera(self._readers.file(self._folder, limits.usd), limits.prim, at)
        clock = StageClock(float(self._parts["frames"][0]), 1.0, self._parts["frames_per_second"])
        return TimedCamera(source, clock), limits


def _warn_of_crowds(flock: FlockShot, times: Any) -> None:
    """Warn of birds whose middles come nearer than half a body to each other."""
    if len(flock.birds) < 2:
        return
    reach = min(group.span for group in flock.groups)
    worst = (math.inf, 0, 0, 0)
    count = 0
    for k in {0, len(times) // 2, len(times) - 1}:
        places = np.concatenate([each.path.positions(times[k : k + 1]) for each in flock.birds])
        distance, other = nearest_birds(places)
        one = int(distance.argmin())
        count = max(count, int((distance < 0.5 * reach).sum()))
        worst = min(worst, (float(distance[one]), one, int(other[one]), k))
    if count:
        near, one, two, k = worst
        names = f"{flock.birds[one].name} and {flock.birds[two].name}"
        told = f"{count} birds are in others, {names} {as_figure(near)} m apart in frame"
        remedy = "Give a larger spread, or fewer birds"
        message = f"{flock.source}: flock: {told} {flock.frames[0] + k}. {remedy}"
        warn_input(message)


def _warn_of_camera(
    birds: list[Bird], spans: Any, camera: TimedCamera, reader: _FlockReader, source: str
) -> None:
    """Warn of a bird that the camera is in."""
    for frame, time in zip(reader.frames, reader.times, strict=True):
        eye = camera.view(float(time)).eye
        places = np.concatenate([each.path.positions(np.array([time])) for each in birds])
        inside = np.linalg.norm(places - eye, axis=1) < 0.25 * spans
        if inside.any():
            name = birds[int(np.flatnonzero(inside)[0])].name
            told = f"camera: is inside of {name} in frame {frame}. Move the camera or the path"
            warn_input(f"{source}: {told}")
            return
