"""What stands beside the feathers of a cache: the skin and the colliders of its shot, and whatever
other file is named."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputWarning
from featherfx.render.colour import COLLIDER, SKIN
from featherfx.render.geometry import Geometry, geometry_of, vertex_normals
from featherfx.render.light_kernels import SKIN as SKIN_MATERIAL
from featherfx.render.scene import DrawnScene, load_points, load_scene
from featherfx.usd.read.read import Cache
from featherfx.usd.read.resolve import located

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Scenery:
    """Meshes of one file. scene: those. colour: (3,) of those without one. framed: whether cameras
    are to see all of it. start, first: time code of the file at a time code of the cache. rate:
    time codes of the file in one of the cache. rest: time code of the file at rest; None: its rest
    pose."""

    cache: Cache
    scene: DrawnScene
    colour: Array
    framed: bool
    start: float = 0.0
    first: float = 0.0
    rate: float = 1.0
    rest: float | None = None

    def points(self, time: float | None) -> Array:
        """(V, 3) m at a time code of the cache; None: at rest."""
        code = self.rest if time is None else self.start + self.rate * (time - self.first)
        return load_points(self.cache, self.scene, code)

    def geometry(self, time: float | None) -> Geometry:
        """At a time code of the cache."""
        points, triangles, starts = self.points(time), self.scene.triangles, self.scene.starts
        colours: list[Floats] = [
            np.broadcast_to(self.colour, (end - start, 3)) if each.colour is None else each.colour
            for each, start, end in zip(self.scene.feathers, starts[:-1], starts[1:], strict=True)
        ]
        normals = vertex_normals(points, triangles)
        return geometry_of(points, triangles, SKIN_MATERIAL, normals, np.concatenate(colours))


def scenery_of_shot(cache: Cache, path: Path) -> list[Scenery]:
    """The skin and the colliders that a cache names; a warning tells what is not there."""
    found = []
    for entry in cache.scenery:
        file = located(path.parent, entry["file"])
        if not file.is_file():
            message = f"{path}: its {entry['role']} {file} is not there and not drawn"
            warnings.warn(message, InputWarning, stacklevel=2)
            continue
        other = Cache(file)
        chosen = np.flatnonzero([each.path == entry["prim"] for each in other.feathers])
        if not len(chosen):
            message = f"{path}: {file} has no {entry['prim']} to draw"
            warnings.warn(message, InputWarning, stacklevel=2)
            continue
        is_skin = entry["role"] == "skin"
        found.append(
            Scenery(
                cache=other,
                scene=load_scene(other, chosen),
                colour=np.array(SKIN if is_skin else COLLIDER),
                framed=is_skin,
                start=entry["start"],
                first=entry["first"],
                rate=other.frames_per_second / cache.frames_per_second,
                rest=entry.get("rest"),
            )
        )
    return found


def scenery_of_files(
    cache: Cache, files: Iterable[Path], known: Iterable[Scenery] = ()
) -> list[Scenery]:
    """All meshes of other files, at the same seconds. known: what is drawn already."""
    found = []
    drawn = {(each.cache.path, f.path) for each in known for f in each.scene.feathers}
    for file in files:
        other = Cache(file)
        rate = other.frames_per_second / cache.frames_per_second
        left = [(other.path, each.path) not in drawn for each in other.feathers]
        if any(left):
            scene = load_scene(other, np.flatnonzero(left))
            found.append(Scenery(other, scene, np.array(SKIN), True, rate=rate))
    return found
